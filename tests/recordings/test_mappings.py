"""Mappings as YAML: what every key says, and the exact refusal of what it cannot say."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from possmap.errors import SettingsError
from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.mapping import Beam, Mapping, Readable, Scan, Table, Ticks
from possmap.lab.recordings.mapping_yaml import find_mapping, known_mappings, read_mapping

CSV = "format: csv\n"
PLAIN = CSV + "columns: {t: t, x: x, y: y}\n"
ROLES = "t, x, y, yaw, qx, qy, qz, qw, vx, vy, forward, turn, left, right"
KEYS = (
    "format, tables, columns, beams, scan, rows, delimiter, header, comment, units, ticks, "
    "nothing, invalid, period, velocity_in_body, guard, gap"
)


def read(folder: Path, text: str) -> Mapping:
    path = folder / "m.yaml"
    path.write_text(text)
    return read_mapping(path)


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(SettingsError) as caught:
        read(folder, text)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{folder}/")


# --- What is shipped ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", known_mappings())
def test_every_shipped_mapping_is_found_by_its_name_and_reads(name: str) -> None:
    mapping = read_mapping(find_mapping(name))
    assert mapping.tables
    assert mapping.format in ("csv", "json", "ros")


def test_there_are_mappings_for_the_sets_of_others() -> None:
    assert known_mappings() == [
        "crazyflie-bag", "crazyflie-csv", "intel-json", "optiodom-ticks", "optiodom-truth",
    ]  # fmt: skip


def test_a_file_beats_a_shipped_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("intel-json").write_text(PLAIN)
    assert find_mapping("intel-json") == Path("intel-json")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("intl-json", '"intl-json" is neither a file nor shipped, did you mean "intel-json"?'),
        ("no/such.yaml", '"no/such.yaml" is neither a file nor shipped; possmap ships '),
        ("../recordings/intel-json", '"../recordings/intel-json" is neither a file nor shipped; '),
        ("", '"" is neither a file nor shipped; possmap ships crazyflie-bag, crazyflie-csv'),
    ],
)
def test_a_mapping_that_is_nowhere_is_refused(name: str, told: str) -> None:
    with pytest.raises(SettingsError) as caught:
        find_mapping(name)
    assert str(caught.value).startswith(f"--mapping: {told}")


# --- What every key says -----------------------------------------------------------------------


def test_little_is_enough(tmp_path: Path) -> None:
    mapping = read(tmp_path, PLAIN)
    assert mapping == Mapping("csv", (Table("", {"t": "t", "x": "x", "y": "y"}),))
    assert (mapping.delimiter, mapping.header, mapping.comment) == (",", True, "#")
    assert (mapping.guard, mapping.gap, mapping.period) == (0.05, 1.0, None)
    assert mapping.readable == Readable()


def test_every_key_of_a_csv(tmp_path: Path) -> None:
    text = """
format: csv
delimiter: ";"
header: false
comment: "%"
units: {time: ms, length: cm, range: mm, speed: cm/s, angle: deg, turn_rate: deg/s}
columns: {x: 1, y: 2, qx: 3, qy: 4, qz: 5, qw: 6, vx: 7, vy: 8}
beams:
  - {column: 9, angle_deg: 90}
  - {column: front, angle_deg: -0.5, x: 0.1, y: -0.2}
nothing: {values: [-1, 8190], above: 4}
invalid: {values: [0], above: 5, below: 0.02}
period: 0.1
velocity_in_body: true
guard: 0
gap: 0.5
"""
    mapping = read(tmp_path, text)
    (table,) = mapping.tables
    roles = ("x", "y", "qx", "qy", "qz", "qw", "vx", "vy")
    assert table.columns == {role: str(n) for n, role in enumerate(roles, 1)}
    assert table.beams == (
        Beam("9", Mount(math.pi / 2)), Beam("front", Mount(math.radians(-0.5), 0.1, -0.2)),
    )  # fmt: skip
    assert mapping.units == {
        "time": "ms", "length": "cm", "range": "mm", "speed": "cm/s", "angle": "deg",
        "turn_rate": "deg/s",
    }  # fmt: skip
    assert (mapping.delimiter, mapping.header, mapping.comment) == (";", False, "%")
    assert mapping.readable == Readable((-1, 8190), 4, (0,), 5, 0.02)
    assert (mapping.period, mapping.guard, mapping.gap) == (0.1, 0, 0.5)
    assert mapping.velocity_in_body


def test_a_scan_of_json(tmp_path: Path) -> None:
    text = """
