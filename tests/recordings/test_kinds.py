"""Recordings as owners of robots have them: what is used, what is refused, and what is said."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main


def run(folder: Path, mapping: str, text: str, *options: str, form: str = "csv") -> Result:
    """Convert a recording of this text, by a mapping to which its format is added."""
    (folder / f"drive.{form}").write_text(text)
    (folder / "rules.yaml").write_text(f"format: csv\n{mapping}")
    rules = ["--mapping", str(folder / "rules.yaml")] if form == "csv" else []
    recording, log = str(folder / f"drive.{form}"), str(folder / "log.jsonl")
    return CliRunner().invoke(main, ["convert", recording, "-o", log, *rules, *options])


def converted(folder: Path, mapping: str, text: str, *options: str, **given: str) -> list[Any]:
    """Return the records of a recording of this text."""
    result = run(folder, mapping, text, "--overwrite", *options, **given)
    assert result.exit_code == 0, result.output
    return [record for log in logs(folder) for record in log.records]


def logs(folder: Path) -> list[Any]:
    """Return the logs that were written, with their records."""
    found: list[Any] = []
    for line in (folder / "log.jsonl").read_text().splitlines():
        told = SimpleNamespace(**json.loads(line))
        if hasattr(told, "kind"):
            found[-1].records.append(told)
        else:
            found.append(SimpleNamespace(excursion=told.excursion, records=[]))
    return found


def poses(records: Sequence[Any]) -> list[tuple[float, float, float]]:
    return [(r.x, r.y, r.heading) for r in records if r.kind == "pose"]


def table(names: str, *rows: Sequence[object], delimiter: str = ",") -> str:
    lines = (names.split(), *rows)
    return "".join(f"{delimiter.join(map(str, row))}\n" for row in lines)


# --- Wheels, and a heading of something else ---------------------------------------------------

SIDE, STEP = 20, 0.05  # rows of a side of a square, metres of a row
TICKS = "ticks: {metres_per_tick: 0.001, track: 0.2, cumulative: false}\nperiod: 0.1\n"
ALONG = [(k // SIDE) % 4 * 90 for k in range(4 * SIDE)]  # heading of each row [deg]
HEADINGS = {
    "yaw": ("units: {angle: deg}\n", ALONG),
    "yaw, clockwise": ("units: {angle: deg}\nclockwise: true\n", [-a for a in ALONG]),
    "compass": ("units: {angle: deg}\n", [(90 - a) % 360 for a in ALONG]),
    "turn": ("units: {turn_rate: deg/s}\n",
             [900 * (k > 0 and ALONG[k] != ALONG[k - 1]) for k in range(4 * SIDE)]),
}  # fmt: skip


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("way", ["ticks", "speed"])
def test_a_heading_that_is_measured_closes_the_square_that_wheels_drive(
    tmp_path: Path, heading: str, way: str
) -> None:
    rules, values = HEADINGS[heading]
    role = heading.partition(",")[0]
    columns = "left: a, right: b" if way == "ticks" else "forward: v"
    mapping = f"{rules}{TICKS}columns: {{{columns}, {role}: h}}\n"
    if way == "speed":
        mapping = mapping.replace(TICKS, "period: 0.1\n")
    text = table("a b v h", *((50, 50, 0.5, h) for h in values))
    track = poses(converted(tmp_path, mapping, text))
    assert track[-1][:2] == pytest.approx((0, 0), abs=STEP + 0.01)
    assert max(x for x, _, _ in track) == pytest.approx(SIDE * STEP, abs=STEP + 0.01)


def test_a_rate_beside_a_heading_is_said_to_be_of_no_need(tmp_path: Path) -> None:
    mapping = "period: 0.1\ncolumns: {forward: v, turn: w, yaw: h}\n"
    result = run(tmp_path, mapping, table("v w h", *((0.5, 0, 0) for _ in range(9))))
    assert "source     role turn is not read, beside a heading from yaw" in result.stdout


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ("t: t, forward: v", "forward says how far the robot went, not where to; expected turn"),
        ("t: t, x: x, y: y, turn: w", "turn is of use beside forward or left and right"),
        ("t: t, x: x, y: y, yaw: a, compass: b", "the heading comes from yaw and from compass"),
        ("t: t, x: x, y: y, qw: a", "found qw without qz, expected them together"),
    ],
)
def test_roles_that_cannot_be_used_together_are_refused_by_their_names(
    tmp_path: Path, columns: str, told: str
) -> None:
    result = run(tmp_path, f"columns: {{{columns}}}\n", "")
    assert result.exit_code == 1
    assert told in result.stderr


def test_a_planar_quaternion_is_a_heading(tmp_path: Path) -> None:
    half = math.radians(30)
    rows = [(t, t * 0.1, 0, math.sin(half), math.cos(half)) for t in range(20)]
    mapping = "columns: {t: t, x: x, y: y, qz: z, qw: w}\n"
    records = converted(tmp_path, mapping, table("t x y z w", *rows))
    assert records[0].heading == pytest.approx(0)  # the way; the body looks 60 degrees off it


# --- Steps that no robot can make --------------------------------------------------------------

COUNTER = "ticks: {metres_per_tick: 0.001, track: 0.2}\ncolumns: {t: t, left: l, right: r}\n"
POSE = "columns: {t: t, x: x, y: y, yaw: w}\n"
BRIDGED = "steps that no robot can make, bridged"


def test_counters_that_restart_are_bridged_and_said(tmp_path: Path) -> None:
    counts = [50 * k for k in range(100)] + [50 * k for k in range(100)]
    text = table("t l r", *((k / 10, n, n) for k, n in enumerate(counts)))
    records = converted(tmp_path, COUNTER, text)
    assert poses(records)[-1] == pytest.approx((9.9, 0, 0), abs=0.01)
    assert f"counted    1 {BRIDGED} (first: " in run(tmp_path, COUNTER, text, "--overwrite").stdout


@pytest.mark.parametrize("bad", [(0, 7000), (-30_000, 3), (9e6, 9e6)])
@pytest.mark.parametrize("rows", [1, 3])
def test_bad_rows_are_dropped_and_the_way_goes_on(
    tmp_path: Path, bad: tuple[float, float], rows: int
) -> None:
    counts = [(50.0 * k, 50.0 * k) for k in range(100)]
    counts[60 : 60 + rows] = [bad] * rows
    text = table("t l r", *((k / 10, *n) for k, n in enumerate(counts)))
    assert poses(converted(tmp_path, COUNTER, text)) == [(0, 0, 0), (4.95, 0, 0)]


def drive(reset_at: int, beyond: float) -> str:
    """Return a drive to the east, then north; from some row on the odometry begins at zero."""
    rows = []
    for k in range(120):
        x, y, yaw = (0.05 * min(k, 60), 0.05 * max(0, k - 60), math.pi / 2 * (k > 60))
        if k >= reset_at:  # as it is seen from where the robot was then, looking north
            x, y, yaw = 0.05 * (k - reset_at) + beyond, 0.0, 0.0
        rows.append((k / 10, x, y, yaw))
    return table("t x y w", *rows)


def test_odometry_that_is_set_to_zero_goes_on_from_where_the_robot_was(tmp_path: Path) -> None:
    assert poses(converted(tmp_path, POSE, drive(90, 0.0)))[-1] == pytest.approx(
        (3.0, 2.9, 90.0), abs=0.06
    )


def test_a_jump_may_begin_an_excursion_or_end_what_is_believed(tmp_path: Path) -> None:
    text = drive(90, 0.0)
    run(tmp_path, POSE, text, "--jump", "split")
    first, second = logs(tmp_path)
    assert (first.excursion, second.excursion) == ("1-leg-001", "1-leg-002")
    assert (second.records[0].x, second.records[0].y) == (0, 0)
    records = converted(tmp_path, POSE, text, "--jump", "drop")
    assert poses(records)[-1][:2] == pytest.approx((3.0, 1.45), abs=0.06)


def test_what_is_too_fast_may_be_said(tmp_path: Path) -> None:
    text = table("t x y w", *((k, 0.3 * k + 0.8 * (k > 50), 0, 0) for k in range(100)))
    assert poses(converted(tmp_path, POSE, text))[-1][0] == pytest.approx(30.5)
    slow = converted(tmp_path, POSE, text, "--max-speed", "0.5")
    assert poses(slow)[-1][0] == pytest.approx(29.4)


@pytest.mark.parametrize("seed", range(20))
def test_no_sound_drive_loses_a_row(tmp_path: Path, seed: int) -> None:
    """Speeds that change fifty-fold, rows missed, clocks that jitter."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.02, 0.1, 0.1, 0.1, 3.0], 300))
    speed = np.repeat(rng.choice([0.0, 0.02, 0.3, 1.0], 30), 10)
    x = np.cumsum(np.diff(t, prepend=0) * speed)
    rows = [(a, b, 0, 0) for a, b in zip(t + rng.normal(0, 0.004, 300), x, strict=True)]
    result = run(tmp_path, POSE, table("t x y w", *rows))
    assert result.exit_code == 0
    assert "robot can make" not in result.output
    assert "dropped" not in result.output


