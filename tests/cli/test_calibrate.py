"""``possmap calibrate``: from trials to a model that fuse takes, and what is refused on the way."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result

from possmap.cli.main import main
from possmap.lab.calibrate.trials_file import read_trials
from possmap.settings.settings_yaml import read_settings

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared/realdata"
TRIALS = ROOT / "data/trials.csv"

TRUE = {
    "r1": {"turn_bias": 2.1, "drift": 0.0, "scale": 1.0},
    "r2": {"turn_bias": -1.7, "drift": 0.4, "scale": 1.0},
    "r3": {"turn_bias": 2.3, "drift": 0.0, "scale": 0.985},
}
"""What data/trials_recipe.py did to its robots."""


def calibrate(*args: object) -> Result:
    words = ["calibrate", *(str(arg) for arg in args)]
    return CliRunner().invoke(main, words, catch_exceptions=False)


def found(*args: object) -> dict[str, object]:
    result = calibrate(*args, "--json")
    assert result.exit_code == 0, result.output
    told: dict[str, object] = json.loads(result.stdout)
    return told


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the shipped trials' model, picture and JSON."""
    folder = tmp_path_factory.mktemp("example")
    told = found(TRIALS, "-o", folder / "model.yaml", "--picture", folder / "report.png")
    (folder / "told.json").write_text(json.dumps(told))
    return folder


def test_the_example_gives_models_that_hold_the_truth(example: Path) -> None:
    robots = json.loads((example / "told.json").read_text())["robots"]
    assert robots.keys() == TRUE.keys()
    missed = 0
    for robot, faults in TRUE.items():
        every = {**faults, "turn_gain": 0.0, "along": 1.25 / 120, "across": 5.5 / 120}
        for name, value in every.items():
            limits = robots[robot]["estimates"][name]
            missed += not limits["low"] <= value <= limits["high"]
    assert missed <= 2, "of eighteen limits one misses now and then"
    assert robots["r1"]["factor"] == pytest.approx(2.294, abs=1e-3)
    assert robots["r2"]["held_out"]["without"]["drift"]["earned"]
    assert robots["r3"]["held_out"]["without"]["scale"]["earned"]


def test_the_recipe_makes_the_shipped_trials(tmp_path: Path) -> None:
    made = tmp_path / "trials.csv"
    subprocess.run([sys.executable, ROOT / "data/trials_recipe.py", made], check=True)
    assert made.read_bytes() == TRIALS.read_bytes()


def test_fuse_takes_the_model(example: Path, tmp_path: Path) -> None:
    model = example / "model.yaml"
    assert read_settings(model)["robots.r2.drift"].value == pytest.approx(0.44, abs=0.05)
    assert yaml.safe_load(model.read_text())["robots"].keys() == TRUE.keys()
    words = ["fuse", ROOT / "data/json", "-g", tmp_path / "g.possmap", "--config", model]
    result = CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0 and "fused 4 logs" in result.output


def test_the_text_says_what_every_number_is(tmp_path: Path) -> None:
    rows = [row for row in TRIALS.read_text().splitlines() if not row.startswith("r3")]
    (tmp_path / "two.csv").write_text("\n".join(rows) + "\n")
    result = calibrate(tmp_path / "two.csv", "-o", tmp_path / "model.yaml")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.splitlines()[0].startswith("r1: 80 trials, 80 with a run, 40 with a turn")
    for words in ("95 % limits", "Lilliefors", "would find", "earns its place", "held-out ends",
                  "all together: 160 trials", "written"):  # fmt: skip
        assert words in result.stdout


def test_a_picture_is_drawn_and_nothing_is_overwritten_unasked(example: Path) -> None:
    from PIL import Image

    with Image.open(example / "report.png") as drawn:
        assert drawn.width > 1000 and len(np.unique(np.asarray(drawn))) > 50
    model = example / "model.yaml"
    again = calibrate(TRIALS, "-o", model)
    assert again.exit_code == 1
    assert again.stderr == f"possmap: {model}: exists already; --overwrite replaces it\n"