format: json
rows: log.rows
columns: {t: key, forward: v, turn: "w[0]"}
scan: {column: r, first_deg: -90, step_deg: 0.5, count: 361, x: 0.2, y: -0.1}
"""
    mapping = read(tmp_path, text)
    assert mapping.rows == "log.rows"
    scan = Scan("r", -math.pi / 2, math.radians(0.5), 361, 0.2, -0.1)
    assert mapping.tables == (Table("", {"t": "key", "forward": "v", "turn": "w[0]"}, (), scan),)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("metres_per_tick: 0.01, track: 0.5", Ticks(0.01, 0.01, 0.5)),
        ("left: 0.01, right: 0.02, track: 0.5", Ticks(0.01, 0.02, 0.5)),
        ("metres_per_tick: 0.01, right: 0.02, track: 0.5", Ticks(0.01, 0.02, 0.5)),
        ("metres_per_tick: 1e-3, track: 1, wrap: 65536", Ticks(0.001, 0.001, 1, 65536)),
        ("metres_per_tick: 1, track: 1, cumulative: false", Ticks(1, 1, 1, None, False)),
    ],
)
def test_ticks(tmp_path: Path, given: str, told: Ticks) -> None:
    text = CSV + f"columns: {{t: t, left: l, right: r}}\nticks: {{{given}}}\n"
    assert read(tmp_path, text).ticks == told


def test_tables_of_files(tmp_path: Path) -> None:
    text = (
        CSV
        + """
tables:
  - {file: "*_a.csv", columns: {t: t, x: x, y: y}}
  - {file: "*_b.csv", columns: {t: t, yaw: w}, beams: [{column: r, angle_deg: 0}]}
