"""``possmap audit``: who contradicts the others, told line by line, and all that can be wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from commands import fused as fused_under
from commands import run

# Robots without errors on cells of 0.5 m. Honest ones drive along row 0, columns 0 to 9; the liar
# drives along row 4 and says that a wall stands all along row 0.
EXACT = {"along": 0, "across": 0, "turn_spread": 0}
Record = dict[str, Any]


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
    options = ("--resolution", "0.5", "--profile", "paper")
    return fused_under(folder / "site.possmap", *logs, options=options)


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return a grid of five honest robots and a liar."""
    honest = [log(f"r{number}", HONEST) for number in range(1, 6)]
    return fused(tmp_path, *honest, log("liar", LIE))


def test_a_liar_is_told_line_by_line(site: Path) -> None:
    result = run("audit", site, "--top", 2)
    assert (result.stderr, result.exit_code) == ("", 0)
    # An honest robot's others say both wall and free; the liar agrees with nobody on anything.
    lines = result.stdout.splitlines()
    assert lines[:4] == [
        f"grid        {site}",
        "judged      6 of 6 robots, 6 of 6 excursions",
        "stands out  robot liar since a (contradicts the others); "
        "excursion liar a (contradicts the others)",
        "robots       contradiction     above  compared    mean K     walls  outliers  surprise"
        "    strays  worst place",
    ]
    assert re.fullmatch(
        r"  1  liar +1\.000 +![0-9.]+ +50\.0% +1\.0000 +0 +0 +0\.0 +0\.0°  \(0\.250, 0\.250\) m",
        lines[4],
    )
    assert lines[5].startswith("  2  r1 ") and "!" not in lines[5]
    assert lines[7].startswith("  1  liar a ") and lines[8].startswith("  2  r1 a ")
    assert len(lines) == 9


def test_json_tells_the_same_of_all(site: Path) -> None:
    found = json.loads(run("audit", site, "--json", "--top", 1).stdout)
    robots, excursions = found.pop("robots"), found.pop("excursions")
    assert found == {"grid": str(site), "resolution": 0.5}
    names = ["liar", "r1", "r2", "r3", "r4", "r5"]
    assert [one["robot"] for one in robots] == [one["robot"] for one in excursions] == names
    sure = pytest.approx(1, abs=1e-6)
    above = robots[0].pop("above")
    assert above > 6
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
        "told": {
            "observed": 0, "seen": 0, "outliers": 0, "surprise": 0.0, "overturn_deg": 0.0,
            "stray_deg": 0.0, "fixes": 0, "surprising": 0,
        },
        "judged": True,
        "stands_out": True,
        "reasons": ["contradicts the others"],
        "since": "a",
    }  # fmt: skip
    assert [one["stands_out"] for one in excursions] == [True] + [False] * 5


def test_who_shares_no_cells_with_others_is_not_judged(tmp_path: Path) -> None:
    few = [*drive(0.2)[:1], {"seq": 1, "kind": "pose", "x": 0.7, "y": 0.2, "heading": 0}]
    logs = [log("r1", HONEST), log("r2", HONEST), log("r3", few), log("r4", PATH_ONLY)]
    shown = run("audit", fused(tmp_path, *logs)).stdout
    assert "judged      2 of 4 robots, 2 of 4 excursions\n" in shown
    assert "stands out  cannot be said\n" in shown
    assert shown.endswith(
        "not compared, for others say too little of the same cells\n"
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


def test_who_agrees_with_everybody_does_not_stand_out(tmp_path: Path) -> None:
    grid = fused(tmp_path, *(log(f"r{number}", HONEST) for number in range(6)))
    lines = run("audit", grid).stdout.splitlines()
    assert lines[2] == "stands out  nobody"
    assert re.fullmatch(
        r"  1  r0 +0\.000 +0\.0 +100\.0% +0\.0000 +0 +0 +0\.0 +0\.0°  none", lines[4]
    )


def test_some_robots_are_audited_alone(site: Path) -> None:
    found = json.loads(run("audit", site, "--json", "--robots", "r1", "--robots", "r2").stdout)
    assert [one["robot"] for one in found["robots"]] == ["r1", "r2"]
    assert [one["contradiction"] for one in found["robots"]] == [0, 0]


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


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--window=1,1,0,0",), "expected X0 < X1 and Y0 < Y1"),
        (("--top=0",), "0 is not in the range x>=1"),
        (("--last=0",), "0 is not in the range x>=1"),
    ],
)
def test_wrong_options_are_wrong_usage(args: tuple[str, ...], message: str, site: Path) -> None:
    result = run("audit", site, *args)
    assert (result.stdout, result.exit_code) == ("", 2)
    assert message in result.stderr


@pytest.mark.default_profile
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