HEAD = "robot,manoeuvre,distance,turn,along,across,heading\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "bad.csv: is empty, expected a header with robot, distance, turn, along, across"),
        (HEAD, "bad.csv: holds no trials below its header"),
        ("robot,distance,turn,along\n", "bad.csv:1: column across is missing"),
        ("robot,distance,trun,along,across\n", 'column "trun" is unknown, did you mean "turn"?'),
        ("robot,distance,turn,along,across,end_along\n", "column along is given twice"),
        (HEAD + "r1,a,3,0,x,0.1,0\n", 'bad.csv:2: along, found "x", expected a number within ±1e6'),
        (HEAD + "r1,a,3,0,nan,0.1,0\n", 'bad.csv:2: along, found "nan", expected a number'),
        (HEAD + "r1,a,-3,0,0.1,0.1,0\n", "bad.csv:2: distance, found -3, expected metres >= 0"),
        (HEAD + "r1,a,3,0,0.1,,0\n", "bad.csv:2: across, found nothing, expected both"),
        (HEAD + "r1,a,0,90,,,\n", "bad.csv:2: found no error at all"),
        (HEAD + "r1,a,3,0,12.0,55.0,0\n", "bad.csv:2: along and across, found 12 and 55"),
        (HEAD + "r 1,a,3,0,0.1,0.1,0\n", 'bad.csv:2: robot, found "r 1", expected 1 to 64'),
        (HEAD + "r1,a,3,0,0.1\n", "bad.csv:2: found 5 fields, expected 7"),
        (HEAD + "r1,a,3,0,0.1,0.2,0\n", "r1: found 1 runs and 0 turns, expected at least 3"),
        (HEAD + 9 * "r1,a,3,0,0.1,0.2,0\n", "bad.csv: r1: along, found no variance in 9 trials"),
    ],
)  # fmt: skip
def test_bad_trials_are_refused_with_file_and_line(tmp_path: Path, text: str, words: str) -> None:
    bad, model = tmp_path / "bad.csv", tmp_path / "model.yaml"
    bad.write_text(text, encoding="utf-8")
    result = calibrate(bad, "-o", model)
    assert result.exit_code == 1 and len(result.stderr.splitlines()) == 1
    assert words in result.stderr
    assert not model.exists(), "nothing is half written"


def test_columns_may_carry_their_units(tmp_path: Path) -> None:
    own = tmp_path / "own.csv"
    _, rest = TRIALS.read_text().split("\n", 1)
    own.write_text(
        "\ufeffrobot,maneuver,asked_distance_m,asked_turn_deg,end_error_along_m,"
        "end_error_across_m,heading_error_deg\n" + rest
    )
    plain, named = read_trials(TRIALS), read_trials(own)
    assert [replace(one, place="", outing="") for one in plain] == [
        replace(one, place="", outing="") for one in named
    ]


def test_a_robot_of_two_geometries_is_two_robots(tmp_path: Path) -> None:
    own = tmp_path / "own.csv"
    lines = TRIALS.read_text().splitlines()
    rows = [f"{line},{'wide' if k % 2 else 'narrow'}" for k, line in enumerate(lines[1:81])]
    own.write_text("\n".join([f"{lines[0]},geometry", *rows]) + "\n")
    told = found(own, "-o", tmp_path / "model.yaml")
    assert isinstance(told["robots"], dict)
    assert list(told["robots"]) == ["r1:narrow", "r1:wide"]


def test_a_robot_that_cannot_be_calibrated_leaves_the_others_theirs(tmp_path: Path) -> None:
    own, model = tmp_path / "own.csv", tmp_path / "model.yaml"
    own.write_text(
        "\n".join(TRIALS.read_text().splitlines()[:81]) + "\n" + 5 * "r9,straight,3,0,0.1,0.1,0\n"
    )
    result = calibrate(own, "-o", model)
    assert result.exit_code == 1
    assert result.stderr.startswith("possmap: r9: along, found no variance in 5 trials")
    assert list(yaml.safe_load(model.read_text())["robots"]) == ["r1"]