@pytest.mark.parametrize(("worth", "asked"), [(1000, True), (1, False), (1e-4, True)])
def test_a_speed_that_no_robot_has_asks_for_the_units(
    tmp_path: Path, worth: float, asked: bool
) -> None:
    text = table("t x y w", *((k / 10, 0.03 * k * worth, 0, 0) for k in range(50)))
    result = run(tmp_path, POSE, text, "--tolerance", "0.001")
    assert ("which no robot has: are the units" in result.stderr) == asked


def test_coordinates_of_a_country_come_home(tmp_path: Path) -> None:
    text = table("t x y w", *((k, 448_000 + 0.3 * k, 5_411_000, 0) for k in range(20)))
    result = run(tmp_path, POSE, text)
    assert result.exit_code == 1
    assert "--start 0,0,0 lays the begin at (0, 0)" in result.stderr
    records = converted(tmp_path, POSE, text, "--start", "0,0,0")
    assert poses(records)[-1] == pytest.approx((5.7, 0, 0))


# --- Clocks ------------------------------------------------------------------------------------


@pytest.mark.parametrize("clock", ["0", "round(k / 10)", "1700000000"])
def test_times_that_cannot_order_the_rows_leave_it_to_their_lines(
    tmp_path: Path, clock: str
) -> None:
    rows = [(eval(clock, {"k": k, "round": round}), 0.1 * k, 0, 0) for k in range(60)]
    result = run(tmp_path, POSE, table("t x y w", *rows))
    assert "60 samples, 5.9 m" in result.stdout
    assert "rows of one time with the row before, ordered by their lines" in result.stdout


