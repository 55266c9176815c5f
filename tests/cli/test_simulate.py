"""``possmap simulate``: what it writes and prints, and everything that can be wrong with it."""

from __future__ import annotations

import json
import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from possmap.cli.main import main

pytestmark = pytest.mark.default_profile

ROOT = Path(__file__).parents[2]
WALLS = "[[0, 0, 6, 0], [6, 0, 6, 4], [0, 4, 6, 4], [0, 0, 0, 4]]"
TINY = f"""robots: 1
minutes: 0.5
seed: 3
world:
  walls: {WALLS}
  home: [3, 2]
"""
NUMBER = r" +\d+(?:\.\d+)?"


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


@pytest.fixture
def mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a mission of half a minute, and stand in its folder."""
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(TINY)
    return Path("tiny.yaml")


def everything(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def refused(result: Result, code: int = 1) -> str:
    """Return what a refusal says, after checking that it is one line."""
    assert (result.stdout, result.exit_code) == ("", code)
    if code == 1:
        assert result.stderr.startswith("possmap: ") and result.stderr.count("\n") == 1
        return result.stderr.removeprefix("possmap: ").removesuffix("\n")
    return result.stderr.splitlines()[-1].removeprefix("Error: ")


def test_a_mission_becomes_logs_truth_and_a_table(mission: Path) -> None:
    result = run("simulate", mission, "-o", "out")
    assert (result.stderr, result.exit_code) == ("", 0)
    head, row, total, files = result.stdout.splitlines()
    assert head == "excursion fate      min   run m  far m  records  known"
    assert re.fullmatch(f"r1-01     home  (?:{NUMBER}){{5}}", row)
    assert re.fullmatch(
        r"1 of 1 excursions came home; 0 meetings; of the lost the host knows 0 records; "
        r"\d+% of the walls explored",
        total,
    )
    assert files.startswith("out: 1 log")
    assert sorted(everything(Path("out"))) == [
        "logs/001-r1-01.json", "summary.json", "truth.json"
    ]  # fmt: skip


def test_logs_sort_by_return_and_fuse(mission: Path) -> None:
    run("simulate", mission, "-o", "out", "--robots", 3, "--set", "minutes=1")
    told = json.loads(Path("out/summary.json").read_text())["excursions"]
    home = [one["excursion"] for one in told if one["fate"] == "home"]
    names = [f"{number:03d}-{one}.json" for number, one in enumerate(home, 1)]
    assert sorted(path.name for path in Path("out/logs").iterdir()) == names
    assert len(names) > 1
    assert run("check", "out/logs").exit_code == 0
    fused = run("fuse", "out/logs", "-g", "site.possmap", "--strict", "--json")
    assert {log["status"] for log in json.loads(fused.stdout)["logs"]} <= {"fused", "known"}
    drawn = run("render", "site.possmap", "-o", "m.png", "--truth", "out/truth.json", "--tracks")
    assert drawn.exit_code == 0


def test_the_truth_file_says_what_truly_happened(mission: Path) -> None:
    run("simulate", mission, "-o", "out", "--robots", 2)
    truth = json.loads(Path("out/truth.json").read_text())
    assert list(truth) == ["possmap_truth", "walls", "home", "robots", "meetings"]
    assert truth["possmap_truth"] == 1
    assert truth["home"] == [3, 2]
    assert sorted(truth["walls"]) == [[0, 0, 0, 4], [0, 0, 6, 0], [0, 4, 6, 4], [6, 0, 6, 4]]
    for one in truth["robots"]:
        assert list(one) == ["robot", "excursion", "fate", "why", "track"]
        assert one["fate"] in ("home", "lost")
        assert all(len(row) == 7 for row in one["track"])
        assert one["track"][0][1:3] == [3, 2]
    for time, robot, peer, given, taken in truth["meetings"]:
        assert time >= 0 and {robot, peer} == {"r1", "r2"}
        assert given >= 0 and taken >= 0


def test_json_is_the_summary(mission: Path) -> None:
    result = run("simulate", mission, "-o", "out", "--json", "--robots", 2)
    told: dict[str, Any] = json.loads(result.stdout)
    assert told == json.loads(Path("out/summary.json").read_text())
    assert list(told) == [
        "excursions", "home", "lost", "meetings", "records_known_of_lost", "explored"
    ]  # fmt: skip
    assert list(told["excursions"][0]) == [
        "robot", "excursion", "fate", "why", "minutes", "distance", "farthest", "records", "known"
    ]  # fmt: skip
    assert told["home"] + told["lost"] == len(told["excursions"]) == 2


def test_one_seed_is_one_set_of_bytes_wherever_it_is_written(mission: Path) -> None:
    args = ("--robots", 3, "--set", "minutes=4", "--json")
    here = run("simulate", mission, "-o", "here", *args)
    Path("far").mkdir()
    Path("far/other.yaml").write_text(TINY)
    there = run("simulate", "far/other.yaml", "-o", "far/away/there", *args)
    assert here.stdout == there.stdout
    assert everything(Path("here")) == everything(Path("far/away/there"))
    assert not any(b"tiny" in text or b"/" in text for text in everything(Path("here")).values())
    other = run("simulate", mission, "-o", "third", *args, "--seed", 4)
    assert other.stdout != here.stdout


def test_options_beat_the_file_and_set_beats_them(mission: Path) -> None:
    def excursions(*args: object) -> list[str]:
        result = run("simulate", mission, "-o", "out", "--overwrite", "--json", *args)
        return [one["robot"] for one in json.loads(result.stdout)["excursions"]]

    assert sorted(excursions()) == ["r1"]
    assert sorted(excursions("--robots", 2)) == ["r1", "r2"]
    assert sorted(excursions("--robots", 2, "--set", "robots=3")) == ["r1", "r2", "r3"]
    by_option = run("simulate", mission, "-o", "a", "--seed", 9, "--json").stdout
    assert by_option == run("simulate", mission, "-o", "b", "--set", "seed=9", "--json").stdout


def test_raw_readings_are_added_on_request(mission: Path) -> None:
    run("simulate", mission, "-o", "out", "--set", "log_ir=true")
    log = json.loads(Path("out/logs/001-r1-01.json").read_text())
    poses = [record for record in log["records"] if record["kind"] == "pose"]
    assert all(len(pose["x_ir"]) == 5 for pose in poses)
    plain = run("simulate", mission, "-o", "plain")
    assert plain.exit_code == 0
    without = json.loads(Path("plain/logs/001-r1-01.json").read_text())
    assert all("x_ir" not in record for record in without["records"])
    assert run("check", "out/logs").exit_code == 0


def test_the_picture_shows_the_world(mission: Path) -> None:
    assert run("simulate", mission, "-o", "out", "--picture", "world.png").exit_code == 0
    with Image.open("world.png") as image:
        assert image.width > 100 and image.height > 100
        assert len(image.convert("RGB").getcolors(10**6) or []) > 3
    again = run("simulate", mission, "-o", "out2", "--picture", "world.png")
    assert refused(again) == "world.png: exists already; --overwrite replaces it"


def test_a_folder_that_holds_something_is_kept(mission: Path) -> None:
    Path("out").mkdir()
    assert run("simulate", mission, "-o", "out").exit_code == 0, "an empty one is none"
    before = everything(Path("out"))
    result = run("simulate", mission, "-o", "out", "--seed", 5)
    assert refused(result) == "out: holds something already; --overwrite replaces it"
    assert everything(Path("out")) == before
    assert run("simulate", mission, "-o", "out", "--seed", 5, "--overwrite").exit_code == 0
    assert everything(Path("out")) != before
    assert refused(run("simulate", mission, "-o", "tiny.yaml")) == (
        "tiny.yaml: is no folder, expected one to be made"
    )
    assert mission.read_text() == TINY


@pytest.mark.parametrize(
    ("args", "code", "problem"),
    [
        (["--set", "robts=3"], 1, '--set: unknown key "robts", did you mean "robots"?'),
        (["--set", "speed=-1"], 1, '--set: speed, found "-1", expected a number > 0'),
        (["--set", "radio_loss=2"], 1, '--set: radio_loss, found "2", expected a number, 0 to 1'),
        (["--set", "behaviours=brave-left"], 1, '--set: behaviours, found "brave-left", expected'),
        (["--set", "robots"], 2, "Invalid value for --set: 'robots', expected KEY=VALUE"),
        (["--robots", "0"], 2, "Invalid value for '--robots': 0 is not in the range x>=1."),
        (["--seed", "-1"], 2, "Invalid value for '--seed': -1 is not in the range x>=0."),
        (["--set", "world.home=3,3.9999"], 1, "--set: world.home, found [3, 3.9999], 0.00 m fro"),
    ],
)
def test_a_wrong_option_is_one_clear_line(
    mission: Path, args: list[str], code: int, problem: str
) -> None:
    assert refused(run("simulate", mission, "-o", "out", *args), code).startswith(problem)


def test_poses_say_whether_the_robot_turned_or_set_its_belief_anew(tmp_path: Path) -> None:
    assert run("simulate", "lonely", "-o", tmp_path / "out", "--set", "minutes=4").exit_code == 0
    told = set()
    for path in (tmp_path / "out" / "logs").iterdir():
        log = json.loads(path.read_text())
        poses = [record for record in log["records"] if record["kind"] == "pose"]
        for before, pose in pairwise(poses):
            same_place = (before["x"], before["y"]) == (pose["x"], pose["y"])
            assert ("turned" in pose) == (before["heading"] != pose["heading"])
            assert same_place or "turned" not in pose
            told.add(pose.get("turned"))
        assert log["model"]["sensor"] == 0.03 and log["model"]["turn_noise"] == 0.671
    assert told == {True, False, None}


def test_a_missing_mission_or_folder_is_wrong_usage(mission: Path) -> None:
    for name, guess in (("none.yaml", "possmap ships drops, figure8"), ("figur8", "did you mean")):
        told = refused(run("simulate", name, "-o", "out"), 2)
        assert f'"{name}" is neither a file nor shipped' in told and guess in told
    assert refused(run("simulate", mission), 2) == "Missing option '-o' / '--output'."
    Path("file").write_text("")
    told = refused(run("simulate", mission, "-o", "file/out"))
    assert told.startswith("file/out: cannot be written: ")


def test_the_example_of_the_help_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = run("simulate", "--help").stdout
    example = told.rpartition("Example: ")[2].strip()
    monkeypatch.chdir(ROOT)
    program, *args = shlex.split(example)
    args[args.index("-o") + 1] = str(tmp_path / "out")
    assert program == "possmap"
    assert run(*args).exit_code == 0
    assert (tmp_path / "out" / "truth.json").exists()


@pytest.mark.parametrize("folder", ["out", "."])
def test_overwrite_leaves_what_simulate_never_wrote(mission: Path, folder: str) -> None:
    Path(folder).mkdir(exist_ok=True)
    Path(folder, "thesis.txt").write_text("three years")
    run("simulate", mission, "-o", folder, "--overwrite")
    assert Path(folder, "thesis.txt").exists()


def test_nothing_is_left_behind_by_a_refusal(mission: Path) -> None:
    run("simulate", mission, "-o", "out", "--set", "speed=-1")
    run("simulate", mission, "-o", "out", "--robots", 0)
    assert [path.name for path in Path().iterdir()] == ["tiny.yaml"]
