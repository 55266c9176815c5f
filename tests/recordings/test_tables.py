"""CSV and JSON recordings: every way to say where a robot was; a bad row harms no other."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from possmap.errors import RecordingError, SettingsError
from possmap.lab.convert.samples import Samples, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Source, open_recordings, read_mapping, tables
from possmap.lab.recordings.beams import Scan
from possmap.lab.recordings.clocks import SAME_TIME
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.recording import Recording
from possmap.lab.recordings.tables import open_tables

SKIPPED = "rows cut short or without numbers, skipped"
NO_POSE = "rows with NaN or infinity for a pose, skipped"
BACKWARDS = "rows whose clock ran backwards, skipped"
NOTHING = "readings that mean nothing, dropped"
WRAPPED = "tick counters that began anew, continued"
FOUR = tuple(math.radians(angle) for angle in (-90, 0, 90, 180))

PLAIN = "columns: {t: t, x: x, y: y, yaw: yaw}\n"
TICKS = "columns: {t: t, left: l, right: r}\n"
SPEEDS = "columns: {t: t, forward: v, turn: w}\n"
ROWS = "0,1,2,0.5\n1,2,4,0.6\n2,3,6,0.7\n"


def opened(folder: Path, mapping: str, text: str | bytes, form: str = "csv") -> Recording:
    """Open a recording of this text, by a mapping to which its format is added."""
    path, rules = folder / f"drive.{form}", folder / "mapping.yaml"
    rules.write_text(f"format: {form}\n{mapping}")
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (found,) = open_recordings([path], Source(mapping=read_mapping(rules), beams=FOUR))
    return found


def read(
    folder: Path, mapping: str, text: str | bytes, form: str = "csv"
) -> tuple[Samples, dict[str, int]]:
    tally = Tally()
    samples = joined(opened(folder, mapping, text, form).samples(tally, None))
    return samples, {what: count.count for what, count in tally.counts.items()}


def refusal(folder: Path, mapping: str, text: str | bytes, form: str = "csv") -> str:
    """Return why a recording is refused, without the folder in front."""
    with pytest.raises(RecordingError) as caught:
        read(folder, mapping, text, form)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{folder}/")


def table(names: str, *rows: Sequence[object]) -> str:
    return "".join(f"{','.join(map(str, row))}\n" for row in (names.split(), *rows))


# --- How a CSV is laid out ---------------------------------------------------------------------

LAYOUTS = {
    "header": (PLAIN, "t,x,y,yaw\n" + ROWS),
    "other order": (PLAIN, "x,yaw,y,t\n1,0.5,2,0\n2,0.6,4,1\n3,0.7,6,2\n"),
    "columns to spare": (PLAIN, table("n yaw x a y t", (9, 0.5, 1, "a_b", 2, 0),
                                      (9, 0.6, 2, "", 4, 1), (9, 0.7, 3, "ä", 6, 2))),
    "numbers": ("header: false\ncolumns: {t: 1, x: 2, y: 3, yaw: 4}\n", ROWS),
    "numbers of a header": ("columns: {t: 1, x: x, y: 3, yaw: 4}\n", "t,x,y,yaw\n" + ROWS),
    "spaces": (PLAIN, "t, x ,y, yaw\n0 , 1,2 , 0.5\n 1,2,4,0.6\n2,3,6, 0.7 \n"),
    "white space": ("delimiter: whitespace\n" + PLAIN,
                    "t  x y\tyaw\n 0 1  2 0.5\n1\t2 4 0.6  \n2 3 6 0.7\n"),
    "tab": ("delimiter: tab\n" + PLAIN, ("t,x,y,yaw\n" + ROWS).replace(",", "\t")),
    "semicolon": ('delimiter: ";"\n' + PLAIN, ("t,x,y,yaw\n" + ROWS).replace(",", ";")),
    "byte-order mark": (PLAIN, "\ufefft,x,y,yaw\n" + ROWS),
    "byte-order mark, comment": (PLAIN, "\ufeff# drive\nt,x,y,yaw\n" + ROWS),
    "comments": (PLAIN, "# drive\n\nt,x,y,yaw\n# begins\n" + ROWS + "\n  \n#end"),
    "other comments": ("comment: '%'\n" + PLAIN, "% drive\nt,x,y,yaw\n" + ROWS),
    "header behind a hash": ('comment: ""\ncolumns: {t: "#t", x: x, y: y, yaw: yaw}\n',
                             "#t,x,y,yaw\n" + ROWS),
    "Windows": (PLAIN, ("t,x,y,yaw\n" + ROWS).replace("\n", "\r\n")),
    "no last line end": (PLAIN, ("t,x,y,yaw\n" + ROWS)[:-1]),
    "quoted": (PLAIN, '"t","x","y","yaw"\n"0",1,2,"0.5"\n1, "2",4,0.6\n2,3,"6",0.7\n'),
    "quoted delimiter": (PLAIN, 't,"a, b",x,y,yaw\n0,"1,5",1,2,0.5\n1,"",2,4,0.6\n2,,3,6,0.7\n'),
    "quoted white space": ("delimiter: whitespace\n" + PLAIN,
                           't "a b"  x y yaw\n0 "1 5" 1  2 0.5\n1 c 2 4 0.6\n2 d 3 6 0.7\n'),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_a_csv_gives_the_same_track(tmp_path: Path, layout: str) -> None:
    mapping, text = LAYOUTS[layout]
    samples, left_out = read(tmp_path, mapping, text)
    assert samples.t.tolist() == [0, 1, 2]
    assert samples.x.tolist() == [1, 2, 3]
    assert samples.y.tolist() == [2, 4, 6]
    assert samples.yaw.tolist() == [0.5, 0.6, 0.7]
    assert left_out == {}


@pytest.mark.parametrize(
    ("mapping", "text", "rows"),
    [
        (PLAIN, [[0, 1, 2, 0.5], [1, 2, 4, 0.6], [2, 3, 6, 0.7]], "list"),
        ("rows: log.rows\n" + PLAIN, [[0, 1, 2, 0.5], [1, 2, 4, 0.6], [2, 3, 6, 0.7]], "nested"),
        (PLAIN, [[0, 1, 2, 0.5], [1, 2, 4, 0.6], [2, 3, 6, 0.7]], "lines"),
        (
            "rows: '*'\ncolumns: {t: key, x: x, y: y, yaw: yaw}\n",
            [[0, 1, 2, 0.5], [1, 2, 4, 0.6], [2, 3, 6, 0.7]],
            "object",
        ),
    ],
)
def test_every_layout_of_json_gives_the_same_track(
    tmp_path: Path, mapping: str, text: list[list[float]], rows: str
) -> None:
    dicts = [dict(zip(("t", "x", "y", "yaw"), row, strict=True)) for row in text]
    written = {
        "list": json.dumps(dicts, indent=1),
        "nested": json.dumps({"robot": [1, {"rows": []}], "log": {"a": 1, "rows": dicts}, "b": 2}),
        "lines": "\n".join(json.dumps(row) for row in dicts),
        "object": json.dumps({str(row["t"]): row for row in dicts}),
    }[rows]
    samples, left_out = read(tmp_path, mapping, written, "json")
    assert samples.t.tolist() == [0, 1, 2]
    assert samples.x.tolist() == [1, 2, 3]
    assert samples.yaw.tolist() == [0.5, 0.6, 0.7]
    assert left_out == {}


def test_json_values_are_found_by_their_paths(tmp_path: Path) -> None:
    rows = [
        {"pose.x": t, "at": {"y": [9, 2 * t]}, "raw": [0, {"t": t}], "yaw": 0.5} for t in range(3)
    ]
    mapping = 'columns: {t: "raw[1].t", x: pose.x, y: "at.y[-1]", yaw: yaw}\n'
    samples, _ = read(tmp_path, mapping, json.dumps(rows), "json")
    assert samples.t.tolist() == samples.x.tolist() == [0, 1, 2]
    assert samples.y.tolist() == [0, 2, 4]


# --- Columns that are not there ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("mapping", "text", "told"),
    [
        (
            PLAIN, "t,x,y,yow\n" + ROWS,
            'drive.csv:1: column "yaw" is missing, found "t", "x", "y", "yow", '
            'did you mean "yow"?',
        ),
        (
            "header: false\ncolumns: {t: 1, x: 2, y: 5}\n", "# a\n" + ROWS,
            "drive.csv:2: column 5 is missing, found 4 columns",
        ),
        (
            "header: false\n" + PLAIN, ROWS,
            'drive.csv:1: column "t" is missing, found no header',
        ),
        (
            PLAIN + "beams: [{column: front, angle_deg: 0}]\n", "t,x,y,yaw,fornt\n0,0,0,0,1\n",
            'drive.csv:1: column "front" is missing, found "t", "x", "y", "yaw", "fornt", '
            'did you mean "fornt"?',
        ),
        (
            PLAIN + "scan: {column: s0, first_deg: -90, step_deg: 90, count: 3}\n",
            "t,x,y,yaw,s0,s1\n0,0,0,0,1,1\n",
            "drive.csv:1: column 7 is missing, found 6 columns",
        ),
        (
            PLAIN + "scan: {column: s0, first_deg: -90, step_deg: 90}\n",
            "t,x,y,yaw,s0,s1\n0,0,0,0,1,1\n",
            "drive.csv: scan.count, found none, expected how many columns",
        ),
        (PLAIN, "# nothing\n\n", "drive.csv: holds no rows, expected some"),
        (PLAIN, "", "drive.csv: holds nothing that can be read, expected a recording"),
    ],
)  # fmt: skip
def test_a_csv_without_what_is_mapped_is_refused(
    tmp_path: Path, mapping: str, text: str, told: str
) -> None:
    assert refusal(tmp_path, mapping, text) == told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '[{"t": 0, "x": 1, "y": 2, "yaww": 3}]',
            'drive.json:1: column "yaw" is missing, found "t", "x", "y", "yaww", '
            'did you mean "yaww"?',
        ),
        ("[5]", 'drive.json:1: column "t" is missing, found 5'),
        ("[]", "drive.json: holds no rows, expected some"),
        ("\n\n[null]", 'drive.json:3: column "t" is missing, found null'),
        (
            '[{"t": 0, "x": 1, "y": 2, "yaw": 3, "s": 4}]',
            "drive.json:1: s, found 4, expected a list of ranges",
        ),
    ],
)
def test_json_without_what_is_mapped_is_refused(tmp_path: Path, text: str, told: str) -> None:
    mapping = PLAIN
    if '"s"' in text:
        mapping += "scan: {column: s, first_deg: 0, step_deg: 1}\n"
    assert refusal(tmp_path, mapping, text, "json") == told


# --- Units -------------------------------------------------------------------------------------

UNITS = [
    ("time", "ms", 1e-3), ("time", "us", 1e-6), ("time", "ns", 1e-9), ("time", "s", 1),
    ("length", "m", 1), ("length", "cm", 0.01), ("length", "mm", 1e-3), ("length", "in", 0.0254),
    ("length", "ft", 0.3048), ("range", "m", 1), ("range", "cm", 0.01), ("range", "mm", 1e-3),
    ("range", "in", 0.0254), ("range", "ft", 0.3048), ("angle", "rad", 1),
    ("angle", "deg", math.pi / 180),
]  # fmt: skip


@pytest.mark.parametrize(("quantity", "unit", "worth"), UNITS)
def test_every_unit_of_a_sample(tmp_path: Path, quantity: str, unit: str, worth: float) -> None:
    mapping = f"units: {{{quantity}: {unit}}}\n{PLAIN}beams: [{{column: r, angle_deg: 0}}]\n"
    samples, _ = read(tmp_path, mapping, table("t x y yaw r", (0, 1, 2, 0, 2), (2, 3, 4, 0.5, 4)))
    worths = {quantity: worth}
    assert samples.t == pytest.approx(np.array([0, 2]) * worths.get("time", 1))
    assert samples.x == pytest.approx(np.array([1, 3]) * worths.get("length", 1))
    assert samples.y == pytest.approx(np.array([2, 4]) * worths.get("length", 1))
    assert samples.yaw == pytest.approx(np.array([0, 0.5]) * worths.get("angle", 1))
    assert samples.ranges[:, 0] == pytest.approx(np.array([2, 4]) * worths.get("range", 1))


# --- Headings ----------------------------------------------------------------------------------


def test_headings_go_on_over_a_full_turn(tmp_path: Path) -> None:
    yaw = [0, 3, -3, 0, 3, -3]
    text = table("t x y yaw", *((t, 0, 0, angle) for t, angle in enumerate(yaw)))
    samples, _ = read(tmp_path, PLAIN, text)
    assert samples.yaw == pytest.approx([0, 3, 3.2832, 6.2832, 9.2832, 9.5664], abs=1e-3)


@pytest.mark.parametrize("size", [1, 2, 1e-200, 1e200])
def test_quaternions_of_any_length_give_the_heading(tmp_path: Path, size: float) -> None:
    angles = [0.5, -2.5, 3.0]
    rows = [
        (t, 0, 0, 0, 0, size * math.sin(a / 2), size * math.cos(a / 2))
        for t, a in enumerate(angles)
    ]
    mapping = "columns: {t: t, x: x, y: y, qx: a, qy: b, qz: c, qw: d}\n"
    samples, _ = read(tmp_path, mapping, table("t x y a b c d", *rows))
    assert np.mod(samples.yaw, 2 * math.pi) == pytest.approx(np.mod(angles, 2 * math.pi))


def test_quaternions_of_zeros_are_skipped(tmp_path: Path) -> None:
    mapping = "columns: {t: t, x: x, y: y, qx: a, qy: a, qz: a, qw: d}\n"
    text = table("t x y a d", *((t, t, 0, 0, t % 3) for t in range(1, 6)))
    samples, left_out = read(tmp_path, mapping, text)
    assert samples.t.tolist() == [1, 2, 4, 5]
    assert left_out == {"rows with a quaternion of zeros, skipped": 1}


def test_without_a_heading_the_body_looks_where_it_goes(tmp_path: Path) -> None:
    text = table("t x y", (0, 0, 0), (1, 0, 1), (2, 0, 1), (3, -1, 1))
    samples, _ = read(tmp_path, "columns: {t: t, x: x, y: y}\n", text)
    assert samples.yaw == pytest.approx([math.pi / 2] * 3 + [math.pi])


# --- The way from ticks and speeds -------------------------------------------------------------


def test_counters_of_the_wheels_make_a_track(tmp_path: Path) -> None:
    mapping = TICKS + "ticks: {metres_per_tick: 0.01, track: 0.5}\n"
    text = table("t l r", (0, 500, 900), (1, 600, 1000), (2, 550, 1050), (3, 650, 1150))
    samples, _ = read(tmp_path, mapping, text)
    assert samples.yaw == pytest.approx([0, 0, 2, 2])
    assert samples.x == pytest.approx([0, 1, 1, 1 + math.cos(2)])
    assert samples.y == pytest.approx([0, 0, 0, math.sin(2)])


def test_ticks_of_each_row_make_a_track(tmp_path: Path) -> None:
    mapping = TICKS + "ticks: {metres_per_tick: 0.01, track: 0.5, cumulative: false}\n"
    text = table("t l r", (0, 0, 0), (1, 100, 100), (2, -50, 50), (3, 100, 100))
    samples, _ = read(tmp_path, mapping, text)
    assert samples.yaw == pytest.approx([0, 0, 2, 2])
    assert samples.x == pytest.approx([0, 1, 1, 1 + math.cos(2)])


@pytest.mark.parametrize("way", [1, -1])
def test_counters_that_begin_anew_go_on(tmp_path: Path, way: int) -> None:
    mapping = TICKS + "ticks: {metres_per_tick: 0.01, track: 0.5, wrap: 65536}\n"
    counts = [(60_000 + way * 7000 * k) % 65_536 for k in range(40)]
    samples, left_out = read(
        tmp_path, mapping, table("t l r", *((t, n, n) for t, n in enumerate(counts)))
    )
    assert samples.x == pytest.approx(way * 70.0 * np.arange(40))
    jumps = sum(abs(one - other) > 32_768 for one, other in pairwise(counts))
    assert left_out == {WRAPPED: 2 * jumps}


def test_each_speed_holds_since_the_row_before(tmp_path: Path) -> None:
    text = table("t v w", (5, 9, 9), (6, 2, 0), (7, 0, 1.5), (9, 1, 0))
    samples, _ = read(tmp_path, SPEEDS, text)
    assert samples.x == pytest.approx([0, 2, 2, 2 + 2 * math.cos(1.5)])
    assert samples.yaw == pytest.approx([0, 0, 1.5, 1.5])


@pytest.mark.parametrize(
    ("mapping", "text"),
    [
        (SPEEDS, table("t v w", (0, 0, 0), (1, 1e300, 0), (2, 0, 0))),
        (SPEEDS, table("t v w", (0, 0, 0), (1, 1, 1e300), (2, 0, 0))),
        (SPEEDS, table("t v w", (0, 0, 0), (1, 1e308, 1e308), (9, 1e308, 1e308))),
        (TICKS + "ticks: {metres_per_tick: 1e6, track: 1e-6}\n",
         table("t l r", (0, 0, 0), (1, 1e308, -1e308), (2, 0, 0))),
    ],
)  # fmt: skip
def test_a_way_out_of_all_bounds_is_refused_where_it_begins(
    tmp_path: Path, mapping: str, text: str
) -> None:
    assert refusal(tmp_path, mapping, text) == (
        "drive.csv:3: the way computed up to here leads beyond ±1e9 m or rad, expected speeds or "
        "ticks of a robot"
    )


# --- Velocities --------------------------------------------------------------------------------

GUARDED = "columns: {t: t, x: x, y: y, yaw: yaw, vx: vx, vy: vy}\n"


def test_a_jump_that_the_velocity_belies_is_taken_out(tmp_path: Path) -> None:
    rows = [(t, t + 5 * (t > 2), 0, 0, 1, 0) for t in range(5)]
    samples, left_out = read(tmp_path, GUARDED, table("t x y yaw vx vy", *rows))
    assert samples.x == pytest.approx([0, 1, 2, 3, 4])
    assert left_out == {"steps that disagree with the velocity, replaced": 1}


def test_velocities_may_be_the_bodys(tmp_path: Path) -> None:
    rows = [(t, 0, t + 5 * (t > 2), math.pi / 2, 1, 0) for t in range(5)]
    text = table("t x y yaw vx vy", *rows)
    samples, left_out = read(tmp_path, "velocity_in_body: true\n" + GUARDED, text)
    assert samples.y == pytest.approx([0, 1, 2, 3, 4])
    assert list(left_out.values()) == [1]


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e308", "1e5"])
def test_a_velocity_that_is_none_replaces_nothing(tmp_path: Path, bad: str) -> None:
    rows = [(t, t, 0, 0, bad if t == 2 else 1, 0) for t in range(5)]
    samples, left_out = read(tmp_path, GUARDED, table("t x y yaw vx vy", *rows))
    assert samples.x.tolist() == [0, 1, 2, 3, 4]
    assert left_out == {}


# --- Times -------------------------------------------------------------------------------------


def test_a_row_that_is_skipped_takes_its_period_all_the_same(tmp_path: Path) -> None:
    text = table("x y", (0, 0), (1, "x"), ("nan", 2), (3, 0))
    samples, left_out = read(tmp_path, "period: 0.5\ncolumns: {x: x, y: y}\n", text)
    assert samples.t.tolist() == [0, 1.5]
    assert left_out == {SKIPPED: 1, NO_POSE: 1}


def test_rows_behind_the_clock_are_skipped(tmp_path: Path) -> None:
    text = table("t x y yaw", *((t, t, 0, 0) for t in (0, 1, 0.5, 2, 1, 3, 3.5)))
    samples, left_out = read(tmp_path, PLAIN, text)
    assert samples.x.tolist() == [0, 1, 2, 3, 3.5]
    assert left_out == {BACKWARDS: 2}


def test_a_clock_set_back_for_good_is_refused(tmp_path: Path) -> None:
    times = [*range(1000, 1300), *range(200)]
    told = refusal(tmp_path, PLAIN, table("t x y yaw", *((t, 0, 0, 0) for t in times)))
    assert told == (
        "drive.csv:401: the clock, found 99.000 s after 1299.000 s and 100 rows without catching "
        "up, expected times that rise; cut the recording where it was set back"
    )


def test_rows_of_one_time_follow_each_other_by_their_lines(tmp_path: Path) -> None:
    text = table("t x y yaw", (0, 0, 0, 0), (1, 1, 0, 0), (1, 2, 0, 0), (1, 2, 0, 0), (2, 3, 0, 0))
    samples, left_out = read(tmp_path, PLAIN, text)
    assert samples.t.tolist() == [0, 1, 1.5, 2]
    assert samples.x.tolist() == [0, 1, 2, 3]
    assert left_out == {SAME_TIME: 1}


# --- Ranges ------------------------------------------------------------------------------------

BEAM = PLAIN + "beams: [{column: r, angle_deg: 0, x: 0.1, y: -0.2}]\n"


def ranges(folder: Path, rules: str, *values: object) -> tuple[list[float], dict[str, int]]:
    text = table("t x y yaw r", *((t, t, 0, 0, value) for t, value in enumerate(values)))
    samples, left_out = read(folder, BEAM + rules, text)
    return samples.ranges[:, 0].tolist(), left_out


def test_values_that_mean_nothing_in_sight(tmp_path: Path) -> None:
    rules = "nothing: {values: [-1, 8190], above: 4.0}\n"
    found, left_out = ranges(tmp_path, rules, 1, -1, 8190, 3.99, 4, 4.01, "inf")
    assert found == [1, -4, -4, 3.99, -4, -4, -4]
    assert left_out == {}


def test_values_that_mean_nothing_at_all(tmp_path: Path) -> None:
    rules = "invalid: {values: [7, 9], above: 10, below: 0.5}\n"
    found, left_out = ranges(tmp_path, rules, 1, 7, 9, 11, 0.5, 0.4, 0.6, -3, 0)
    np.testing.assert_array_equal(
        found, [1, *[math.nan] * 5, 0.6, math.nan, math.nan]
    )  # fmt: skip
    assert left_out == {NOTHING: 7}


def test_values_are_the_files_and_bounds_are_metres(tmp_path: Path) -> None:
    rules = "units: {range: mm}\nnothing: {values: [8190], above: 4}\ninvalid: {below: 0.02}\n"
    found, _ = ranges(tmp_path, rules, 1000, 8190, 4001, 20, 21)
    np.testing.assert_array_equal(found, [1, -4, -4, math.nan, 0.021])


@pytest.mark.parametrize("value", ["", " ", "nan", "NaN"])
def test_a_reading_that_is_missing_is_none_and_no_fault(tmp_path: Path, value: str) -> None:
    found, left_out = ranges(tmp_path, "", 1, value, 3)
    np.testing.assert_array_equal(found, [1, math.nan, 3])
    assert left_out == {}


def test_scans_may_be_columns(tmp_path: Path) -> None:
    mapping = PLAIN + "scan: {column: s0, first_deg: -90, step_deg: 45, count: 5, x: 0.3}\n"
    text = table("t x y yaw s0 s1 s2 s3 s4", *((t, t, 0, 0, 1, 2, 3, 4, 5) for t in range(2)))
    recording = opened(tmp_path, mapping, text)
    assert [math.degrees(mount.angle) for mount in recording.mounts] == pytest.approx([-90, 0, 90])
    assert {mount.x for mount in recording.mounts} == {0.3}
    assert joined(recording.samples(Tally(), None)).ranges.tolist() == [[1, 3, 5]] * 2


def test_scans_may_be_lists(tmp_path: Path) -> None:
    mapping = PLAIN + "scan: {column: scan.r, first_deg: -90, step_deg: 45}\n"
    row = {"x": 0, "y": 0, "yaw": 0, "scan": {"r": [1, 2, None, 4, 5]}}
    samples, left_out = read(
        tmp_path, mapping, json.dumps([{"t": t, **row} for t in range(2)]), "json"
    )
    np.testing.assert_array_equal(samples.ranges, [[1, math.nan, 5]] * 2)
    assert left_out == {}


# --- Rows that cannot be used ------------------------------------------------------------------


@pytest.mark.parametrize(
    "row",
    [
        "1", "1,2", "1,2,4", "", "a,b,c,d", "1,2,4,x", "1,,4,0", "1_0,2,4,0", "1,2,4,0x5",
        '1,2,"4,0', '"1,2,4,0', "1,2,4,\0", "1,2,4,\ufffd", "1;2;4;0", "true,2,4,0", "1,2,4,1 2",
    ],
)  # fmt: skip
def test_a_row_without_its_numbers_is_skipped(tmp_path: Path, row: str) -> None:
    samples, left_out = read(tmp_path, PLAIN, f"t,x,y,yaw\n0,1,2,0\n{row}\n2,3,6,0\n3,4,8,0\n")
    assert samples.t.tolist() == [0, 2, 3]
    assert left_out == ({SKIPPED: 1} if row else {})


@pytest.mark.parametrize(
    "row",
    ["nan,2,4,0", "1,inf,4,0", "1,2,-inf,0", "1,2,4,nan", f"1,{'9' * 5000},4,0", "1,2,1e999,0"],
)  # fmt: skip
def test_a_row_of_nan_or_infinity_is_skipped(tmp_path: Path, row: str) -> None:
    samples, left_out = read(tmp_path, PLAIN, f"t,x,y,yaw\n0,1,2,0\n{row}\n2,3,6,0\n")
    assert samples.t.tolist() == [0, 2]
    assert left_out == {NO_POSE: 1}


@pytest.mark.parametrize("row", ["1,1.1e9,0,0", "1,0,-1e300,0", "1,0,0,1e10"])
def test_a_row_beyond_all_bounds_is_skipped(tmp_path: Path, row: str) -> None:
    samples, left_out = read(tmp_path, PLAIN, f"t,x,y,yaw\n0,1,2,0\n{row}\n2,3,6,0\n")
    assert samples.t.tolist() == [0, 2]
    assert left_out == {"rows with a place or heading beyond ±1e9, skipped": 1}


def test_a_lost_quote_spoils_no_other_row(tmp_path: Path) -> None:
    rows = "".join(f"{t},{t},0,0\n" for t in range(1, 50))
    samples, left_out = read(tmp_path, PLAIN, f't,x,y,yaw\n0,"0,0,0\n{rows}')
    assert len(samples) == 49
    assert left_out == {SKIPPED: 1}


@pytest.mark.parametrize(
    "row",
    [
        "null", "5", "[]", '"text"', "{}", '{"t": 1, "x": 2}',
        '{"t": 1, "x": 2, "y": 3, "yaw": {}}',
        '{"t": true, "x": 2, "y": 3, "yaw": 0}', '{"t": 1, "x": null, "y": 3, "yaw": 0}',
        '{"t": 1, "x": [2], "y": 3, "yaw": 0}', '{"t": 1, "x": "2_0", "y": 3, "yaw": 0}',
        f'{{"t": 1, "x": {"9" * 400}, "y": 3, "yaw": 0}}',
    ],
)  # fmt: skip
def test_a_json_row_without_its_numbers_is_skipped(tmp_path: Path, row: str) -> None:
    good = [json.dumps({"t": t, "x": 1, "y": 2, "yaw": 0}) for t in (0, 2, 3)]
    samples, left_out = read(
        tmp_path, PLAIN, f"[{good[0]}, {row}, {good[1]}, {good[2]}]", "json"
    )  # fmt: skip
    assert samples.t.tolist() == [0, 2, 3]
    assert left_out == {SKIPPED: 1}


def test_a_recording_of_which_most_rows_are_bad_is_refused(tmp_path: Path) -> None:
    text = "t,x,y,yaw\n0,1,2,0\n" + "a,b,c,d\n" * 2 + "3,4,8,0\n" + "e\n"
    assert refusal(tmp_path, PLAIN, text) == (
        "drive.csv:3: 3 of 5 rows cannot be used, the first here, expected at most half "
        '(t, found "a", expected a number, or a date as ISO 8601 has it (time_format))'
    )


@pytest.mark.parametrize("place", [1, 3, 40])
def test_one_stamp_far_ahead_puts_no_other_row_into_the_past(tmp_path: Path, place: int) -> None:
    times = [float(t) for t in range(50)]
    times[place] += 900
    text = "t,x,y,yaw\n" + "".join(f"{t},1,2,0\n" for t in times)
    samples, left_out = read(tmp_path, PLAIN, text)
    assert samples.t.tolist() == [t for t in range(50) if t != place]
    assert left_out == {"rows whose clock jumped ahead and back, skipped": 1}


# --- However the file is read ------------------------------------------------------------------

MIXED = (
    (GUARDED, "t x y yaw vx vy", lambda k: (k, k + (k > 9), 0, k, 1, 0)),
    (SPEEDS, "t v w", lambda k: (k, 1 + k % 3, 0.1 * k)),
    (TICKS + "ticks: {metres_per_tick: 0.1, track: 1, wrap: 100}\n", "t l r",
     lambda k: (k, 7 * k % 100, -5 * k % 100)),
    (TICKS + "ticks: {metres_per_tick: 0.1, track: 1, cumulative: false}\n", "t l r",
     lambda k: (k, k % 4, k % 3)),
    ("period: 0.5\ncolumns: {x: x, y: y, yaw: w}\n", "x y w", lambda k: (k, k % 5 or "x", k % 7)),
    (BEAM, "t x y yaw r", lambda k: (k, k // 2, 0, k % 5, k)),
)  # fmt: skip


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
@pytest.mark.parametrize("kind", range(len(MIXED)))
def test_blocks_of_any_size_give_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: int, rows: int
) -> None:
    mapping, names, row = MIXED[kind]
    text = table(names, *map(row, range(25)))
    whole, all_left_out = read(tmp_path, mapping, text)
    monkeypatch.setattr(tables, "CHUNK_ROWS", rows)
    parts, left_out = read(tmp_path, mapping, text)
    for name in ("t", "x", "y", "yaw", "ranges"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=0, atol=1e-9)
    assert left_out == all_left_out


def test_progress_adds_up_to_the_size(tmp_path: Path) -> None:
    recording = opened(
        tmp_path, PLAIN, "t,x,y,yaw\n" + "".join(f"{t},1,2,3\n" for t in range(99_999))
    )
    told: list[int] = []
    for _ in recording.samples(Tally(), told.append):
        pass
    assert sum(told) == recording.size
    assert len(told) > 2


# --- Several files -----------------------------------------------------------------------------

PAIR = """format: csv
tables:
  - {file: "*_pose.csv", columns: {t: t, x: x, y: y, yaw: yaw}}
  - {file: "*_range.csv", columns: {t: t}, beams: [{column: r, angle_deg: 0}]}
