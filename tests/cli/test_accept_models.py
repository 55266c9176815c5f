"""A log that claims to know no error is believed, unless the host says not to (METHOD §1)."""

from __future__ import annotations

import json
from pathlib import Path

from click.testing import CliRunner

import possmap
from possmap.cli.main import main

EXACT = {"along": 0.0, "across": 0.0, "turn_spread": 0.0, "sensor": 0.0, "alignment_spread": 0.0}
RECORDS = [
    {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0},
    {"seq": 1, "kind": "pose", "x": 4, "y": 0, "heading": 0},
    {"seq": 2, "kind": "pose", "x": 4, "y": 0, "heading": 90},
    {"seq": 3, "kind": "pose", "x": 4, "y": 6, "heading": 90},
    {"seq": 4, "kind": "wall", "x": 4.3, "y": 6, "x2": 4.3, "y2": 8},
    {"seq": 5, "kind": "pose", "x": 4, "y": 8, "heading": 90},
]


def fused(folder: Path, name: str, model: dict[str, float], *options: str) -> tuple[str, int]:
    """Return the digest of a grid of one log, and in how many cells its wall may lie."""
    log, grid = folder / f"{name}.json", folder / f"{name}.possmap"
    head = {"possmap_log": 1, "robot": "liar", "excursion": "1", "model": model}
    log.write_text(json.dumps({**head, "records": RECORDS}))
    done = CliRunner().invoke(main, ["fuse", str(log), "-g", str(grid), *options])
    assert done.exit_code == 0, done.output
    with possmap.open_grid(grid) as opened:
        return opened.digest(), int((opened.necessity() > 0).sum())


def test_a_log_that_claims_no_error_is_not_believed_where_the_host_says_so(tmp_path: Path) -> None:
    mistrust = ("--set", "accept_models=false")
    _, believed = fused(tmp_path, "believed", EXACT)
    lied, mistrusted = fused(tmp_path, "lied", EXACT, *mistrust)
    honest, plain = fused(tmp_path, "honest", {}, *mistrust)
    assert 3 * believed < mistrusted
    assert (lied, mistrusted) == (honest, plain)


def test_a_grid_that_mistrusts_goes_on_doing_so(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    fused(tmp_path, "site", {}, "--set", "accept_models=false")
    log = tmp_path / "later.json"
    head = {"possmap_log": 1, "robot": "liar", "excursion": "2", "model": EXACT}
    log.write_text(json.dumps({**head, "records": RECORDS}))
    assert CliRunner().invoke(main, ["fuse", str(log), "-g", str(grid)]).exit_code == 0
    with possmap.open_grid(grid) as opened:
        models = {entry.name: entry.model.turn_spread for entry in opened.ledger.entries()}
    assert models == {("liar", "1"): 2.0, ("liar", "2"): 2.0}


def test_what_the_host_knows_of_a_robot_holds_where_its_log_is_not_believed(
    tmp_path: Path,
) -> None:
    told = ("--set", "accept_models=false", "--set", "robots.liar.turn_spread=1.5")
    fused(tmp_path, "site", EXACT, *told)
    with possmap.open_grid(tmp_path / "site.possmap") as opened:
        (entry,) = opened.ledger.entries()
    assert (entry.model.turn_spread, entry.model.across) == (1.5, 5.5 / 120)
