"""``possmap audit``: who contradicts the others, told line by line, and all that can be wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

import possmap.inspection.tallies
from possmap.cli.main import main

# Robots without errors on cells of 0.5 m. Honest ones drive along row 0, columns 0 to 9; the liar
# drives along row 4 and says that a wall stands all along row 0.
EXACT = {"along": 0, "across": 0, "turn_spread": 0}
Record = dict[str, Any]


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def drive(y: float, *seen: Record) -> list[Record]:
    records = [{"kind": "pose", "x": 0.2, "y": y, "heading": 0}, *seen]
    records += [{"kind": "pose", "x": 4.7, "y": y, "heading": 0}]
    return [{"seq": seq, **record} for seq, record in enumerate(records)]


HONEST = drive(0.2)
PATH_ONLY = drive(2.2)
LIE = [
    *PATH_ONLY,
    {"seq": 2, "kind": "wall", "x": 0.2, "y": 0.2, "x2": 4.7, "y2": 0.2},
    {"seq": 3, "kind": "pose", "x": 4.7, "y": 2.2, "heading": 0},
]


def log(robot: str, records: Sequence[Record], excursion: str = "a") -> dict[str, Any]:
    names = {"possmap_log": 1, "robot": robot, "excursion": excursion, "model": EXACT}
    return {**names, "records": list(records)}


def fused(folder: Path, *logs: dict[str, Any]) -> Path:
    paths = [folder / f"{number}.json" for number in range(len(logs))]
    for path, one in zip(paths, logs, strict=True):
        path.write_text(json.dumps(one))
    grid = folder / "site.possmap"
    assert run("fuse", *paths, "-g", grid, "--resolution", "0.5").exit_code == 0
    return grid


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return a grid of five honest robots and a liar."""
    honest = [log(f"r{number}", HONEST) for number in range(1, 6)]
    return fused(tmp_path, *honest, log("liar", LIE))


def test_a_liar_is_told_line_by_line(site: Path) -> None:
    result = run("audit", site, "--top", 2)
    assert (result.stderr, result.exit_code) == ("", 0)
    # An honest robot's others say both wall and free, and half of each is left: K is 1/2, and so
    # is what agrees, which counts half. The liar agrees with nobody on anything.
    assert result.stdout == (
        f"grid        {site}\n"
        "judged      6 of 6 robots, 6 of 6 excursions\n"
        "stands out  robot liar, excursion liar a\n"
        "robots       contradiction     above  compared    mean K  wall/free  free/wall"
        "  worst place\n"
        "  1  liar            1.000     !16.7     50.0%    1.0000     1.0000     0.0000"
        "  (0.250, 0.250) m\n"
        "  2  r1              0.667       0.0    100.0%    0.5000     0.0000     0.5000"
        "  (0.250, 0.250) m\n"
        "excursions   contradiction     above  compared    mean K  wall/free  free/wall"
        "  worst place\n"
        "  1  liar a          1.000     !16.7     50.0%    1.0000     1.0000     0.0000"
        "  (0.250, 0.250) m\n"
        "  2  r1 a            0.667       0.0    100.0%    0.5000     0.0000     0.5000"
        "  (0.250, 0.250) m\n"
    )


def test_json_tells_the_same_of_all(site: Path) -> None:
    found = json.loads(run("audit", site, "--json", "--top", 1).stdout)
    robots, excursions = found.pop("robots"), found.pop("excursions")
    assert found == {"grid": str(site), "resolution": 0.5}
    names = ["liar", "r1", "r2", "r3", "r4", "r5"]
    assert [one["robot"] for one in robots] == [one["robot"] for one in excursions] == names
    sure = pytest.approx(1, abs=1e-6)
    assert robots[0] == {
        "robot": "liar",
        "records": 4,
        "compared": 10,
        "share": 0.5,
        "contradiction": sure,
        "conflict": sure,
        "wall_free": sure,
        "free_wall": pytest.approx(0, abs=1e-6),
        "worst": {"x": 0.25, "y": 0.25, "conflict": sure},
        "judged": True,
        "above": pytest.approx(100 / 6, abs=1e-3),
        "stands_out": True,
    }
    assert {**robots[0], "excursion": "a"} == excursions[0]
    assert [one["stands_out"] for one in excursions[1:]] == [False] * 5


def test_who_shares_no_cells_with_others_is_not_judged(tmp_path: Path) -> None:
    few = [*drive(0.2)[:1], {"seq": 1, "kind": "pose", "x": 0.7, "y": 0.2, "heading": 0}]
    logs = [log("r1", HONEST), log("r2", HONEST), log("r3", few), log("r4", PATH_ONLY)]
    shown = run("audit", fused(tmp_path, *logs)).stdout
    assert "judged      2 of 4 robots, 2 of 4 excursions\n" in shown
    assert "stands out  cannot be said\n" in shown
    assert shown.endswith(
        "not judged, for others say too little of the same cells\n"
        "  r3 a: 2 cells compared, 100.0%\n"
        "  r4 a: 0 cells compared, 0.0%\n"
    )
    cut = run("audit", tmp_path / "site.possmap", "--top", 1).stdout
    assert cut.endswith("  r3 a: 2 cells compared, 100.0%\n  and 1 more\n")


