"""``possmap convert`` as a user meets it: what it prints, what it writes, what fuse makes of it."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main
from possmap.core.records import PartialMap, Pose, Wall
from possmap.fusing.check import check
from possmap.logs import read_log
from possmap.settings.limits import Limits

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared/realdata"
KNOWN = ["--set", "drift=1.5", "--set", "turn_gain=0.02"]


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the shipped recordings, and stand in it."""
    shutil.copytree(ROOT / "data/recordings", tmp_path / "data/recordings")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments), prog_name="possmap")


def converted(*arguments: str) -> list[PartialMap]:
    """Convert into out.jsonl, and read it back."""
    result = run("-q", "convert", *arguments, "-o", "out.jsonl", "--overwrite")
    assert (result.exit_code, result.stdout) == (0, ""), result.output
    return [one.version for one in read_log(Path("out.jsonl"), Limits()).deliveries]


def poses(log: PartialMap) -> list[Pose]:
    return [record for record in log.records if isinstance(record, Pose)]


LOG, TABLE = "data/recordings/hall.log", "data/recordings/hall.csv"
TRUTH = [
    "--reference", "data/recordings/hall-truth.csv",
    "--reference-mapping", "data/recordings/hall-truth.yaml",
]  # fmt: skip


def truth() -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return t, x, y, yaw of the shipped drive."""
    return np.loadtxt("data/recordings/hall-truth.csv", delimiter=",", skiprows=1)


def off(log: PartialMap) -> float:
    """Return how far the last pose lies from where the robot truly was [m]."""
    last, true = poses(log)[-1], truth()
    x, y = (np.interp(last.t or 0.0, true[:, 0], true[:, k]) for k in (1, 2))
    return math.hypot(last.x - x, last.y - y)


def test_a_recording_is_converted_and_fused(clone: Path) -> None:
    result = run("convert", LOG, "-o", "hall.json")
    assert result.exit_code == 0
    assert result.stderr == ""
    first, strays, left_out, written = result.stdout.splitlines()
    assert first.startswith("hall.log: 441 samples, 66.5 m, 3 beams -> 1 excursion of hall: ")
    assert strays.startswith("  track      strays ")
    assert left_out == (
        "  counted    441 ODOM lines, not needed beside laser lines that have poses"
    )
    assert written == "hall.json: written; next: possmap fuse hall.json -g hall.possmap"
    fused = run("fuse", "hall.json", "-g", "hall.possmap")
    assert fused.exit_code == 0 and "fused 1 log" in fused.stdout


def test_known_errors_of_the_robot_bring_it_home(clone: Path) -> None:
    (raw,), (known,) = converted(LOG), converted(LOG, *KNOWN)
    assert off(raw) > 3 and off(known) < 0.8
    assert dict(known.model) == {}  # they were applied, and must not be again


def test_legs_begin_where_the_truth_has_them(clone: Path) -> None:
    logs = converted(LOG, "--legs", "10", *TRUTH, *KNOWN, "--start-error", "0.05,0.04,2")
    assert [log.excursion for log in logs] == [f"1-leg-{n:03d}" for n in range(1, 8)]
    true = truth()
    for log in logs:
        first = poses(log)[0]
        x, y = (np.interp(first.t or 0.0, true[:, 0], true[:, k]) for k in (1, 2))
        assert (first.x, first.y) == pytest.approx((x, y), abs=1e-3)
        assert (first.error_x, first.error_y, first.error_heading_deg) == (0.05, 0.04, 2.0)
        assert off(log) < 0.5


def test_right_angles_are_reported_wall_by_wall(clone: Path) -> None:
    result = run("convert", LOG, "-o", "out.json", "--orthogonal", *KNOWN, "--json")
    assert result.exit_code == 0
    (told,) = json.loads(result.stdout)["recordings"]
    walls = told["orthogonal"]["walls"]
    assert told["followed"] > 0 and told["orthogonal"]["share_near_an_axis"] > 0.9
    assert [wall["way_m"] for wall in walls] == sorted(wall["way_m"] for wall in walls)
    assert all(wall["length_m"] >= 0.7 for wall in walls)
    log = read_log(Path("out.json"), Limits()).deliveries[0].version
    claims = [r for r in log.records if isinstance(r, Wall) and r.followed]
    assert len(claims) == told["followed"]
    spread = dict(log.model)["alignment_spread"]
    assert spread == pytest.approx(2.236 * told["orthogonal"]["wall_spread_deg"], rel=0.01)
    verbose = run("-v", "convert", LOG, "-o", "other.json", "--orthogonal", *KNOWN)
    assert len([x for x in verbose.stdout.splitlines() if x.startswith("    leg")]) == len(walls)


def test_a_building_without_right_angles_is_warned_of(clone: Path) -> None:
    """Eight walls, every one at another angle."""
    rows = ["t,x,y,yaw,left"]
    x = y = t = 0.0
    for angle in np.radians([0, 25, 40, 70, 10, 55, 80, 33]):
        for _ in range(60):
            rows.append(f"{t:.2f},{x:.4f},{y:.4f},{angle:.4f},0.8")
            x, y, t = x + 0.05 * math.cos(angle), y + 0.05 * math.sin(angle), t + 0.1
    Path("bent.csv").write_text("\n".join(rows) + "\n")
    Path("bent.yaml").write_text(
        "format: csv\ncolumns: {t: t, x: x, y: y, yaw: yaw}\n"
        "beams: [{column: left, angle_deg: 90}]\n"
    )
    result = run("convert", "bent.csv", "--mapping", "bent.yaml", "-o", "o.json", "--orthogonal")
    assert result.exit_code == 0
    assert "of its walls lie within 20 degrees of an axis, so the heading stays" in result.stderr
    plain = run("convert", "bent.csv", "--mapping", "bent.yaml", "-o", "plain.json")
    assert plain.exit_code == 0
    assert Path("plain.json").read_bytes() == Path("o.json").read_bytes()


def test_several_recordings_become_several_logs(clone: Path) -> None:
    shutil.copy(LOG, "second.log")
    logs = converted(LOG, "second.log", "--start", "1,2,90", "--start", "5,5,0")
    assert [log.name for log in logs] == [("hall", "1"), ("second", "1")]
    starts = [(poses(log)[0].x, poses(log)[0].y, poses(log)[0].heading_deg) for log in logs]
    assert starts[0][:2] == (1, 2) and starts[1][:2] == (5, 5)
    logs = converted(LOG, "second.log", "--robot", "r7")
    assert [log.name for log in logs] == [("r7", "hall"), ("r7", "second")]


def test_a_folder_gets_a_file_for_each_excursion_and_fuses_as_one(clone: Path) -> None:
    assert run("convert", LOG, "-o", "legs", "--legs", "20").exit_code == 0
    assert sorted(path.name for path in Path("legs").iterdir()) == [
        f"hall_1-leg-00{n}.json" for n in (1, 2, 3, 4)
    ]
    converted(LOG, "--legs", "20")
    for logs, grid in (("legs", "a.possmap"), ("out.jsonl", "b.possmap")):
        assert run("fuse", logs, "-g", grid).exit_code == 0
    one, other = (
        json.loads(run("info", grid, "--json").stdout) for grid in ("a.possmap", "b.possmap")
    )
    assert one["digest"] == other["digest"]


def test_the_three_encodings_and_compressed_ones_hold_the_same_records(clone: Path) -> None:
    names = ["a.json", "b.jsonl", "c.csv", "d.json.gz", "e.csv.gz"]
    logs = []
    for name in names:
        assert run("convert", LOG, "-o", name).exit_code == 0
        logs.append(read_log(Path(name), Limits()).deliveries[0].version.records)
    assert all(log == logs[0] for log in logs)
    again = Path("d.json.gz").read_bytes()
    run("convert", LOG, "-o", "d.json.gz", "--overwrite")
    assert Path("d.json.gz").read_bytes() == again


def test_the_example_recordings_are_those_of_their_recipe(clone: Path) -> None:
    import runpy

    (clone / "anew").mkdir()
    recipe = runpy.run_path(str(ROOT / "data/recordings/recipe.py"))
    recipe["main"](clone / "anew")
    for name in ("hall.log", "hall.csv", "hall-truth.csv"):
        assert (clone / "anew" / name).read_bytes() == (
            clone / "data/recordings" / name
        ).read_bytes()


STRAIGHT = "optiodom/ivanjko/231220200057/231220200057_run-01.csv"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="../shared is not here")


@needs_shared
@pytest.mark.parametrize(
    ("source", "options", "metres"),
    [
        ("intel/intel-raw.json", ["--mapping", "intel-json"], 501),
        ("intel/intel-corrected.json", ["--mapping", "intel-json"], 500),
        ("intel/intel.gfs.log", [], 499),
        ("carmen/freiburg-079-corrected.log.gz", [], 422),
        ("carmen/aces-corrected.log.gz", [], 323),
        (STRAIGHT, ["--mapping", "optiodom-ticks"], 2),
        (STRAIGHT, ["--mapping", "optiodom-truth"], 2),
    ],
)  # fmt: skip
def test_every_shared_recording_converts_with_what_ships(
    source: str, options: list[str], metres: float, clone: Path
) -> None:
    result = run("convert", str(SHARED / source), *options, "-o", "out.json", "--json")
    assert result.exit_code == 0, result.output
    (told,) = json.loads(result.stdout)["recordings"]
    assert told["metres"] == pytest.approx(metres, rel=0.02)
    assert told["strays_m"]["worst"] <= 0.05
    assert run("check", "out.json").exit_code == 0


def test_a_calibrated_model_is_taken_robot_by_robot(clone: Path) -> None:
    shutil.copy(LOG, "other.log")
    Path("model.yaml").write_text(
        "along: 0.03\n"
        "robots:\n  hall: {drift: 1.5, turn_gain: 0.02, along: 0.02}\n  r9: {scale: 2}\n"
    )
    known, unknown = converted(LOG, "other.log", "--model", "model.yaml")
    Path("only.yaml").write_text("robots:\n  r9: {scale: 2}\n")
    result = run("convert", LOG, "-o", "o.json", "--model", "only.yaml")
    assert "1 models that do not name the robot hall, so that the log has none (--robot r9?)" in (
        result.stdout
    )
    assert dict(known.model) == {"along": 0.02} and dict(unknown.model) == {"along": 0.03}
    assert off(known) < 0.8 and off(unknown) > 3


def test_align_turns_the_frame_onto_the_buildings_axes(clone: Path) -> None:
    askew = ["--start", "3,4,30", *KNOWN]
    (plain,), (aligned,) = converted(LOG, *askew), converted(LOG, *askew, "--align")
    assert aligned.records == plain.records, "the model turns the frame, not the log"
    assert dict(aligned.model).keys() == {"frame_heading"}, "these walls lean no more than usual"
    assert dict(aligned.model)["frame_heading"] == pytest.approx(-29, abs=1)
    assert abs(check(["out.jsonl"]).axes_deg or 45.0) < 2
    said = run("convert", LOG, *askew, "-o", "out.jsonl", "--overwrite").stdout
    assert "29 of 29 long walls near 29.0 deg" in said
    assert "--align turns the frame onto them, or fuse --set axes=29.0" in said


def test_align_says_how_far_walls_lean(clone: Path) -> None:
    """Beams that are off by some centimetres make walls that lean."""
    rng = np.random.default_rng(3)
    header, *rows = Path(TABLE).read_text().splitlines()
    noisy = []
    for row in rows:
        *first, right, ahead, left = row.split(",")
        ranges = [
            text if float(text) < 0 else f"{float(text) + rng.normal(0, 60):.0f}"
            for text in (right, ahead, left)
        ]
        noisy.append(",".join([*first, *ranges]))
    Path("noisy.csv").write_text("\n".join([header, *noisy, ""]))
    mapping = ["--mapping", "data/recordings/hall.yaml", "--wall-error", "0.15", *KNOWN]
    (log,) = converted("noisy.csv", *mapping, "--align")
    assert 4.5 < dict(log.model)["wall_tilt"] < 20


@pytest.mark.parametrize(
    ("options", "code", "problem"),
    [
        (["--fix", "end=1,2,0.1"], 2, "--fix says where the frame lies, expected no --align"),
        (["--place", "hall=1,2,3"], 2, "--place says where the frame lies, expected no --align"),
        (["--set", "frame_x=3"], 1, "--align: found frame_x as well, expected one of them"),
        (["-o", "out.csv"], 1, "out.csv: a CSV holds no place (--align), expected .jsonl or a"),
    ],
)
def test_align_stands_alone(options: list[str], code: int, problem: str, clone: Path) -> None:
    result = run("convert", LOG, "-o", "out.jsonl", "--align", *options)
    assert result.exit_code == code
    assert problem in result.stderr