STAMPS = {
    "2024-03-05 10:00:{s:02d}.250": "",
    "2024-03-05T10:00:{s:02d}Z": "",
    "10:00:{s:02d}": "",
    "05.03.2024 10:00:{s:02d}": 'time_format: "%d.%m.%Y %H:%M:%S"\n',
}


@pytest.mark.parametrize("stamp", STAMPS)
def test_stamps_may_be_dates_or_times_of_day(tmp_path: Path, stamp: str) -> None:
    text = table("t x y w", *((stamp.format(s=k), 0.1 * k, 0, 0) for k in range(30)))
    records = converted(tmp_path, STAMPS[stamp] + POSE, text)
    assert records[-1].t - records[0].t == pytest.approx(29)


def test_an_hour_back_is_refused(tmp_path: Path) -> None:
    passed = [*range(720), *range(360, 1080)]  # in steps of ten seconds
    stamps = [f"2024-10-27 {k // 360:02d}:{k // 6 % 60:02d}:{k % 6}0" for k in passed]
    text = table("t x y w", *((stamp, k, 0, 0) for k, stamp in enumerate(stamps)))
    result = run(tmp_path, POSE, text)
    assert result.exit_code == 1
    assert "cut the recording where it was set back" in result.stderr


def test_midnight_is_no_clock_set_back(tmp_path: Path) -> None:
    stamps = [f"23:59:{50 + k}" if k < 10 else f"00:00:{k - 10:02d}" for k in range(20)]
    text = table("t x y w", *((stamp, 0.1 * k, 0, 0) for k, stamp in enumerate(stamps)))
    records = converted(tmp_path, POSE, text)
    assert records[-1].t - records[0].t == pytest.approx(19)


# --- How files are written ---------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [";", "\t", "|", " "])
@pytest.mark.parametrize("comma", [False, True])
def test_what_parts_columns_is_guessed_and_said(
    tmp_path: Path, delimiter: str, comma: bool
) -> None:
    text = table("t x y w", *((k, 0.5 * k, 0, 0) for k in range(9)), delimiter=delimiter)
    result = run(tmp_path, POSE, text.replace(".", ",") if comma else text)
    assert "9 samples, 4.0 m" in result.stdout
    said = {"\t": "tabs", " ": "blanks"}.get(delimiter, delimiter)
    and_commas = " and decimal commas" * comma
    assert f"source     fields parted by {said}{and_commas}, as it seems" in result.stdout


def test_semicolons_may_end_lines(tmp_path: Path) -> None:
    text = table("t x y w", *((k, 0.5 * k, 0, 0) for k in range(9))).replace("\n", ";\n")
    assert poses(converted(tmp_path, POSE, text))[-1][0] == 4.0


# --- Sensors -----------------------------------------------------------------------------------


def test_a_servo_turns_its_sonar(tmp_path: Path) -> None:
    """A robot that stands 1 m before a wall, its sonar sweeping; 90 is ahead, counted clockwise."""
    rows = [(k, 0, 0, 0, s, 1000 / math.cos(math.radians(90 - s)))
            for k, s in enumerate([50, 60, 70, 80, 90, 100, 110, 120, 130])]  # fmt: skip
    beam = "{column: r, angle_deg: s, ahead_deg: 90, clockwise: true, unit: mm}"
    records = converted(tmp_path, f"{POSE}beams: [{beam}]\n", table("t x y w s r", *rows))
    (wall,) = [record for record in records if record.kind == "wall"]
    assert (wall.x, wall.x2) == pytest.approx((1, 1), abs=1e-3)
    assert wall.y == pytest.approx(math.tan(math.radians(40)), abs=1e-3)
    assert wall.y2 == pytest.approx(-wall.y, abs=1e-3)