"""


def pair(folder: Path, name: str, count: int = 30) -> tuple[Path, Path]:
    """Write places every second, and ranges half a second later."""
    poses, read_ = folder / f"{name}_pose.csv", folder / f"{name}_range.csv"
    poses.write_text(table("t x y yaw", *((t, t, 0, 0) for t in range(count))))
    read_.write_text(table("t r", *((t + 0.5, t + 1) for t in range(count - 1))))
    return poses, read_


def source(folder: Path, text: str = PAIR) -> Source:
    rules = folder / "mapping.yaml"
    rules.write_text(text)
    return Source(mapping=read_mapping(rules), beams=FOUR)


def test_two_files_are_one_recording_whichever_is_named(tmp_path: Path) -> None:
    both = pair(tmp_path, "a")
    for paths in ([both[0]], [both[1]], list(both), [both[1], both[0]]):
        (recording,) = open_recordings(paths, source(tmp_path))
        assert recording.name == "a"
        samples = joined(recording.samples(Tally(), None))
        assert samples.x.tolist() == [0.5 * k for k in range(59)]
        assert samples.ranges[1::2, 0].tolist() == list(range(1, 30))
        assert np.isnan(samples.ranges[::2]).all()


@pytest.mark.parametrize("rows", [1, 3, 4096])
def test_long_ranges_are_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    """A file is read in blocks of minutes: the other must not be left behind for that."""
    monkeypatch.setattr(tables, "CHUNK_ROWS", rows)
    pair(tmp_path, "a", 300)
    (recording,) = open_recordings([tmp_path / "a_pose.csv"], source(tmp_path))
    tally = Tally()
    samples = joined(recording.samples(tally, None))
    assert samples.ranges[1::2, 0].tolist() == list(range(1, 300))
    assert tally.counts == {}


def test_several_recordings_keep_their_order(tmp_path: Path) -> None:
    paths = [one for name in "cab" for one in pair(tmp_path, name)]
    found = open_recordings(paths, source(tmp_path))
    assert [recording.name for recording in found] == ["c", "a", "b"]


def test_a_file_of_no_table_is_refused_with_the_names(tmp_path: Path) -> None:
    path = tmp_path / "b.csv"
    path.write_text("t,x\n")
    with pytest.raises(RecordingError) as caught:
        open_recordings([path], source(tmp_path))
    assert str(caught.value) == (
        f"{path}: is no file of this mapping, expected *_pose.csv, *_range.csv"
    )


# --- Recordings of others ----------------------------------------------------------------------


SQUARE = "".join(f"{t},{100},{100},0.1,{90 * (t // 10) % 360}\n" for t in range(40))
GYRO = {
    "ticks": "columns: {t: 1, left: 2, right: 3, yaw: 5}\n"
    "ticks: {metres_per_tick: 0.001, track: 0.2, cumulative: false}\n",
    "speed": "columns: {t: 1, forward: 4, yaw: 5}\n",
    "speed and rate": "columns: {t: 1, forward: 4, turn: 4, yaw: 5}\n",
}


@pytest.mark.parametrize("rules", GYRO)
def test_a_heading_that_is_measured_beats_what_wheels_and_rates_say(
    tmp_path: Path, rules: str
) -> None:
    """Ten steps of 10 cm in each of four directions; the first step of a side cuts its corner."""
    (tmp_path / "drive.csv").write_text(SQUARE)
    rule = tmp_path / "rules.yaml"
    rule.write_text(f"format: csv\nheader: false\nunits: {{angle: deg}}\n{GYRO[rules]}")
    recording = open_tables([tmp_path / "drive.csv"], read_mapping(rule), ())
    samples = joined(recording.samples(Tally(), None))
    assert (samples.x[-1], samples.y[-1]) == pytest.approx((0, 0), abs=0.11)
    assert np.degrees(samples.yaw[[0, 15, 25, 39]]) == pytest.approx([0, 90, 180, 270])
    assert max(samples.x) == pytest.approx(1.0, abs=0.11)


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ("t: t, x: x, y: y, forward: v", "the place comes from x and y and from forward"),
        ("t: t, x: x, y: y, turn: w", "turn is of use beside forward or left and right"),
        ("t: t, x: x, y: y, left: l", "found left without right, expected them together"),
        (
            "t: t, x: x, y: y, yaw: w, qx: a, qy: b, qz: c, qw: d",
            "the heading comes from yaw and from a quaternion",
        ),
    ],
)
def test_a_role_that_nobody_would_read_is_refused_by_its_name(
    tmp_path: Path, columns: str, told: str
) -> None:
    rule = tmp_path / "rules.yaml"
    rule.write_text(f"format: csv\ncolumns: {{{columns}}}\n")
    with pytest.raises(SettingsError, match=told):
        read_mapping(rule)


def test_a_scan_of_more_than_all_around_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.json"
    path.write_text(json.dumps([{"t": t, "x": t, "y": 0, "r": [1.0] * 361} for t in range(3)]))
    scan = Scan(column="r", first_deg=-math.pi / 2, step_deg=math.radians(1))
    table = Table(columns={"t": "t", "x": "x", "y": "y"}, scan=scan)
    with pytest.raises(RecordingError, match=r"found 361 readings 1 degrees apart, expected the"):
        open_tables([path], Mapping(format="json", tables=(table,)), (0.0,))
