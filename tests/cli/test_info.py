"""``possmap info``: size, settings, robots, excursions and digest of a grid."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commands import run

from possmap.grid.opening import EMPTY
from possmap.release import version

EXACT = {"along": 0, "across": 0, "turn_spread": 0}  # a robot that makes no errors


def bumps(robot: str, excursion: str, *places: tuple[float, float], **more: Any) -> Any:
    """Two poses at the origin, and a bump at each place seen between them."""
    records: list[Any] = [{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}]
    for x, y in places:
        records += [{"seq": len(records), "kind": "wall", "x": x, "y": y, "x2": x, "y2": y}]
    records += [{"seq": len(records), "kind": "pose", "x": 0, "y": 0, "heading": 0}]
    whole = {"possmap_log": 1, "robot": robot, "excursion": excursion, "model": EXACT}
    return {**whole, "records": records, **more}


def fused(folder: Path, *logs: Any, settings: tuple[str, ...] = ()) -> Path:
    paths = [folder / f"{number}.json" for number in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        path.write_text(json.dumps(log))
    grid = folder / "site.possmap"
    assert run("fuse", *paths, "-g", grid, *settings).exit_code == 0
    return grid


def team() -> list[Any]:
    short = bumps("r2", "x", (0.51, -0.24))
    longer = {**short, "records": short["records"] + [{**short["records"][2], "seq": 3}]}
    return [bumps("r1", "a", (1.01, 0.26), (-20.01, 0.26), carried=[short]), longer]


def test_a_grid_is_told_line_by_line(tmp_path: Path) -> None:
    grid = fused(tmp_path, *team())
    result = run("info", grid, "--excursions")
    assert (result.stderr, result.exit_code) == ("", 0)
    digest = json.loads(run("info", grid, "--json").stdout)["digest"]
    assert re.fullmatch("[0-9a-f]{64}", digest)
    # Columns -401 to 20, rows -5 to 5, of 0.05 m.
    assert result.stdout == (
        f"grid        {grid}, {grid.stat().st_size / 1024:.0f} KiB\n"
        f"digest      {digest}\n"
        "map         21.10 × 0.55 m from (-20.05, -0.25), 422 × 11 cells of 0.05 m, 3 tiles\n"
        "evidence    8 records of 2 excursions by 2 robots\n"
        "settings    the paper's, all of them\n"
        "contested   0.0% of 3 known cells\n"
        "  r1 a: 4 records, its own along 0.0, across 0.0, turn_spread 0.0\n"
        f"    4 from {tmp_path / '0.json'}\n"
        "  r2 x: 4 records, its own along 0.0, across 0.0, turn_spread 0.0\n"
        f"    3 from {tmp_path / '0.json'}, carried by r1 a\n"
        f"    1 from {tmp_path / '1.json'}\n"
    )
    short = run("info", grid).stdout.splitlines()
    assert short[:6] == result.stdout.splitlines()[:6]
    assert short[6:10] == [
        "robots",
        "  r1: 1 excursion, 4 records",
        "  r2: 1 excursion, 4 records",
        "weeks",
    ]
    assert re.fullmatch(r"  20\d\d-W\d\d: 2 excursions of 2 robots, 8 records", short[10])


def test_json_tells_the_same(tmp_path: Path) -> None:
    settings = ("--resolution", "0.1", "--set", "robots.r2.drift=1e-3")
    grid = fused(tmp_path, *team(), settings=settings)
    found = json.loads(run("info", grid, "--json").stdout)
    excursions = found.pop("excursions")
    stored = found.pop("settings")
    (week,) = found.pop("by_week").values()
    assert week == {"excursions": 2, "records": 8, "beyond": 0, "robots": 2}
    assert found.pop("by_robot")["r2"] == {"excursions": 1, "records": 4, "beyond": 0, "robots": 1}
    assert len(found.pop("digest")) == 64
    assert found.pop("extent") == pytest.approx([-20.1, -0.3, 1.1, 0.3])
    assert found == {
        "grid": str(grid),
        "refined": None,
        "resolution": 0.1,
        "rows": 6,
        "columns": 212,
        "tiles": 3,
        "file_size": grid.stat().st_size,
        "records": 8,
        "cells_known": 3,
        "cells_contested": 0,
        "robots": ["r1", "r2"],
        "forgotten": [],
    }
    assert (stored["resolution"], stored["robots.r2.drift"]) == (0.1, 0.001)
    assert (stored["free_along_walls"], stored["turn_spread"]) == (False, 2.0)
    assert [(one["robot"], one["excursion"], one["records"]) for one in excursions] == [
        ("r1", "a", 4),
        ("r2", "x", 4),
    ]
    first = (tmp_path / "0.json").read_bytes()
    carried, own = excursions[1]["parts"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", carried.pop("fused_at"))
    assert carried == {
        "first": 0,
        "count": 3,
        "carried_by": ["r1", "a"],
        "source": str(tmp_path / "0.json"),
        "sha256": hashlib.sha256(first).hexdigest(),
        "size": len(first),
        "version": version(),
    }
    assert (own["first"], own["count"], own["carried_by"]) == (3, 1, None)
    assert [one["again"] for one in excursions] == [[], []]


def test_json_tells_of_files_that_held_what_was_known(tmp_path: Path) -> None:
    grid = fused(tmp_path, *reversed(team()))
    one, other = json.loads(run("info", grid, "--json").stdout)["excursions"]
    assert (one["robot"], one["parts"][0]["count"], other["again"]) == ("r2", 4, [])
    (again,) = one["again"]
    assert (again["count"], again["carried_by"], again["source"]) == (
        3,
        ["r1", "a"],
        str(tmp_path / "1.json"),
    )
    text = run("info", grid, "--excursions").stdout
    assert f"    4 from {tmp_path / '0.json'}\n" in text and "    3 from" not in text


def test_an_empty_grid_holds_nothing(tmp_path: Path) -> None:
    grid = fused(tmp_path, {**bumps("r1", "a"), "records": []})
    lines = run("info", grid, "--excursions").stdout.splitlines()
    assert lines[2] == "map         nothing, 0 tiles"
    assert lines[5] == "  r1 a: 0 records, its own along 0.0, across 0.0, turn_spread 0.0"
    found = json.loads(run("info", grid, "--json").stdout)
    assert (found["rows"], found["columns"], found["extent"], found["records"]) == (0, 0, None, 0)


def test_what_differs_from_the_paper_is_told_as_yaml_spells_it(tmp_path: Path) -> None:
    settings = ("--set", "free_along_walls=true", "--set", "robots.r1.drift=0.5")
    grid = fused(tmp_path, bumps("r1", "a"), settings=("--resolution", "0.1", *settings))
    line = run("info", grid).stdout.splitlines()[4]
    assert line == "settings    resolution 0.1, free_along_walls true, robots.r1.drift 0.5"


def test_one_of_a_thing_is_told_in_the_singular(tmp_path: Path) -> None:
    log = bumps("r1", "a", (1.01, 0.26))
    waiting = {**log, "records": log["records"][:1]}
    text = run("info", fused(tmp_path, waiting), "--excursions").stdout
    assert "evidence    1 record of 1 excursion by 1 robot\n" in text
    assert "  r1 a: 1 record, its own " in text
    folder = tmp_path / "more"
    folder.mkdir()
    assert ", 1 tile\n" in run("info", fused(folder, log)).stdout


def test_looking_changes_nothing(tmp_path: Path) -> None:
    grid = fused(tmp_path, *team())
    before = grid.read_bytes(), sorted(tmp_path.iterdir())
    assert run("info", grid).exit_code == 0
    assert (grid.read_bytes(), sorted(tmp_path.iterdir())) == before


def test_a_name_with_terminal_codes_is_shown_escaped(tmp_path: Path) -> None:
    folder = tmp_path / "red\x1b[31m\n"
    folder.mkdir()
    text = run("info", fused(folder, bumps("r1", "a"))).stdout
    assert "\x1b" not in text and r"red\x1b[31m\n" in text


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_poor_terminal_gets_the_text_too(encoding: str, tmp_path: Path) -> None:
    grid = fused(tmp_path, *team())
    result = subprocess.run(
        [sys.executable, "-c", "from possmap.cli.main import main; main()", "info", str(grid)],
        env={**os.environ, "PYTHONIOENCODING": encoding},
        capture_output=True,
        check=False,
    )
    assert result.stderr == b""
    assert b"digest " in result.stdout


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", EMPTY),
        (b"robot,excursion\n", "not a possmap grid"),
        (b"SQLite format 3\0", "not a possmap grid"),
    ],
)
def test_what_is_no_grid_is_refused(content: bytes, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "site.possmap"
    path.write_bytes(content)
    result = run("info", path)
    assert (result.stderr, result.stdout) == (f"possmap: {path}: {complaint}\n", "")
    assert result.exit_code == 1
    assert path.read_bytes() == content