def test_of_two_robots_neither_stands_out(tmp_path: Path) -> None:
    logs = [log("liar", LIE), *(log("r1", HONEST, f"x{number}") for number in range(6))]
    found = json.loads(run("audit", fused(tmp_path, *logs), "--json").stdout)
    told = [*found["robots"], *found["excursions"]]
    assert {(one["above"], one["stands_out"]) for one in told} == {(None, False)}
    assert found["robots"][0]["contradiction"] == found["robots"][1]["contradiction"]


def test_who_agrees_with_everybody_does_not_stand_out(tmp_path: Path) -> None:
    grid = fused(tmp_path, *(log(f"r{number}", HONEST) for number in range(6)))
    lines = run("audit", grid).stdout.splitlines()
    assert lines[2] == "stands out  nobody"
    assert re.fullmatch(
        r"  1  r0 +0\.000 +0\.0 +100\.0% +0\.0000 +0\.0000 +0\.0000  none", lines[4]
    )


def test_excursions_of_one_robot_are_judged_apart_and_together(tmp_path: Path) -> None:
    honest = [log(f"r{number}", HONEST) for number in range(1, 6)]
    grid = fused(tmp_path, *honest, log("both", LIE, "x"), log("both", HONEST, "y"))
    found = json.loads(run("audit", grid, "--json").stdout)
    first = found["excursions"][0]
    assert (first["robot"], first["excursion"], first["stands_out"]) == ("both", "x", True)
    both = next(one for one in found["robots"] if one["robot"] == "both")
    # Its own wall and its own path in the same cells: half of each, against free alone.
    assert both["records"] == 6
    assert both["wall_free"] == pytest.approx(0.5, abs=1e-6)


def test_a_window_is_audited_alone(site: Path) -> None:
    inside = json.loads(run("audit", site, "--json", "--window=0,0,2.5,0.5").stdout)
    assert [one["compared"] for one in inside["robots"]] == [5] * 6
    assert [one["share"] for one in inside["robots"]] == [1] * 6
    outside = run("audit", site, "--window=90,90,91,91")
    assert outside.stdout == (
        f"grid        {site}\njudged      0 of 0 robots, 0 of 0 excursions\n"
        "stands out  cannot be said\n"
    )


def test_an_empty_grid_has_nobody_to_judge(tmp_path: Path) -> None:
    shown = run("audit", fused(tmp_path, log("r1", []))).stdout
    assert "judged      0 of 1 robot, 0 of 1 excursion\n" in shown
    assert "  r1 a: 0 cells compared, 0.0%\n" in shown


def test_what_is_no_grid_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "fake.possmap"
    path.write_text("not a grid at all")
    result = run("audit", path)
    assert (result.stdout, result.exit_code) == ("", 1)
    assert result.stderr.startswith(f"possmap: {path}: not a possmap grid")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--window=1,1,0,0",), "expected X0 < X1 and Y0 < Y1"),
        (("--top=0",), "0 is not in the range x>=1"),
        (("--memory=1",), "found 1, expected at least "),
    ],
)
def test_wrong_options_are_wrong_usage(args: tuple[str, ...], message: str, site: Path) -> None:
    result = run("audit", site, *args)
    assert (result.stdout, result.exit_code) == ("", 2)
    assert message in result.stderr


def test_excursions_that_do_not_fit_are_refused_before_they_are_laid_out(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(possmap.inspection.tallies, "_RECORD_BYTES", 1 << 24)
    result = run("audit", site, "--memory", 256)
    assert (result.stdout, result.exit_code) == ("", 1)
    needed = re.fullmatch(
        f"possmap: {site}: laying out 14 records needs --memory ([0-9]+), found 256; "
        "or give a smaller --window\n",
        result.stderr,
    )
    assert needed
    assert run("audit", site, "--memory", needed[1]).exit_code == 0


def test_the_page_shows_what_the_command_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).parents[2]
    page = (root / "docs/audit.md").read_text(encoding="utf-8")
    (tmp_path / "data").symlink_to(root / "data")
    monkeypatch.chdir(tmp_path)
    block = re.findall(r"^```console\n(.*?)^```", page, re.MULTILINE | re.DOTALL)[0]
    parts = re.split(r"^\$ possmap ", block, flags=re.MULTILINE)[1:]
    assert len(parts) == 2
    for part in parts:
        command, _, output = part.partition("\n")
        assert run(*command.split()).stdout == output
