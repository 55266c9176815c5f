"""``--place``: a robot's own frame laid into the site's, as if its log had been written there."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main
from possmap.grid.grid import Grid

ROOT = Path(__file__).parents[2]
X, Y = 12.0, -3.0

pytestmark = pytest.mark.default_profile


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand beside the logs of a team of which r1 has a frame of its own: a quarter turn off."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "data/json", "there")
    Path("own").mkdir()
    for path in Path("there").iterdir():
        log = json.loads(path.read_text())
        Path("own", path.name).write_text(json.dumps(log))
        path.write_text(json.dumps({**laid(log), "carried": [laid(one) for one in log["carried"]]}))


def laid(log: Mapping[str, Any]) -> dict[str, Any]:
    """Return what r1 would have logged in the site's frame."""
    if log["robot"] != "r1":
        return dict(log)
    records = []
    for one in log["records"]:
        new = dict(one)
        for x, y in (("x", "y"), ("x2", "y2")):
            if x in one and one["kind"] != "fix":
                new[x], new[y] = X - one[y], Y + one[x]
        if one["kind"] == "pose":
            new["heading"] = one["heading"] + 90
            for name, other in (("error_x", "error_y"), ("error_y", "error_x")):
                if other in one:
                    new[name] = one[other]
        records.append(new)
    return {**log, "records": records}


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


PLACE = ("--place", f"r1={X},{Y},90")


def test_a_placed_robot_says_what_it_had_said_in_the_sites_frame() -> None:
    assert run("fuse", "own", "-g", "own.possmap", *PLACE).exit_code == 0
    assert run("fuse", "there", "-g", "there.possmap").exit_code == 0
    with Grid("own.possmap") as own, Grid("there.possmap") as there:
        assert own.window == there.window
        for view in ("necessity", "possibility", "points"):
            assert np.abs(own.view(view) - there.view(view)).max() < 1e-3
        assert own.digest() != there.digest(), "the ledger keeps what the robot said"
    assert run("verify", "own.possmap", "--full").exit_code == 0


def test_a_fix_stands_in_the_sites_frame_already() -> None:
    records = [
        {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 5, "y": 0, "heading": 0},
        {"seq": 2, "kind": "fix", "x": 12.0, "y": 2.1, "error_x": 0.01, "error_y": 0.01},
    ]
    log = {"possmap_log": 1, "robot": "r1", "excursion": "f", "records": records}
    Path("f.json").write_text(json.dumps(log))
    assert run("fuse", "f.json", "-g", "f.possmap", *PLACE).exit_code == 0
    with Grid("f.possmap") as grid:
        entry = grid.ledger.entry(("r1", "f"))
        assert entry is not None
        end = grid.ledger.geometry(entry)[1]
        assert (end.x, end.y) == pytest.approx((12.0, 2.1), abs=0.02)


def test_the_grid_keeps_the_place_and_takes_no_other() -> None:
    assert run("fuse", "own", "-g", "own.possmap", *PLACE).exit_code == 0
    assert run("fuse", "own", "-g", "own.possmap").stdout.count(" 4 known") == 1
    assert "robots.r1.frame_x 12.0" in run("info", "own.possmap").stdout
    other = run("fuse", "own", "-g", "own.possmap", "--place", "r1=12,-3,45")
    assert (other.exit_code, other.stderr) == (
        1,
        "possmap: --place: robots.r1.frame_heading, found 45, but in own.possmap robot r1 was "
        "placed with 90; to lay its logs anew: possmap fuse own.possmap -g NEW.possmap with this "
        "--place, and those of other robots\n",
    )
    assert run("fuse", "own", "-g", "own.possmap", "--place", "r9=1,2,3").exit_code == 0


def test_a_place_that_another_run_gave_meanwhile_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("fuse", "own", "-g", "own.possmap", *PLACE).exit_code == 0
    monkeypatch.setattr("possmap.fusing.fuse.check_file", lambda *_, **__: False)  # not there yet
    late = run("fuse", "own", "-g", "own.possmap", "--place", "r1=12,-3,45")
    assert late.exit_code == 1
    assert "in own.possmap robot r1 was placed with 90" in late.stderr


def test_a_log_that_says_where_it_lies_is_not_placed_elsewhere() -> None:
    for path in Path("own").iterdir():
        log = json.loads(path.read_text())
        if log["robot"] == "r1":
            path.write_text(json.dumps({**log, "model": {"frame_x": 5.0}, "carried": []}))
    result = run("fuse", "own", "-g", "own.possmap", "--place", "r1=4,0,0")
    assert result.exit_code == 1
    assert (
        "model.frame_x: found 5, where the host places robot r1 with 4 (--place); expected one of "
        "them, or the same\n"
    ) in result.stderr
    assert "2 refused" in result.stdout
    assert run("fuse", "own", "-g", "own.possmap", "--place", "r1=5,0,0").exit_code == 0


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("r1=1,2", "Invalid value for --place: 'r1=1,2', expected NAME=X,Y,DEG"),
        ("1,2,3", "Invalid value for --place: '1,2,3', expected NAME=X,Y,DEG"),
        ("r1=1,x,3", '--place: robots.r1.frame_y, found "x", expected a number within ±1e6'),
        ("r 1=1,2,3", '--place: robots, found "r 1", expected robots.NAME.PARAMETER'),
    ],
)
def test_what_is_no_place_is_refused(text: str, problem: str) -> None:
    result = run("fuse", "own", "-g", "own.possmap", "--place", text)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1] == f"Error: {problem}"
    assert not Path("own.possmap").exists()


def test_convert_writes_it_into_the_log() -> None:
    hall = ROOT / "data/recordings/hall.log"
    assert run("convert", hall, "-o", "hall.jsonl", "--place", "hall=12,-3,90").exit_code == 0
    head = json.loads(Path("hall.jsonl").read_text().splitlines()[0])
    assert head["model"] == {"frame_x": 12.0, "frame_y": -3.0, "frame_heading": 90.0}
    wrong = run("convert", hall, "-o", "a.jsonl", "--place", "hal=1,2,3")
    assert wrong.stderr == 'possmap: --place: found robot "hal", expected one of hall\n'
    lost = run("convert", hall, "-o", "a.csv", "--place", "hall=1,2,3")
    assert "a CSV holds no place (--place), expected .jsonl or a folder" in lost.stderr
    assert not Path("a.csv").exists()