@pytest.mark.thorough
def test_a_simulated_team_is_calibrated_from_its_logs_and_truth(tmp_path: Path) -> None:
    words = ["simulate", ROOT / "configs/missions/office.yaml", "-o", tmp_path / "team",
             "--seed", 3, "--set", "minutes=8", "--set", "drift=0.4"]  # fmt: skip
    assert CliRunner().invoke(main, [str(word) for word in words]).exit_code == 0
    told = found(tmp_path / "team", "-o", tmp_path / "model.yaml")
    robots = told["robots"]
    assert isinstance(robots, dict) and robots
    for robot in robots.values():
        own = robot["estimates"]
        assert 1.5 < abs(own["turn_bias"]["value"]) < 3
        assert (
            own["across"]["low"] <= 5.5 / 120 * 1.05 and own["across"]["high"] >= 5.5 / 120 * 0.95
        )
        assert 0 < own["sensor"]["model"] < 0.02
        assert own["alignment_spread"]["value"] == 0.0
        # The truth of a simulation has no noise that could be taken back.
        assert not any(name.startswith("stays_") for name in robot["left_over"])
        for name in ("along", "across"):
            assert own[name]["low"] <= own[name]["value"] <= robot["model"][name]


@pytest.mark.parametrize(
    ("args", "status", "words"),
    [
        (["--mapping", "intel-json"], 2, "recordings need a truth"),
        (["--robot", "r 1"], 2, "expected 1 to 64 characters"),
        (["--legs", "a"], 2, "expected metres parted by commas"),
        (["--start-error", "1,2"], 2, "expected X,Y,DEG"),
        (["--picture", "out.jpg"], 1, "out.jpg: expected a name that ends in .png"),
        (["--mapping", "nothing", "--truth-mapping", "intel-json"], 1, "nothing"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(
    tmp_path: Path, args: list[str], status: int, words: str
) -> None:
    result = calibrate(TRIALS, "-o", tmp_path / "model.yaml", *args)
    assert result.exit_code == status and words in result.stderr


def test_what_is_no_input_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for path, words in (
        (tmp_path / "empty", "is a folder without truth.json"),
        (ROOT / "data/truth.json", "expected trials (.csv), a folder of possmap simulate"),
    ):
        result = calibrate(path, "-o", tmp_path / "model.yaml")
        assert result.exit_code == 1 and words in result.stderr
    result = calibrate(TRIALS, "-o", tmp_path / "model.json")
    assert result.exit_code == 1 and "expected a name that ends in .yaml" in result.stderr


def test_without_scipy_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name, package=None: None)
    result = calibrate(TRIALS, "-o", tmp_path / "model.yaml")
    assert result.exit_code == 1
    assert (
        "possmap calibrate needs the extra calibrate: pip install 'possmap[calibrate]'"
        in result.stderr
    )


def recording(path: Path, jump: float = 0.0) -> None:
    """Write a recording of odometry and truth that drives squares; the truth may jump once."""
    rng = np.random.default_rng(2)
    t, x, y, heading = 0.0, 0.0, 0.0, 0.0
    tx, ty, true = 1.0, 2.0, 0.5
    rows = []
    for k in range(48):
        kick, stretch = 0.02 * rng.standard_normal(), 1 + 0.01 * rng.standard_normal()
        true += kick
        for _ in range(10 + k % 7):
            x, y = x + 0.2 * np.cos(heading), y + 0.2 * np.sin(heading)
            tx, ty = tx + 0.2 * stretch * np.cos(true), ty + 0.2 * stretch * np.sin(true)
            true += np.radians(0.8) * 0.2
            t += 0.1
            rows.append((t, x, y, heading, tx, ty, true))
        for _ in range(9):
            side = 1 if k % 3 else -1
            heading, true = heading + side * np.pi / 18, true + side * np.pi / 18 + 0.004
            t += 0.1
            rows.append((t, x, y, heading, tx, ty, true))
        if k == 24:
            tx += jump
    path.write_text(
        "t,x,y,yaw,tx,ty,tyaw\n" + "".join(",".join(f"{v:.5f}" for v in row) + "\n" for row in rows)
    )


def mappings(folder: Path) -> list[str]:
    own, truth = folder / "own.yaml", folder / "true.yaml"
    own.write_text('format: csv\ncolumns: {"t": t, x: x, "y": "y", yaw: yaw}\n')
    truth.write_text('format: csv\ncolumns: {"t": t, x: tx, "y": ty, yaw: tyaw}\n')
    return ["--mapping", str(own), "--truth-mapping", str(truth)]


def test_a_recording_beside_its_truth_is_cut_into_trials(tmp_path: Path) -> None:
    recording(tmp_path / "drive.csv")
    words = mappings(tmp_path)
    told = found(tmp_path / "drive.csv", *words, "-o", tmp_path / "model.yaml", "--legs", "10,20")
    robots = told["robots"]
    assert isinstance(robots, dict)
    own = robots["drive"]
    assert 90 <= own["trials"] <= 96
    assert own["estimates"]["drift"]["value"] == pytest.approx(0.8, abs=0.15)
    legs = {(leg["length"], leg["estimator"]): leg for leg in own["legs"]}
    assert legs.keys() >= {(10.0, "heading"), (20.0, "linear")}
    assert legs[10.0, "heading"]["coverage"] > 0.85


def test_a_jump_of_the_truth_is_said_and_no_trial_has_it(tmp_path: Path) -> None:
    recording(tmp_path / "drive.csv", jump=1.0)
    result = calibrate(tmp_path / "drive.csv", *mappings(tmp_path), "-o", tmp_path / "model.yaml")
    assert result.exit_code == 0
    assert "truth and odometry part in one step 1 times" in result.stderr
    assert "robust deviations off along" not in result.stdout


def test_a_truth_of_few_stamps_does_not_hide_an_over_turn(tmp_path: Path) -> None:
    """Interpolated where the robot begins to turn, the truth would be ahead: its stamps count."""
    rng = np.random.default_rng(4)
    t, place, true, heading, real = 0.0, 0j, 3 - 1j, 0.0, 2.0
    odometry, truth = ["t,x,y,yaw"], ["t,x,y,yaw"]
    for k in range(60):
        turn = 0.8 if k % 3 else -0.8
        for v, w, steps in ((0.4, 0.0, int(rng.integers(150, 450))), (0.0, 0.0, 25),
                            (0.0, turn, int(rng.integers(30, 100))), (0.0, 0.0, 25)):  # fmt: skip
            for _ in range(steps):
                t += 0.02
                place += 0.02 * v * np.exp(1j * heading)
                true += 0.02 * v * np.exp(1j * real)
                heading, real = heading + 0.02 * w, real + 0.02 * w * 1.02
                odometry.append(f"{t:.3f},{place.real:.5f},{place.imag:.5f},{heading:.5f}")
                if len(odometry) % 5 == 0:
                    x, y, yaw = (true.real, true.imag, real) + 0.003 * rng.standard_normal(3)
                    truth.append(f"{t:.3f},{x:.5f},{y:.5f},{yaw:.5f}")
    (tmp_path / "bob.csv").write_text("\n".join(odometry) + "\n")
    (tmp_path / "truth.csv").write_text("\n".join(truth) + "\n")
    mapping = tmp_path / "own.yaml"
    mapping.write_text('format: csv\ncolumns: {"t": t, x: x, "y": "y", yaw: yaw}\n')
    told = found(tmp_path / "bob.csv", "--mapping", mapping, "--truth-recording",
                 tmp_path / "truth.csv", "-o", tmp_path / "model.yaml")  # fmt: skip
    robots = told["robots"]
    assert isinstance(robots, dict)
    own = robots["bob"]["estimates"]
    assert own["turn_gain"]["value"] == pytest.approx(0.02, abs=0.002)
    assert own["drift"]["value"] == pytest.approx(0.0, abs=0.05)


def hall(truth: Path) -> list[object]:
    own = ROOT / "data/recordings"
    return [own / "hall.csv", "--mapping", own / "hall.yaml", "--truth-recording", truth,
            "--truth-mapping", own / "hall-truth.yaml", "--robot", "hall"]  # fmt: skip


def test_a_late_truth_is_found_said_and_taken_out(tmp_path: Path) -> None:
    head, *rows = (ROOT / "data/recordings/hall-truth.csv").read_text().splitlines()
    late = [row.split(",", 1) for row in rows]
    (tmp_path / "late.csv").write_text(
        "\n".join([head, *(f"{float(t) + 2:.1f},{rest}" for t, rest in late)]) + "\n"
    )
    models = []
    for name, words in (("found", []), ("told", ["--lag", "2"]), ("denied", ["--lag", "0"])):
        result = calibrate(*hall(tmp_path / "late.csv"), *words, "-o", tmp_path / f"{name}.yaml")
        assert ("the truth is 2.00 s late: taken out" in result.stderr) == (name == "found")
        models.append(read_settings(tmp_path / f"{name}.yaml")["robots.hall.along"].value)
    assert models[0] == pytest.approx(models[1], rel=0.02)
    assert float(models[2]) > 5 * float(models[1])


@pytest.mark.parametrize(
    ("way", "angle", "words"),
    [
        (1000, 1, "times as far as the odometry: is the truth in millimetres? expected metres"),
        (0.001, 1, "times as far as the odometry: is the odometry in millimetres?"),
        (1, 57.29578, "is one of the headings in degrees, or clockwise?"),
        (1, -1, "turns are not those of the odometry (correlation -1.00)"),
    ],
)
def test_a_truth_of_other_units_is_asked_about(
    tmp_path: Path, way: float, angle: float, words: str
) -> None:
    head, *rows = (ROOT / "data/recordings/hall-truth.csv").read_text().splitlines()
    own = [[float(value) for value in row.split(",")] for row in rows]
    odd = [f"{t},{way * x},{way * y},{angle * yaw}" for t, x, y, yaw in own]
    (tmp_path / "odd.csv").write_text("\n".join([head, *odd]) + "\n")
    result = calibrate(*hall(tmp_path / "odd.csv"), "-o", tmp_path / "model.yaml")
    assert result.exit_code == 1 and words in result.stderr


def test_an_end_farther_off_than_the_way_is_a_slip_and_many_are_of_another_unit(
    tmp_path: Path,
) -> None:
    head, *rows = TRIALS.read_text().splitlines()[:81]
    slipped = rows[7].split(",")
    slipped[4:6] = ["-2.9", "2.8"]
    (tmp_path / "own.csv").write_text("\n".join([head, *rows[:7], ",".join(slipped), *rows[8:]]))
    told = found(tmp_path / "own.csv", "-o", tmp_path / "model.yaml")
    assert isinstance(told["robots"], dict) and "own.csv:9 (" in str(told["robots"]["r1"]["notes"])
    cm = [row.split(",") for row in rows]
    cm = [[*row[:4], str(100 * float(row[4])), str(100 * float(row[5])), *row[6:]] for row in cm]
    (tmp_path / "cm.csv").write_text("\n".join([head, *map(",".join, cm)]))
    result = calibrate(tmp_path / "cm.csv", "-o", tmp_path / "other.yaml")
    assert result.exit_code == 1 and "m that were run: metres?" in result.stderr


def test_trials_are_left_out_by_their_place(tmp_path: Path) -> None:
    words = ["--leave-out", "trials.csv:5", "--leave-out", "7", "-o", tmp_path / "model.yaml"]
    result = calibrate(TRIALS, *words)
    assert result.stdout.startswith("r1: 78 trials") and f"left out: {TRIALS}:7" in result.stderr
    result = calibrate(TRIALS, "--leave-out", "999", "-o", tmp_path / "other.yaml")
    assert result.exit_code == 1 and "--leave-out, found 999, which names no trial" in result.stderr


def test_an_existing_model_is_judged(example: Path, tmp_path: Path) -> None:
    result = calibrate(TRIALS, "--check", example / "model.yaml")
    assert result.exit_code == 0 and result.stderr == ""
    first = result.stdout.splitlines()[0]
    assert first.startswith("r1: heading: 9") and "of 80 ends inside (asked: 95 %)" in first
    (tmp_path / "bold.yaml").write_text("along: 0.001\nacross: 0.001\nturn_spread: 0.01\n")
    told = calibrate(TRIALS, "--check", tmp_path / "bold.yaml", "--json")
    assert json.loads(told.stdout)["robots"]["r1"]["heading"]["coverage"] < 0.2
    assert "r1: WARNING: only" in told.stderr
    assert calibrate(TRIALS).exit_code == 2
    assert (
        calibrate(TRIALS, "-o", tmp_path / "a.yaml", "--check", example / "model.yaml").exit_code
        == 2
    )


def test_no_robot_is_lent_what_only_others_have(example: Path) -> None:
    """What stands first in the file is for robots that it does not name."""
    given = read_settings(example / "model.yaml")
    assert given["drift"].value != 0
    assert (given["robots.r1.drift"].value, given["robots.r1.scale"].value) == (0, 1)


def need(path: Path) -> Path:
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


def test_optiodom_gives_a_model_per_geometry(tmp_path: Path) -> None:
    runs = sorted(need(REAL / "optiodom/ivanjko").glob("*/*_run-*.csv"))
    told = found(*runs, "--mapping", "optiodom-ticks", "--truth-mapping", "optiodom-truth",
                 "-o", tmp_path / "model.yaml")  # fmt: skip
    robots = told["robots"]
    assert isinstance(robots, dict)
    assert list(robots) == ["Li0.2-Di0.084", "Li0.205-Di0.084", "Li0.205-Di0.085"]
    assert told["pooled"] is None and "not pooled" in str(told["notes"])
    most = robots["Li0.2-Di0.084"]
    assert most["days"] == 6 and most["held_out"]["heading"]["coverage"] >= 0.9
    assert most["held_out"]["heading"]["heading_coverage"] >= 0.9
    # The README of the data: half-turns off by 0.4 to 3.1 degrees, the sign following the turn.
    gain = most["estimates"]["turn_gain"]
    assert gain["low"] > -0.012 and gain["high"] < -0.004
    assert robots["Li0.205-Di0.085"]["model"]["scale"] == pytest.approx(0.998 * 84 / 85, abs=2e-3)


@pytest.mark.thorough
def test_intels_held_out_legs_lie_in_their_rectangles(tmp_path: Path) -> None:
    folder = need(REAL / "intel")
    told = found(folder / "intel-raw.json", "--mapping", "intel-json", "--truth-recording",
                 folder / "intel-corrected.json", "--start-error", "0.1,0.1,3",
                 "-o", tmp_path / "model.yaml")  # fmt: skip
    robots = told["robots"]
    assert isinstance(robots, dict)
    own = robots["intel-raw"]
    assert own["model"]["drift"] == pytest.approx(3.35, abs=0.25)
    assert own["model"]["turn_gain"] == pytest.approx(-0.028, abs=0.01)
    legs = {leg["length"]: leg for leg in own["legs"] if leg["estimator"] == "heading"}
    assert all(leg["coverage"] >= 0.9 for leg in legs.values()), legs
    assert legs[10.0]["half_width"] < 1.6 and legs[20.0]["half_width"] < 3.2


HEADER = "robot,manoeuvre,distance,turn,along,across,heading,geometry\n"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("r1,spin,0,90,,,183.8,", "table.csv:2: heading, found 183.8, expected an error of at most "
         "90 degrees; write it as true minus asked, between -180 and 180"),
        ("r1,spin,0,90,,,-90.5,", "heading, found -90.5"),
        (f"{'r' * 60},spin,0,90,,,1,wide", "expected at most 64 characters together"),
    ],
)  # fmt: skip
def test_rows_that_mean_something_else_are_refused(tmp_path: Path, row: str, words: str) -> None:
    table = tmp_path / "table.csv"
    table.write_text(HEADER + row + "\n")
    result = calibrate(table, "-o", tmp_path / "model.yaml")
    assert result.exit_code == 1 and words in result.stderr


def test_trials_that_are_given_twice_are_refused(tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    result = calibrate(TRIALS, TRIALS, "-o", model)
    assert result.exit_code == 1 and "trials.csv: is given twice, expected it once" in result.stderr
    copy = tmp_path / "copy.csv"
    copy.write_bytes(TRIALS.read_bytes())
    result = calibrate(TRIALS, copy, "-o", model)
    assert result.exit_code == 1 and "copy.csv:" in result.stderr
    assert "in all numbers, as 240 of 480 trials repeat an earlier one" in result.stderr
    assert not model.exists()


def test_model_and_picture_are_written_both_or_neither(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from possmap.pictures import palettes

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(palettes, "write_png", full)
    result = calibrate(TRIALS, "-o", tmp_path / "model.yaml", "--picture", tmp_path / "out.png")
    assert result.exit_code == 1 and "No space left on device" in result.stderr
    assert list(tmp_path.iterdir()) == []