@pytest.mark.parametrize("pressed", ["1", "true", "True"])
@pytest.mark.parametrize(
    ("seat", "at"),
    [("angle_deg: 0, contact: 0.17", (2.17, 0)), ("angle_deg: 0, contact: true, x: 0.1, y: 0.2",
     (2.1, 0.2)), ("angle_deg: 90, contact: 0.15", (2, 0.15))],
)  # fmt: skip
def test_what_a_bumper_touches_is_a_wall_of_no_length(
    tmp_path: Path, seat: str, at: tuple[float, float], pressed: str
) -> None:
    free = {"1": "0", "true": "false", "True": "False"}[pressed]
    rows = [(k, 0.1 * k, 0, 0, pressed if k == 20 else free) for k in range(21)]
    records = converted(tmp_path, f"{POSE}beams: [{{column: b, {seat}}}]\n",
                        table("t x y w b", *rows))  # fmt: skip
    (wall,) = [record for record in records if record.kind == "wall"]
    assert (wall.x, wall.y) == (wall.x2, wall.y2) == pytest.approx(at)
    assert not wall.followed


@pytest.mark.parametrize(
    ("rules", "reading", "cleared"),
    [
        ("beams: [{column: r, angle_deg: 90, max: 0.8}]\n", 0.8, 0.8),
        ("beams: [{column: r, angle_deg: 90, max: 0.8}]\n", "inf", 0.8),
        ("beams: [{column: r, angle_deg: 90}]\nnothing: {values: [-1], above: 0.8}\n", -1, 0.8),
        ("beams: [{column: r, angle_deg: 90}]\nnothing: {values: [-1]}\ninvalid: {above: 1.5}\n",
         -1, 1.5),
        ("beams: [{column: r, angle_deg: 90}]\nnothing: {values: [-1]}\n", -1, 2.0),
    ],
)  # fmt: skip
def test_a_miss_clears_what_the_sensor_can_see_and_no_more(
    tmp_path: Path, rules: str, reading: object, cleared: float
) -> None:
    text = table("t x y w r", *((k / 10, 0.05 * k, 0, 0, reading) for k in range(40)))
    records = converted(tmp_path, POSE + rules, text, "--misses")
    beams = [record for record in records if record.kind == "beam"]
    assert {(beam.hit, beam.y2) for beam in beams} == {(False, cleared)}
    said = run(tmp_path, POSE + rules, text, "--misses", "--overwrite").stdout
    assert ("taken to see as far as --reach" in said) == (cleared == 2.0)


def test_what_a_front_sensor_sees_is_no_echo_unless_the_robot_passes_it(tmp_path: Path) -> None:
    """It drives up to a wall at 2 m, as near as 10 cm; somebody walks out of its way at 1 m."""
    rows = [(k / 10, 0.05 * k, 0, 0, 2.0 - 0.05 * k) for k in range(39)]
    rows[10] = (*rows[10][:4], 0.5)
    mapping = f"{POSE}beams: [{{column: r, angle_deg: 0}}]\n"
    records = converted(tmp_path, mapping, table("t x y w r", *rows))
    ends = [record.x2 for record in records if record.kind == "beam"]
    assert ends
    assert ends == pytest.approx([2.0] * len(ends))


# --- CARMEN ------------------------------------------------------------------------------------


def test_lasers_without_poses_are_read_beside_odometry(tmp_path: Path) -> None:
    lines = ["PARAM robot_frontlaser_offset 0.1 0 host 0"]
    for k in range(40):
        t = 1 + k / 10
        lines.append(f"ODOM {0.05 * k} 0 0 0.5 0 0 {t} host {t}")
        lines.append(f"RAWLASER1 0 -1.570796 3.141593 1.570796 1.5 0.01 0 3 1 1.5 1 0 {t} host {t}")
        lines.append(f"SONAR 1 2 3 {t} host {t}")
    text = "\n".join(lines) + "\n"
    records = converted(tmp_path, "", text, "--misses", form="log")
    walls = [record for record in records if record.kind == "wall"]
    assert sorted({wall.y for wall in walls}) == pytest.approx([-1, 1], abs=1e-3)
    assert min(wall.x for wall in walls) == pytest.approx(0.1)
    misses = [record for record in records if record.kind == "beam"]
    assert {round(beam.x2 - beam.x, 3) for beam in misses} == {1.5}
    said = run(tmp_path, "", text, "--overwrite", form="log").stdout
    assert "40 SONAR lines, which are not read (first: " in said
