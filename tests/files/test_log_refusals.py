"""Logs whose records, header or form cannot be trusted: the exact message, with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from possmap.errors import LogError
from possmap.logs import read_log
from possmap.settings.limits import Limits

HEADER = '{"possmap_log": 1, "robot": "r1", "excursion": "a"}'
CARRIED = '{"robot": "r2", "excursion": "b"}'
POSE = '"kind": "pose", "x": 0, "y": 0, "heading": 0'
WALL = '"kind": "wall", "x": 0, "y": 0, "x2": 1, "y2": 0'
BEAM = WALL.replace("wall", "beam")
CORNER = '"kind": "corner", "x": 0, "y": 0, "corner": "end"'
STILL = '"turned": false, ' + POSE
MEET = '"kind": "meet", "peer": "b", "peer_excursion": "c"'

NO_ROBOT = "robot is missing, a log needs it"
NO_QUOTES = "not JSON: Expecting property name enclosed in double quotes (column 1)"
NO_HEADER = "expected a header line with possmap_log, robot and excursion first"
RECORDS_INSIDE = "records: a header line holds no records: one record a line follows it"
UNNAMED = "is empty, every row names its robot and excursion"
OBJECT = "found 5, expected an object"
NAME_EXPECTED = "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -"
NEVER_NEGATIVE = (
    "along", "across", "turn_spread", "turn_noise", "drift_spread", "alignment_spread",
    "wall_noise", "wall_tilt", "sensor",
)  # fmt: skip
BELOW, ZERO = "found -0.5, expected a number >= 0", "found 0, expected a number > 0"
PARAMETERS = (
    "along, across, turn_bias, turn_gain, turn_spread, turn_noise, drift, drift_spread, scale, "
    "alignment_spread, wall_noise, wall_tilt, sensor, max_error, factor, "
    "frame_x, frame_y, frame_heading"
)


def refusal(folder: Path, name: str, text: str, limits: Limits | None = None) -> str:
    """Return why a file is refused, without the folder in front."""
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(LogError) as caught:
        read_log(path, limits or Limits())
    return str(caught.value).removeprefix(f"{folder}/")


def json_log(*records: str, header: str = '"robot": "r1",\n"excursion": "a",\n') -> str:
    """Write a JSON log, a line for each record: the first of them is line 5."""
    return '{"possmap_log": 1,\n' + header + '"records": [\n' + ",\n".join(records) + "\n]}\n"


def record(seq: int, rest: str) -> str:
    return f'{{"seq": {seq}, {rest}}}'


# --- What spans records -----------------------------------------------------------------------

SPANNING = [
    ([record(1, POSE)], 0, "seq", "found 1, expected 0, the first record's seq"),
    ([record(0, POSE), record(0, WALL)], 1, "seq", "found 0, expected more than 0, the one before"),
    (
        [record(0, POSE), record(7, WALL), record(6, POSE)],
        2,
        "seq",
        "found 6, expected more than 7, the one before",
    ),
    (
        [record(0, '"t": 5, ' + POSE), record(1, WALL), record(2, '"t": 4.5, ' + POSE)],
        2,
        "t",
        "found 4.5, expected 5.0 or later",
    ),
    (
        [record(0, STILL), record(1, STILL), record(2, WALL), record(3, STILL.replace("0", "2"))],
        3,
        "turned",
        "found false at (2.0, 2.0), expected the place of the pose before, (0.0, 0.0)",
    ),
    *(
        ([record(0, MEET), record(1, early)], 1, "kind",
         "expected a pose before the first wall, corner or beam")
        for early in (WALL, BEAM, CORNER)
    ),
]  # fmt: skip


@pytest.mark.parametrize(("records", "bad", "field", "problem"), SPANNING)
def test_records_out_of_order_are_refused_in_every_encoding(
    records: list[str], bad: int, field: str, problem: str, tmp_path: Path
) -> None:
    path = f"records[{bad}].{field}"
    found = refusal(tmp_path, "log.json", json_log(*records))
    assert found == f"log.json:{5 + bad}: {path}: {problem}"

    carried = json_log(header=f'"robot": "r1", "excursion": "a",\n"carried": [{CARRIED[:-1]},\n'
                       '"records": [' + ",\n".join(records) + "]}],\n")  # fmt: skip
    found = refusal(tmp_path, "log.json", carried)
    assert found == f"log.json:{4 + bad}: carried[0].{path}: {problem}"

    found = refusal(tmp_path, "log.jsonl", "\n".join([HEADER, CARRIED, *records]))
    assert found == f"log.jsonl:{3 + bad}: {field}: {problem}"

    rows = [_row(one) for one in records]
    found = refusal(tmp_path, "log.csv", "\n".join([",".join(CSV), *rows]))
    assert found == f"log.csv:{2 + bad}: {field}: {problem}"


CSV = ("robot", "excursion", "seq", "kind", "t", "x", "y", "heading", "x2", "y2", "corner", "peer",
       "peer_excursion", "turned")  # fmt: skip


def _row(one: str) -> str:
    fields = {"robot": "r1", "excursion": "a"}
    for member in one.strip("{}").replace('"', "").split(", "):
        name, _, value = member.partition(": ")
        fields[name] = value
    return ",".join(fields.get(name, "") for name in CSV)


def test_a_continued_excursion_must_go_on_where_it_stopped(tmp_path: Path) -> None:
    text = [HEADER, record(0, POSE), CARRIED, record(0, POSE), '{"robot": "r1", "excursion": "a"}']
    found = refusal(tmp_path, "log.jsonl", "\n".join([*text, record(0, POSE)]))
    assert found == "log.jsonl:6: seq: found 0, expected more than 0, the one before"


# --- Headers ----------------------------------------------------------------------------------

TOP = '{"possmap_log": 1,\n"robot": "r1",\n"excursion": "a",\n"records": []'
HEADERS = [
    # (what to replace in TOP, by what, line, problem)
    ('"possmap_log": 1,', "", 1, "possmap_log is missing, expected 1"),
    ("1", "2", 1, "possmap_log: version 2 is newer than this program reads (1)"),
    ("1", "1.0", 1, "possmap_log: found 1.0, expected 1"),
    ("1", "true", 1, "possmap_log: found true, expected 1"),
    ("1", '"1"', 1, 'possmap_log: found "1", expected 1'),
    ("1", "0", 1, "possmap_log: found 0, expected 1"),
    ("1", "null", 1, "possmap_log: found null, expected 1"),
    ('"robot": "r1",', "", 1, NO_ROBOT),
    ('"excursion": "a",', "", 1, "excursion is missing, a log needs it"),
    ('"r1"', '""', 2, f'robot: found "", {NAME_EXPECTED}'),
    ('"r1"', "7", 2, f"robot: found 7, {NAME_EXPECTED}"),
    ('"a"', f'"{"e" * 65}"', 3, f'excursion: found "{"e" * 58}..., {NAME_EXPECTED}'),
    ('"a"', '"\\u001b[2J\\u0000"', 3, f'excursion: found "\\u001b[2J\\u0000", {NAME_EXPECTED}'),
    ('"a"', '"a\\n"', 3, f'excursion: found "a\\n", {NAME_EXPECTED}'),
    ('"a",', '"a",\n"modle": {},', 4, 'modle: unknown key "modle" of a log, did you mean "model"?'),
    (
        '"a",', '"a",\n"zzz": 1,', 4,
        'zzz: unknown key "zzz" of a log, expected excursion, model, possmap_log, robot or a key '
        "that begins with x_",
    ),
    (
        '"a",', '"a",\n"\\u001b[2J": 1,', 4,
        '\\x1b[2J: unknown key "\\u001b[2J" of a log, expected excursion, model, possmap_log, '
        "robot or a key that begins with x_",
    ),
    ('"a",', '"a",\n"robot": "r2",', 2, "robot: the key is given twice"),
    ('"a",', '"a",\n"x_mine": NaN,', 4, "x_mine: found NaN, expected a finite number"),
    ('"a",', '"a",\n"x_mine": [1e999],', 4, "x_mine: found Infinity, expected a finite number"),
    ('"a",', '"a",\n"x_mine": {"a": 1, "a": 2},', 4, 'x_mine: the key "a" is given twice'),
    ('"a",', f'"a",\n"x_n":\n{"9" * 5000},', 5, "x_n: a number of more than 4300 digits"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "problem"), HEADERS)
def test_a_wrong_header_is_refused(
    old: str, new: str, line: int, problem: str, tmp_path: Path
) -> None:
    top = TOP.replace(old, new, 1) + "}\n"
    assert refusal(tmp_path, "log.json", top) == f"log.json:{line}: {problem}"


@pytest.mark.parametrize(("old", "new", "line", "problem"), HEADERS)
def test_a_wrong_header_line_is_refused(
    old: str, new: str, line: int, problem: str, tmp_path: Path
) -> None:
    wrong = TOP.replace(',\n"records": []', "").replace(old.rstrip(","), new.rstrip(","), 1)
    wrong = wrong.replace("{,", "{").replace(",\n,", ",").rstrip(",\n").replace("\n", "") + "}"
    if "given twice" in problem and "robot" in problem:
        problem = 'robot: the key "robot" is given twice'
    elif "4300" in problem:
        problem = "a number of more than 4300 digits"
    assert refusal(tmp_path, "log.jsonl", f"\n{wrong}\n") == f"log.jsonl:2: {problem}"


@pytest.mark.parametrize(
    ("carried", "problem"),
    [
        ("7", "3: carried: found 7, expected a list"),
        ("null", "3: carried: found null, expected a list"),
        ("[\n7]", "4: carried[0]: found 7, expected an object, a log"),
        ('[\n{"excursion": "b", "records": []}]', f"4: carried[0]: {NO_ROBOT}"),
        (f"[\n{CARRIED}]", "4: carried[0]: records is missing, expected a list, perhaps empty"),
        (f'[{CARRIED[:-1]},\n"records": [\n5]}}]', f"5: carried[0].records[0]: {OBJECT}"),
        (f'[{CARRIED[:-1]},\n"records": 5}}]', "4: carried[0].records: found 5, expected a list"),
        (
            f'[\n{CARRIED[:-1]},\n"possmap_log": 2, "records": [{{"kind": "arc"}}]}}]',
            "5: carried[0].possmap_log: version 2 is newer than this program reads (1)",
        ),
        (
            f'[\n{CARRIED[:-1]},\n"carried": []}}]',
            "5: carried[0].carried: a carried log carries no others: list them beside it",
        ),
    ],
)  # fmt: skip
def test_a_wrong_carried_log_is_refused(carried: str, problem: str, tmp_path: Path) -> None:
    text = f'{HEADER[:-1]},\n"records": [],\n"carried": {carried}}}\n'
    assert refusal(tmp_path, "log.json", text) == f"log.json:{problem}"


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        ("[]", "4: model: found [], expected an object"),
        ("null", "4: model: found null, expected an object"),
        (
            '{\n"turn_bais": 1}',
            '5: model.turn_bais: unknown parameter "turn_bais", did you mean "turn_bias"?',
        ),
        (
            '{\n"x_mine": 1}',
            f'5: model.x_mine: unknown parameter "x_mine", expected one of {PARAMETERS}',
        ),
        ('{"drift": 1,\n"drift": 1}', '4: model.drift: the key "drift" is given twice'),
        ('{\n"drift": true}', "5: model.drift: found true, expected a number"),
        ('{\n"drift": "1"}', '5: model.drift: found "1", expected a number'),
        ('{\n"drift": null}', "5: model.drift: found null, expected a number"),
        ('{\n"drift": NaN}', "5: model.drift: found NaN, expected a finite number"),
        ('{\n"drift": 1e999}', "5: model.drift: found Infinity, expected a finite number"),
        ('{\n"drift": 2e6}', "5: model.drift: found 2000000.0, expected a number within ±1e6"),
        *(
            (f'{{"drift": -1,\n"{name}": -0.5}}', f"5: model.{name}: {BELOW}")
            for name in NEVER_NEGATIVE
        ),
        *(
            (f'{{"turn_bias": -1,\n"{name}": 0}}', f"5: model.{name}: {ZERO}")
            for name in ("scale", "max_error", "factor")
        ),
    ],
)  # fmt: skip
def test_a_wrong_model_is_refused(model: str, problem: str, tmp_path: Path) -> None:
    text = TOP.replace('"records"', f'"model": {model}, "records"') + "}"
    assert refusal(tmp_path, "log.json", text) == f"log.json:{problem}"
    line = HEADER.replace("}", f', "model": {model}}}').replace("\n", "")
    found = refusal(tmp_path, "log.jsonl", f"{HEADER}\n{line}\n")
    assert found == f"log.jsonl:2:{problem.partition(':')[2]}"


# --- The form of each encoding ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "1: not JSON: Expecting value (column 1)"),
        ("\n\n  ", "3: not JSON: Expecting value (column 3)"),
        ("[]", "1: found [], expected an object, a log"),
        (f'{HEADER}\n', "1: records is missing, expected a list, perhaps empty"),
        (TOP.replace("[]", "null") + "}", "4: records: found null, expected a list"),
        (TOP + "}\n{}", "5: not JSON: Extra data (column 1)"),
        (TOP, "4: not JSON: Expecting '}' delimiter (column 14)"),
        (TOP.replace("1,", "1"), "2: not JSON: Expecting '}' delimiter (column 1)"),
        (TOP + ",}", "4: not JSON: Expecting value (column 15)"),
        (TOP + ",\n7: 1}", f"5: {NO_QUOTES}"),
        (TOP.replace("[]", "[{\n'seq': 1}]"), f"5: {NO_QUOTES}"),
    ],
)  # fmt: skip
def test_what_is_not_one_json_log_is_refused(text: str, problem: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, "log.json", text) == f"log.json:{problem}"


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (["", " "], "1: the file is empty, expected a header line"),
        (["", record(0, POSE)], f"2: {NO_HEADER}"),
        ([CARRIED], "1: possmap_log is missing, expected 1"),
        (['{"possmap_log": 1, "robot": "r1"}'], "1: excursion is missing, a log needs it"),
        ([HEADER, "", "[1]"], "3: found [1], expected an object"),
        ([HEADER, "{}"], "2: kind is missing, expected one of pose, wall, beam, corner, meet, fix"),
        ([HEADER, '{"seq": 0, "kind" "pose"}', ""], "2: not JSON: Expecting ':' delimiter"),
        ([HEADER, record(0, POSE) + "," + record(1, POSE), ""], "2: not JSON: Extra data"),
        ([HEADER[:-1] + ', "records": []}'], f"1: {RECORDS_INSIDE}"),
        ([HEADER[:-1] + ', "records": []}', "7"], f"1: {RECORDS_INSIDE}"),
        (
            [HEADER, CARRIED, record(0, POSE), CARRIED[:-1] + ', "model": {"drift": 1}}'],
            "4: model: differs from that of line 2, which it continues",
        ),
    ],
)  # fmt: skip
def test_what_is_not_json_lines_is_refused(lines: list[str], problem: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, "log.jsonl", "\n".join(lines)) == f"log.jsonl:{problem}"


COLUMNS = (
    "robot,excursion,seq,kind,t,x,y,heading,x2,y2,corner,followed,hit,peer,peer_excursion,upto,"
    "error_x,error_y,error_heading,turned"
)
ONE_OF = "expected one of " + COLUMNS.replace(",", ", ")
HEAD = "robot,excursion,seq,kind,x,y,heading\n"
ROW = "r1,a,0,pose,0,0,0\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", f"1: the file is empty, expected a header row: {COLUMNS}"),
        ("\n\n", f"1: the file is empty, expected a header row: {COLUMNS}"),
        ("\n" + HEAD.replace("kind", "knd"), '2: unknown column "knd", did you mean "kind"?'),
        (HEAD.replace("kind", "zzz"), f'1: unknown column "zzz", {ONE_OF}'),
        (HEAD.replace("kind", "\x1b[2J"), f'1: unknown column "\\u001b[2J", {ONE_OF}'),
        (HEAD.replace(",x,", ",x,x,"), '1: the column "x" is there twice'),
        (HEAD.replace(",x,", ",x_a,x_a,"), '1: the column "x_a" is there twice'),
        *(
            (HEAD.replace(f"{name},", ""), f"1: the column {name} is missing")
            for name in ("robot", "excursion", "seq", "kind")
        ),
        (HEAD, "1: a header row and no records below it"),
        (HEAD + ", ,\t,,,,\n\n", "1: a header row and no records below it"),
        (HEAD + ROW + "r1,a,1,pose,0,0\n", "3: found 6 fields, expected 7 as in the header"),
        (HEAD + ROW + "\nr1,a,1,pose,0,0,0,\n", "4: found 8 fields, expected 7 as in the header"),
        (HEAD + '"r1","a\nb",0,pose,0,0,0\n', f'2: excursion: found "a\\nb", {NAME_EXPECTED}'),
        (HEAD + ROW + ",a,1,pose,0,0,0\n", f"3: robot: {UNNAMED}"),
        (HEAD + ROW + "r1,,1,pose,0,0,0\n", f"3: excursion: {UNNAMED}"),
        (HEAD + "r 1,a,0,pose,0,0,0\n", f'2: robot: found "r 1", {NAME_EXPECTED}'),
        ('robot,"exc"ursion\n', "1: not CSV: ',' expected after '\"'"),
        (
            HEAD.replace("\n", ",x_a\n") + 'r1,a,0,pose,0,0,0,"\n"\n"r1"x\n',
            "4: not CSV: ',' expected after '\"'",
        ),
        (HEAD + ROW + '"r1,a\n\n', "3: not CSV: unexpected end of data"),
        (HEAD + ROW.replace("r1", "r1\0"), f'2: robot: found "r1\\u0000", {NAME_EXPECTED}'),
    ],
)  # fmt: skip
def test_what_is_not_a_table_of_logs_is_refused(text: str, problem: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, "log.csv", text) == f"log.csv:{problem}"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("log.json", f'{HEADER[:-1]},\n"new": 1,\n"records": [{{"kind": "arc"}}]}}'),
        ("log.json", f'{{"records": [], "new": 1,\n{HEADER[1:]}'),
        ("log.jsonl", f'{HEADER[:-1]}, "new": 1}}\n{{"kind": "arc"}}\n'),
    ],
)
def test_a_newer_version_is_refused_by_number_whatever_else_it_has(
    name: str, text: str, tmp_path: Path
) -> None:
    newer = text.replace('"possmap_log": 1', '"possmap_log": 12')
    found = refusal(tmp_path, name, newer).split(": ", 1)
    assert found[0] == f"{name}:{newer.count(chr(10), 0, newer.index('12')) + 1}"
    assert found[1] == "possmap_log: version 12 is newer than this program reads (1)"
