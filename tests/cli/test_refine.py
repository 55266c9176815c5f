"""``possmap refine``: exact words, and a new grid that says what it is and changes no more."""

from __future__ import annotations

import importlib.util
import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from houses import Leg, outing, write_logs

from possmap.cli.main import main
from possmap.core.records import PartialMap
from possmap.grid.grid import Grid

pytestmark = pytest.mark.default_profile

WALL = (2.0, 1.0, 4.0, 1.0)


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def straying(robot: str, strays: float) -> PartialMap:
    legs = [Leg(0.0, 4.0, strays, (WALL,)), Leg(180.0, 4.0, strays, (WALL,))]
    return outing(robot, "a", legs)


OUTINGS = (straying("r1", 1.5), straying("r2", -1.5), outing("r3", "a", [Leg(0.0, 2.0)]))


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with a grid of two robots that stray, and one that saw nothing."""
    monkeypatch.chdir(tmp_path)
    return fused(OUTINGS, Path("site.possmap"))


def fused(outings: Sequence[PartialMap], grid: Path, *options: object) -> Path:
    result = run("fuse", *write_logs(outings, Path("logs")), "-g", grid, *options)
    assert result.exit_code == 0, result.stderr
    return grid


def digest_of(grid: Path | str) -> str:
    with Grid(grid) as one:
        return one.digest()


def test_it_says_what_moved_and_who_was_left_alone(site: Path) -> None:
    result = run("refine", site, "-o", "refined.possmap")
    assert result.exit_code == 0
    assert result.stdout == (
        "refined.possmap: 1 wall, 4 of 4 sightings used, 0 ambiguous; 2 of 3 excursions moved\n"
        "robot      excursion        moved   most    ±before ±after  walls  off    left alone\n"
        "r1         a                0.055   0.079   0.098   0.065     2/2   0.10σ\n"
        "r2         a                0.055   0.079   0.098   0.065     2/2   0.10σ\n"
        "r3         a                0.000   0.000   0.028   0.028     0/0   0.00σ  few sightings\n"
    )


def test_json_has_all_of_it(site: Path) -> None:
    before = digest_of(site)
    told = json.loads(run("refine", site, "-o", "refined.possmap", "--json").stdout)
    assert told["made_of"] == before == digest_of(site)
    assert told["digest"] == digest_of("refined.possmap") != before
    assert (told["sightings"], told["used"], told["ambiguous"]) == (4, 4, 0)
    (wall,) = told["walls"]
    assert wall["line"] == pytest.approx(WALL, abs=0.05)
    assert (wall["sightings"], wall["excursions"]) == (4, 2)
    assert [one["alone"] for one in told["excursions"]] == ["", "", "few sightings"]
    assert told["rivals"] == []


def test_the_order_of_arrival_does_not_change_the_digest(site: Path) -> None:
    run("refine", site, "-o", "refined.possmap")
    for number, order in enumerate(permutations(OUTINGS)):
        grid = fused(order, Path(f"{number}.possmap"))
        run("refine", grid, "-o", f"{number}-refined.possmap")
        assert digest_of(f"{number}-refined.possmap") == digest_of("refined.possmap")


def test_the_new_grid_says_what_it_was_made_of(site: Path) -> None:
    run("refine", site, "-o", "refined.possmap")
    made_of = digest_of(site)
    assert f"refined     of a grid of digest {made_of}\n" in run("info", "refined.possmap").stdout
    told = json.loads(run("info", "refined.possmap", "--json").stdout)
    assert told["refined"] == {"made_of": made_of, "robots": []}
    assert json.loads(run("info", site, "--json").stdout)["refined"] is None
    assert run("export", "refined.possmap", "-o", "map.geojson").exit_code == 0
    told = json.loads(Path("map.geojson").read_text())["possmap"]
    assert told["refined"] == f"from the grid of digest {made_of}"
    assert run("render", "refined.possmap", "-o", "map.png").exit_code == 0
    assert made_of.encode() in Path("map.png").read_bytes()


def test_it_takes_no_logs_and_gives_nothing_away(site: Path) -> None:
    run("refine", site, "-o", "refined.possmap")
    before = Path("refined.possmap").read_bytes()
    start = "possmap: refined.possmap: is refined, and is not changed; "
    end = f" the grid that it was made of (digest {digest_of(site)[:9]}...), and refine that anew\n"
    for command, what in (
        (("fuse", "logs/r1-a.json", "-g", "refined.possmap"), "fuse further logs into"),
        (("fuse", "logs", "-g", "refined.possmap", "--dry-run"), "fuse further logs into"),
        (("forget", "refined.possmap", "--robot", "r1"), "forget it in"),
        (("repair", "refined.possmap", "-o", "new.possmap"), "repair"),
        (("refine", "refined.possmap", "-o", "new.possmap"), "fuse into"),
    ):
        result = run(*command)
        assert (result.exit_code, result.stderr) == (1, f"{start}{what}{end}")
    assert Path("refined.possmap").read_bytes() == before
    assert not list(Path().glob("*new.possmap*"))


def test_its_ledger_is_as_logged(site: Path) -> None:
    """Fused into another grid it gives what the logs give."""
    run("refine", site, "-o", "refined.possmap")
    run("fuse", "refined.possmap", "-g", "again.possmap")
    assert digest_of("again.possmap") == digest_of(site)


@pytest.mark.parametrize("full", [(), ("--full",)])
def test_verify_refines_again(site: Path, full: tuple[str, ...]) -> None:
    run("refine", site, "-o", "refined.possmap")
    assert run("verify", "refined.possmap", *full).exit_code == 0
    with closing(sqlite3.connect("refined.possmap")) as file, file:
        (track,) = file.execute("SELECT track FROM refined WHERE excursion = 1").fetchone()
        rows = np.frombuffer(track, "<f8").reshape(-1, 6).copy()
        rows[-1, 0] += 0.001
        file.execute("UPDATE refined SET track = ? WHERE excursion = 1", (rows.tobytes(),))
    result = run("verify", "refined.possmap", *full)
    assert result.exit_code == 1
    assert (
        "excursion a of robot r1: its refined track is not what its ledger's records make\n"
        in result.stdout + result.stderr
    )


def test_a_track_of_nonsense_is_damage(site: Path) -> None:
    run("refine", site, "-o", "refined.possmap")
    with closing(sqlite3.connect("refined.possmap")) as file, file:
        file.execute("UPDATE refined SET track = x'00' WHERE excursion = 1")
    result = run("query", "refined.possmap", 3, 1)
    assert (result.exit_code, result.stderr) == (
        1,
        "possmap: refined.possmap: damaged: excursion number 1: its refined track\n",
    )


def test_a_selection_of_a_refined_grid_is_refined(site: Path) -> None:
    run("refine", site, "-o", "refined.possmap")
    assert run("audit", "refined.possmap").exit_code == 0
    result = run("render", "refined.possmap", "-o", "one.png", "--robots", "r1")
    assert result.exit_code == 0


def test_robots_names_whose_tracks_may_move(site: Path) -> None:
    result = run("refine", site, "-o", "refined.possmap", "--robots", "r1", "--json")
    told = json.loads(result.stdout)
    assert [one["alone"] for one in told["excursions"]] == ["", "not asked for", "not asked for"]
    assert run("verify", "refined.possmap").exit_code == 0


def refused(*args: object) -> str:
    result = run("refine", *args, "-o", "new.possmap")
    assert result.exit_code == 1
    assert not list(Path().glob("*new.possmap*"))
    return result.stderr


def test_what_cannot_be_refined_is_refused_in_one_line(site: Path) -> None:
    paper = fused(OUTINGS, Path("paper.possmap"), "--profile", "paper")
    assert refused(paper) == (
        "possmap: paper.possmap: estimator linear, expected estimator walls; fuse its ledger into "
        "a new grid: possmap fuse paper.possmap -g NEW.possmap --profile robust\n"
    )
    slanted = fused(OUTINGS, Path("slanted.possmap"), "--set", "orthogonal=false")
    assert refused(slanted) == (
        "possmap: slanted.possmap: orthogonal: false, expected orthogonal: true; fuse its ledger "
        "into a new grid: possmap fuse slanted.possmap -g NEW.possmap --profile robust\n"
    )
    blind = fused([OUTINGS[2]], Path("blind.possmap"))
    assert refused(blind) == (
        "possmap: blind.possmap: holds no piece of wall that tells how it stands\n"
    )
    assert refused(site, "--robots", "rob1") == (
        'possmap: site.possmap: knows no robot rob1, did you mean "r1"?\n'
    )
    log = Path("logs/r1-a.json")
    assert refused(log) == "possmap: logs/r1-a.json: not a possmap grid\n"


def test_nothing_is_overwritten_without_being_asked(site: Path) -> None:
    Path("there.possmap").write_text("mine")
    result = run("refine", site, "-o", "there.possmap")
    assert (result.exit_code, result.stderr) == (
        1,
        "possmap: there.possmap: exists already; --overwrite replaces it\n",
    )
    result = run("refine", site, "-o", site, "--overwrite")
    assert result.stderr == "possmap: site.possmap: would replace itself, expected another -o\n"
    assert Path("there.possmap").read_text() == "mine"


def test_a_ledger_that_does_not_fit_into_memory_is_refused(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("possmap.fusing.refine._RECORD_BYTES", 1 << 30)
    assert refused(site) == ("possmap: site.possmap: 14 records needs --memory 19171, found 1024\n")


def test_without_its_extra_it_says_so(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert refused(site) == (
        "possmap: possmap refine needs the extra refine: pip install 'possmap[refine]'\n"
    )