"""
    )
    assert [table.source for table in read(tmp_path, text).tables] == ["*_a.csv", "*_b.csv"]


def test_topics_of_bags_need_no_columns(tmp_path: Path) -> None:
    mapping = read(tmp_path, "format: ros\ntables: [{topic: /odom}, {topic: /scan}]\n")
    assert mapping.tables == (Table("/odom"), Table("/scan"))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ('","', ","), ('";"', ";"), ("tab", "\t"), ('"\\t"', "\t"), ("whitespace", None),
        ('" "', None), ("'|'", "|"),
    ],
)  # fmt: skip
def test_delimiters(tmp_path: Path, given: str, told: str | None) -> None:
    assert read(tmp_path, f"{PLAIN}delimiter: {given}\n").delimiter == told


# --- What is refused ---------------------------------------------------------------------------

NOT_ONE = "expected one with x and y, forward and turn, or left and right"
REFUSED = [
    ("", "m.yaml: is empty, expected a mapping with format and columns"),
    ("# nothing\n", "m.yaml: is empty, expected a mapping with format and columns"),
    ("columns: {t: t}\n", "m.yaml: format is missing, expected one of csv, json, ros"),
    ("- csv\n", f"m.yaml:1: found a list, expected {KEYS}"),
    ("csv\n", f'm.yaml:1: found "csv", expected {KEYS}'),
    ("format: carmen\n", 'm.yaml:1: format, found "carmen", expected one of csv, json, ros'),
    ("format: jsn\n",
     'm.yaml:1: format, found "jsn", expected one of csv, json, ros, did you mean "json"?'),
    ("format: [csv]\n", "m.yaml:1: format, found a list, expected one value"),
    (PLAIN + "colums: {}\n", 'm.yaml:3: unknown key "colums", did you mean "columns"?'),
    (PLAIN + "q: 1\n", f'm.yaml:3: unknown key "q", expected one of {KEYS}'),
    (PLAIN + "gap: 1\ngap: 2\n", 'm.yaml:4: "gap" is given twice'),
    (CSV + "columns: {t: t, x: x, Y: y}\n", 'm.yaml:2: unknown key "Y"'),
    (CSV + "columns: {t: t, x: x, y: y, yaww: w}\n",
     'm.yaml:2: unknown key "yaww", did you mean "yaw"?'),
    (CSV + "columns: [t, x, y]\n", f"m.yaml:2: found a list, expected {ROLES}"),
    (CSV + "columns:\n", f'm.yaml:2: found "", expected {ROLES}'),
    (CSV + "columns: {t: t, x: [x], y: y}\n", "m.yaml:2: x, found a list, expected one value"),
    (CSV + 'columns: {t: t, x: "", y: y}\n',
     'm.yaml:2: x, found "", expected where it stands'),
    (CSV + "columns: {x: x, y: y}\n",
     "m.yaml: no column t, expected one, or the key period in seconds"),
    (CSV + "columns: {t: t, x: x}\n", f"m.yaml:1: no table with the robot's place, {NOT_ONE}"),
    (CSV, f"m.yaml:1: no table with the robot's place, {NOT_ONE}"),
    (CSV + "tables: []\n", f"m.yaml:2: no table with the robot's place, {NOT_ONE}"),
    (CSV + "columns: {t: t, x: x, y: y, forward: f, turn: u}\n",
     "m.yaml:1: the place comes from more than one of x y, forward turn, left right; expected one"),
    (CSV + "columns: {t: t, left: l, right: r}\n",
     "m.yaml:1: left and right are ticks, expected the key ticks to say what they are worth"),
    (CSV + "columns: {t: t, x: x, y: y, qx: a, qw: b}\n",
     "m.yaml:1: found qw, qx, expected qx, qy, qz and qw together"),
    (CSV + "columns: {t: t, x: x, y: y, vx: a}\n",
     "m.yaml:1: found one of vx and vy, expected both or none"),
    (CSV + "columns: {t: t, x: x, y: y, vx: a, vy: b}\nvelocity_in_body: true\n",
     "m.yaml:1: velocity_in_body needs the body's heading in the table of vx and vy"),
    # Tables
    (CSV + "tables: 5\n", 'm.yaml:2: tables, found "5", expected a list of tables'),
    (CSV + "tables:\n  - 5\n", 'm.yaml:3: found "5", expected file, columns, beams, scan'),
    (CSV + "tables:\n  - {columns: {t: t, x: x, y: y}}\n  - {file: b}\n",
     "m.yaml:3: file is missing"),
    (CSV + "tables:\n  - {topic: /a, columns: {t: t, x: x, y: y}}\n",
     'm.yaml:3: unknown key "topic", expected one of file, columns, beams, scan'),
    ("format: ros\ntables:\n  - {file: a}\n",
     'm.yaml:3: unknown key "file", expected one of topic, columns, beams, scan'),
    (CSV + 'tables:\n  - {file: "*_*.csv", columns: {t: t, x: x, y: y}}\n',
     'm.yaml:3: file, found "*_*.csv", expected at most one *'),
    (PLAIN + "tables: [{file: a}]\n",
     "m.yaml:2: columns, found a mapping, expected it inside tables"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {yaw: w}}\n",
     "m.yaml: a table without a column t, expected one, or the key period in seconds"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {t: t, x: x, y: y}}\n",
     f"m.yaml:3: 2 tables with the robot's place, {NOT_ONE}"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y, yaw: w}}\n"
     "  - {file: b, columns: {t: t, yaw: w}}\n",
     "m.yaml:3: 2 tables with the body's heading, expected one"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {t: t, vx: a, vy: b}}\n",
     "m.yaml:3: vx and vy check the place, expected them in the table that gives it"),
    # Beams
    (PLAIN + "beams: 5\n", 'm.yaml:3: beams, found "5", expected a list of beams'),
    (PLAIN + "beams: [5]\n", 'm.yaml:3: found "5", expected column, angle_deg, x, y'),
    (PLAIN + "beams:\n  - {column: r}\n", "m.yaml:4: angle_deg is missing"),
    (PLAIN + "beams:\n  - {angle_deg: 0}\n", "m.yaml:4: column is missing"),
    (PLAIN + "beams:\n  - {column: r, angle: 0}\n",
     'm.yaml:4: unknown key "angle", did you mean "angle_deg"?'),
    (PLAIN + "beams: [{column: r, angle_deg: left}]\n",
     'm.yaml:3: angle_deg, found "left", expected a number'),
    (PLAIN + "beams: [{column: r, angle_deg: .nan}]\n",
     'm.yaml:3: angle_deg, found ".nan", expected a number'),
    (PLAIN + "beams: [{column: r, angle_deg: 1e9}]\n",
     'm.yaml:3: angle_deg, found "1e9", expected a number within ±1e6'),
    (PLAIN + "beams: [{column: r, angle_deg: 0, x: 11}]\n",
     'm.yaml:3: x, found "11", expected at most 10 m from the robot\'s middle'),
    (PLAIN + "beams: [{column: r, angle_deg: 0}]\nscan: {column: r, first_deg: 0, step_deg: 1}\n",
     "m.yaml:1: beams, found a mapping, expected beams or a scan, not both"),
    # Scans
    (PLAIN + "scan: [r]\n",
     "m.yaml:3: found a list, expected column, first_deg, step_deg, count, x, y"),
    (PLAIN + "scan: {column: r, first_deg: 0}\n", "m.yaml:3: step_deg is missing"),
    (PLAIN + "scan: {column: r, first_deg: 0, step_deg: 1, count: 0}\n",
     'm.yaml:3: count, found "0", expected a whole number, 1 to 100000'),
    (PLAIN + "scan: {column: r, first_deg: 0, step_deg: 1, count: 2.5}\n",
     'm.yaml:3: count, found "2.5", expected a whole number, 1 to 100000'),
    (PLAIN + "scan: {column: r, first_deg: 0, step_deg: 1, count: 1e6}\n",
     'm.yaml:3: count, found "1e6", expected a whole number, 1 to 100000'),
    # Ticks
    (CSV + "columns: {t: t, left: l, right: r}\nticks: {track: 0.5}\n",
     "m.yaml:3: ticks, found a mapping, expected metres_per_tick, or left and right"),
    (CSV + "columns: {t: t, left: l, right: r}\nticks: {metres_per_tick: 1}\n",
     "m.yaml:3: track is missing"),
    (CSV + "columns: {t: t, left: l, right: r}\nticks: {metres_per_tick: 0, track: 1}\n",
     'm.yaml:3: metres_per_tick, found "0", expected a number > 0'),
    (CSV + "columns: {t: t, left: l, right: r}\nticks: {metres_per_tick: 1, track: -1}\n",
     'm.yaml:3: track, found "-1", expected a number > 0'),
    (CSV + "columns: {t: t, left: l, right: r}\nticks: {metres_per_tick: 1, track: 1, warp: 9}\n",
     'm.yaml:3: unknown key "warp", did you mean "wrap"?'),
    (CSV + "columns: {t: t, left: l, right: r}\n"
     "ticks: {metres_per_tick: 1, track: 1, cumulative: no}\n",
     'm.yaml:3: cumulative, found "no", expected one of true, false'),
    # The rest
    (PLAIN + "units: {length: km}\n",
     'm.yaml:3: length, found "km", expected one of m, cm, mm, in, ft'),
    (PLAIN + "units: {lenght: m}\n", 'm.yaml:3: unknown key "lenght", did you mean "length"?'),
    (PLAIN + "delimiter: ab\n",
     'm.yaml:3: delimiter, found "ab", expected one character, tab, or whitespace'),
    (PLAIN + "delimiter: '\"'\n",
     'm.yaml:3: delimiter, found "\\"", expected one character, tab, or whitespace'),
    (PLAIN + 'delimiter: ""\n',
     'm.yaml:3: delimiter, found "", expected one character, tab, or whitespace'),
    (PLAIN + "header: yes\n", 'm.yaml:3: header, found "yes", expected one of true, false'),
    (PLAIN + "rows: a\n", "m.yaml:3: rows is for json, the format is csv"),
    (PLAIN.replace("csv", "json") + "header: false\n",
     "m.yaml:3: header is for csv, the format is json"),
    (PLAIN.replace("csv", "json") + "delimiter: tab\n",
     "m.yaml:3: delimiter is for csv, the format is json"),
    ("format: ros\ncomment: a\ntables: [{topic: /a}]\n",
     "m.yaml:2: comment is for csv, the format is ros"),
    (PLAIN + "period: 0\n", 'm.yaml:3: period, found "0", expected a number > 0'),
    (PLAIN + "guard: -1\n", 'm.yaml:3: guard, found "-1", expected a number >= 0'),
    (PLAIN + "gap: 0\n", 'm.yaml:3: gap, found "0", expected a number > 0'),
    (PLAIN + "gap: true\n", 'm.yaml:3: gap, found "true", expected a number'),
    (PLAIN + "nothing: 81\n", 'm.yaml:3: found "81", expected values, above'),
    (PLAIN + "nothing: {below: 1}\n",
     'm.yaml:3: unknown key "below", expected one of values, above'),
    (PLAIN + "invalid: {values: 5}\n", 'm.yaml:3: values, found "5", expected a list of numbers'),
    (PLAIN + "invalid: {values: [a]}\n", 'm.yaml:3: values, found "a", expected a number'),
    (PLAIN + "invalid: {above: far}\n", 'm.yaml:3: above, found "far", expected a number'),
    # YAML itself
    (PLAIN + "gap: [\n",
     "m.yaml:4: not YAML: while parsing a flow node: expected the node content"),
    (PLAIN + "\tgap: 1\n", "m.yaml:3: not YAML: "),
    ("a: " + "[" * 5000, "m.yaml:1: nested too deep, expected name: value"),
    ("a: &a [*a]\n", "m.yaml:1: an alias inside of what it names"),
    (CSV + "columns: &a {t: *a, x: x, y: y}\n", "m.yaml:2: an alias inside of what it names"),
    (CSV + "tables: &a [*a]\n", "m.yaml:2: an alias inside of what it names"),
    ("format: csv\x00", "m.yaml: not YAML: unacceptable character"),
    ("a: 1\n---\nb: 1\n", "m.yaml:2: not YAML: expected a single document in the stream"),
    ("x" * (1 << 20) + "y",
     "m.yaml: larger than 1 MiB, expected a mapping of a recording's columns"),
    ("{a: 1}: b\n", "m.yaml:1: found a mapping for a name"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told"), REFUSED)
def test_what_a_mapping_cannot_say_is_refused_with_its_line(
    tmp_path: Path, text: str, told: str
) -> None:
    found = refusal(tmp_path, text)
    assert found.startswith(told)
    assert len(found) < 400


def test_a_mapping_of_many_aliases_is_refused_soon(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    found = refusal(tmp_path, "\n".join(lines))
    assert found == "m.yaml:6: found more than 300000 values, with all aliases"


def test_a_mapping_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_bytes(b"format: \xff")
    with pytest.raises(SettingsError, match=r"m\.yaml: not UTF-8 text, expected a mapping"):
        read_mapping(path)


def test_a_mapping_that_is_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot be read: Is a directory"):
        read_mapping(tmp_path)
