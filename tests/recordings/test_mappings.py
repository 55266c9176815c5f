"""Mappings as YAML: what every key says, and the exact refusal of what it cannot say."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from possmap.errors import SettingsError
from possmap.lab.recordings.beams import BeamColumn, Scan
from possmap.lab.recordings.mapping import (
    Invalid,
    Mapping,
    Nothing,
    Table,
    Units,
    find_mapping,
    read_mapping,
)
from possmap.settings.shipped import shipped_names

CSV = "format: csv\n"
PLAIN = CSV + "columns: {t: t, x: x, y: y}\n"


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


@pytest.mark.parametrize("name", shipped_names("recordings"))
def test_every_shipped_mapping_is_found_by_its_name_and_reads(name: str) -> None:
    mapping = read_mapping(find_mapping(name))
    assert mapping.tables
    assert mapping.format in ("csv", "json", "ros")


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
    assert mapping == Mapping(format="csv", tables=(Table(columns={"t": "t", "x": "x", "y": "y"}),))
    assert (mapping.guard, mapping.gap, mapping.period) == (0.05, 1.0, None)


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
        BeamColumn(column="9", angle_deg=math.pi / 2),
        BeamColumn(column="front", angle_deg=math.radians(-0.5), x=0.1, y=-0.2),
    )
    assert mapping.units == Units(
        time="ms", length="cm", range="mm", speed="cm/s", angle="deg", turn_rate="deg/s"
    )
    assert (mapping.delimiter, mapping.header, mapping.comment) == (";", False, "%")
    assert mapping.nothing == Nothing(values=(-1, 8190), above=4)
    assert mapping.invalid == Invalid(values=(0,), above=5, below=0.02)
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
    scan = Scan(
        column="r", first_deg=-math.pi / 2, step_deg=math.radians(0.5), count=361, x=0.2, y=-0.1
    )
    columns = {"t": "key", "forward": "v", "turn": "w[0]"}
    assert mapping.tables == (Table(columns=columns, scan=scan),)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "worth"),
    [
        ("metres_per_tick: 0.01, track: 0.5", (0.01, 0.01)),
        ("left: 0.01, right: 0.02, track: 0.5", (0.01, 0.02)),
        ("metres_per_tick: 0.01, right: 0.02, track: 0.5, wrap: 65536", (0.01, 0.02)),
    ],
)
def test_ticks(tmp_path: Path, given: str, worth: tuple[float, float]) -> None:
    text = CSV + f"columns: {{t: t, left: l, right: r}}\nticks: {{{given}}}\n"
    ticks = read(tmp_path, text).ticks
    assert ticks is not None
    assert ticks.worth == worth
    assert (ticks.track, ticks.cumulative) == (0.5, True)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ('","', ","), ('";"', ";"), ("tab", "\t"), ('"\\t"', "\t"), ("whitespace", " "),
        ('" "', " "), ("'|'", "|"),
    ],
)  # fmt: skip
def test_delimiters(tmp_path: Path, given: str, told: str | None) -> None:
    assert read(tmp_path, f"{PLAIN}delimiter: {given}\n").delimiter == told


# --- What is refused ---------------------------------------------------------------------------

NOT_ONE = "expected one with x and y, forward (with a heading), or left and right"
TICKS = CSV + "columns: {t: t, left: l, right: r}\n"
REFUSED = [
    ("# nothing\n", "m.yaml: is empty, expected a mapping with format and columns"),
    ("columns: {t: t}\n", "m.yaml:1: format is missing, expected csv, json or ros"),
    ("format: jsn\n", 'format, found "jsn", expected csv, json or ros, did you mean "json"?'),
    (PLAIN + "colums: {}\n", 'm.yaml:3: unknown key "colums", did you mean "columns"?'),
    (CSV + "columns: {t: t, x: x, y: y, yaww: w}\n", 'm.yaml:2: unknown key "yaww", expected t, x'),
    (CSV + 'columns: {t: t, x: "", y: y}\n', 'columns.x, found "", expected where it stands'),
    (CSV + "columns: {x: x, y: y}\n",
     "m.yaml: no column t, expected one, or the key period in seconds"),
    (CSV + "columns: {t: t, yaw: x}\n", f"m.yaml: no table with the robot's place, {NOT_ONE}"),
    (CSV + "columns: {t: t, x: x}\n", "m.yaml: found x without y, expected them together"),
    (CSV + "columns: {t: t, x: x, y: y, forward: f, turn: u}\n",
     "m.yaml: the place comes from x and y and from forward, expected one of them"),
    (TICKS, "left and right are ticks, expected the key ticks to say what they are worth"),
    (CSV + "columns: {t: t, x: x, y: y, qx: a, qw: b}\n",
     "found qx without qy and qz, expected them together"),
    (CSV + "columns: {t: t, x: x, y: y, vx: a}\n",
     "found vx without vy, expected them together"),
    (CSV + "columns: {t: t, x: x, y: y, vx: a, vy: b}\nvelocity_in_body: true\n",
     "velocity_in_body needs the body's heading in the table of vx and vy"),
    # Tables
    (CSV + "tables:\n  - {columns: {t: t, x: x, y: y}}\n  - {file: b}\n",
     "m.yaml:3: tables, file is missing"),
    (CSV + "tables:\n  - {topic: /a, columns: {t: t, x: x, y: y}}\n", "found topic, expected file"),
    (CSV + 'tables:\n  - {file: "*_*.csv", columns: {t: t, x: x, y: y}}\n',
     'm.yaml:3: tables[0].file, found "*_*.csv", expected at most one *'),
    (PLAIN + "tables: [{file: a}]\n", "m.yaml:2: columns, expected it inside tables"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {yaw: w}}\n",
     "m.yaml: a table without a column t, expected one, or the key period in seconds"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {t: t, x: x, y: y}}\n",
     f"2 tables with the robot's place, {NOT_ONE}"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y, yaw: w}}\n"
     "  - {file: b, columns: {t: t, yaw: w}}\n",
     "2 tables with the body's heading (yaw, yaw), expected one"),
    (CSV + "tables:\n  - {file: a, columns: {t: t, x: x, y: y}}\n"
     "  - {file: b, columns: {t: t, vx: a, vy: b}}\n",
     "vx checks the place, expected it in the table of x and y"),
    # Beams, scans, ticks
    (PLAIN + "beams:\n  - {column: r}\n", "m.yaml:4: beams[0].angle_deg is missing"),
    (PLAIN + "beams: [{column: r, angle_deg: .nan}]\n",
     'm.yaml:3: beams[0].angle_deg, found ".nan", expected a number'),
    (PLAIN + "beams: [{column: r, angle_deg: 0, x: 11}]\n",
     'm.yaml:3: beams[0].x, found "11", expected a number, -10 to 10'),
    (PLAIN + "beams: [{column: r, angle_deg: 0}]\nscan: {column: r, first_deg: 0, step_deg: 1}\n",
     "expected beams or a scan, not both"),
    (PLAIN + "scan: {column: r, first_deg: 0, step_deg: 1, count: 2.5}\n",
     'm.yaml:3: scan.count, found "2.5", expected a whole number >= 1, at most 100000'),
    (TICKS + "ticks: {track: 0.5}\n",
     "m.yaml:3: ticks, expected metres_per_tick, or left and right"),
    (TICKS + "ticks: {metres_per_tick: 0, track: 1}\n",
     'm.yaml:3: ticks.metres_per_tick, found "0", expected a number > 0'),
    # The rest
    (PLAIN + "units: {length: km}\n",
     'm.yaml:3: units.length, found "km", expected m, cm, mm, in or ft'),
    (PLAIN + "delimiter: ab\n",
     'm.yaml:3: delimiter, found "ab", expected one character, tab, or whitespace'),
    (PLAIN + "rows: a\n", "m.yaml:3: rows, is for json, the format is csv"),
    ("format: ros\ncomment: a\ntables: [{topic: /a}]\n",
     "m.yaml:2: comment, is for csv, the format is ros"),
    (PLAIN + "guard: -1\n", 'm.yaml:3: guard, found "-1", expected a number >= 0'),
    (PLAIN + "nothing: {below: 1}\n", 'm.yaml:3: unknown key "below" of nothing'),
    (CSV + "tables: &a [*a]\n", "m.yaml:2: an alias inside of what it names"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told"), REFUSED)
def test_what_a_mapping_cannot_say_is_refused_with_its_line(
    tmp_path: Path, text: str, told: str
) -> None:
    assert told in refusal(tmp_path, text)
