"""Every field of every kind of record, with every wrong value: the exact message, with its line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from possmap.errors import LogError
from possmap.logs import read_log
from possmap.settings.limits import Limits

LIMITS = Limits()

NINES = "9" * 59  # what a message shows of a longer number
OWN = " or a key that begins with x_"
NAME_EXPECTED = "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -"

# A valid record of each kind, values as written in JSON, and the type of each field.
RECORDS = {
    "pose": {"seq": "1", "t": "5", "x": "1", "y": "2", "heading": "3", "error_x": "0",
             "error_y": "0", "error_heading": "0", "turned": "true"},
    "wall": {"seq": "1", "t": "5", "x": "1", "y": "2", "x2": "3", "y2": "4", "followed": "true"},
    "beam": {"seq": "1", "t": "5", "x": "1", "y": "2", "x2": "3", "y2": "4", "hit": "false"},
    "corner": {"seq": "1", "t": "5", "x": "1", "y": "2", "corner": '"end"'},
    "meet": {"seq": "1", "t": "5", "peer": '"r2"', "peer_excursion": '"b"', "upto": "4"},
}  # fmt: skip
OPTIONAL = {"t", "error_x", "error_y", "error_heading", "followed", "hit", "turned", "upto"}
TYPES = {
    "seq": "whole", "upto": "whole", "t": "time", "followed": "flag", "hit": "flag",
    "turned": "flag",
    "error_x": "half-width", "error_y": "half-width", "error_heading": "half-width",
    "corner": "corner", "peer": "name", "peer_excursion": "name",
}  # fmt: skip
FIELDS = [(kind, name) for kind, fields in RECORDS.items() for name in fields]

# What is wrong for a type, as written -> what the message says after "field: ".
NO_NUMBERS_IN_JSON = {
    "true": "found true, expected a number",
    '"1.5"': 'found "1.5", expected a number',
    "null": "found null, expected a number",
    "[1]": "found [1], expected a number",
    '{"x": 1}': 'found {"x": 1}, expected a number',
    "NaN": "found NaN, expected a finite number",
    "Infinity": "found Infinity, expected a finite number",
    "-Infinity": "found -Infinity, expected a finite number",
    "1e999": "found Infinity, expected a finite number",
    "-1e999": "found -Infinity, expected a finite number",
    "9" * 400: f"found {NINES}..., expected a finite number",
}
TOO_LARGE = {
    "1000000.1": "found 1000000.1, expected a number within ±1e6",
    "-1e7": "found -10000000.0, expected a number within ±1e6",
    "1000001": "found 1000001, expected a number within ±1e6",
    "9" * 300: f"found {NINES}..., expected a number within ±1e6",
}
TOO_LATE = {
    f"{sign}1e308": f"found {sign}1e+308, expected a number within ±1e12" for sign in ("", "-")
}
NEGATIVE = {"-0.1": "found -0.1, expected a half-width >= 0"}
WRONG_IN_JSON = {
    "number": NO_NUMBERS_IN_JSON | TOO_LARGE,
    "half-width": NO_NUMBERS_IN_JSON | TOO_LARGE | NEGATIVE,
    "time": NO_NUMBERS_IN_JSON | TOO_LATE,
    "whole": {
        "true": "found true, expected a whole number",
        '"1"': 'found "1", expected a whole number',
        "null": "found null, expected a whole number",
        "1.0": "found 1.0, expected a whole number",
        "NaN": "found NaN, expected a whole number",
        "1e999": "found Infinity, expected a whole number",
        "-1": "found -1, expected 0 to 2^53 - 1",
        "9007199254740992": "found 9007199254740992, expected 0 to 2^53 - 1",
        "9" * 400: f"found {NINES}..., expected 0 to 2^53 - 1",
    },
    "flag": {
        "1": "found 1, expected true or false",
        "0.0": "found 0.0, expected true or false",
        '"true"': 'found "true", expected true or false',
        "null": "found null, expected true or false",
    },
    "corner": {
        '"concav"': 'found "concav", expected concave, convex or end, did you mean "concave"?',
        '"End"': 'found "End", expected concave, convex or end, did you mean "end"?',
        '""': 'found "", expected concave, convex or end',
        "true": "found true, expected concave, convex or end",
        "null": "found null, expected concave, convex or end",
        '["end"]': 'found ["end"], expected concave, convex or end',
    },
    "name": {
        '""': f'found "", {NAME_EXPECTED}',
        '"a b"': f'found "a b", {NAME_EXPECTED}',
        '"a\\n"': f'found "a\\n", {NAME_EXPECTED}',
        '"ä"': f'found "\\u00e4", {NAME_EXPECTED}',
        '"\\u001b[31mred"': f'found "\\u001b[31mred", {NAME_EXPECTED}',
        '"\x7f\x9b"': f'found "\\u007f\\u009b", {NAME_EXPECTED}',
        f'"{"n" * 65}"': f'found "{"n" * 58}..., {NAME_EXPECTED}',
        "7": f"found 7, {NAME_EXPECTED}",
        "true": f"found true, {NAME_EXPECTED}",
        "null": f"found null, {NAME_EXPECTED}",
    },
}
TEXT_FOR_NUMBER = {
    text: f'found "{text}", expected a number'
    for text in ("true", "NaN", "inf", "-Infinity", "1_0", "1 0", "0x1", "1,5", "e5")
} | {
    "٣": 'found "\\u0663", expected a number',
    "'1'": "found \"'1'\", expected a number",
    "1e999": "found Infinity, expected a finite number",
    "9" * 400: "found Infinity, expected a finite number",
    "-" + "9" * 5000: "found -Infinity, expected a finite number",
    "1" * 100_000 + "x": f'found "{"1" * 58}..., expected a number',  # at once, not in minutes
}
LARGE_TEXT = {
    "1000000.1": "found 1000000.1, expected a number within ±1e6",
    "-1e7": "found -10000000.0, expected a number within ±1e6",
}
WRONG_IN_CSV = {
    "number": TEXT_FOR_NUMBER | LARGE_TEXT,
    "half-width": TEXT_FOR_NUMBER | LARGE_TEXT | NEGATIVE,
    "time": TEXT_FOR_NUMBER | TOO_LATE,
    "whole": {
        "true": 'found "true", expected a whole number',
        "1.5": 'found "1.5", expected a whole number',
        "1e2": 'found "1e2", expected a whole number',
        "-1": "found -1, expected 0 to 2^53 - 1",
        "9007199254740992": "found 9007199254740992, expected 0 to 2^53 - 1",
        "9" * 400: f'found "{"9" * 58}..., expected a whole number',
    },
    "flag": {text: f'found "{text}", expected true or false' for text in ("wahr", "1", "yes")},
    "corner": {
        "concav": 'found "concav", expected concave, convex or end, did you mean "concave"?'
    },
    "name": {
        "a b": f'found "a b", {NAME_EXPECTED}',
        "\x1b[31mred": f'found "\\u001b[31mred", {NAME_EXPECTED}',
        "n" * 65: f'found "{"n" * 58}..., {NAME_EXPECTED}',
    },
}


def refusal(path: Path, text: str) -> str:
    """Return why a file is refused, without the folder in front."""
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(LogError) as caught:
        read_log(path, LIMITS)
    return str(caught.value).removeprefix(f"{path.parent}/")


# Each way to write a start pose and a second record: yields the text and the place of a field.


def as_json(kind: str, fields: dict[str, str], name: str) -> tuple[str, str]:
    members = ",\n".join(
        f'   "{key}": {text}' for key, text in {"kind": f'"{kind}"', **fields}.items()
    )
    text = (
        '{\n "possmap_log": 1,\n "robot": "r1",\n "excursion": "a",\n "records": [\n'
        '  {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0},\n'
        f"  {{\n{members}\n  }}\n ]\n}}\n"
    )
    where = text.find(f'   "{name}": ')
    line = text.count("\n", 0, where) + 1 if where >= 0 else 7
    return text, f"log.json:{line}: records[1]"


def as_carried(kind: str, fields: dict[str, str], name: str) -> tuple[str, str]:
    text, place = as_json(kind, fields, name)
    inner = text.replace(' "possmap_log": 1,\n', "")
    head = '{"possmap_log": 1, "robot": "r9", "excursion": "a", "records": [],\n"carried":\n['
    line = int(place.split(":")[1]) + 1  # two lines more above it, one less in it
    return f"{head}{inner}]}}\n", f"log.json:{line}: carried[0].records[1]"


def as_json_line(kind: str, fields: dict[str, str], name: str) -> tuple[str, str]:
    members = ", ".join(f'"{key}": {text}' for key, text in {"kind": f'"{kind}"', **fields}.items())
    text = (
        '{"possmap_log": 1, "robot": "r1", "excursion": "a"}\n\n'
        '{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}\n'
        f"{{{members}}}\n"
    )
    return text, "log.jsonl:4:"


def as_csv_row(kind: str, fields: dict[str, str]) -> str:
    names = list(dict.fromkeys([*RECORDS["pose"], *fields]))

    def row(kind: str, record: dict[str, str]) -> str:
        return f"r1,a,{kind}," + ",".join(
            '"' + record.get(name, "").replace('"', '""') + '"' for name in names
        )

    start = {"seq": "0", "x": "0", "y": "0", "heading": "0"}
    head = "robot,excursion,kind," + ",".join(names)
    return f"{head}\n{row('pose', start)}\n\n{row(kind, fields)}\n"


Writer = Callable[[str, dict[str, str], str], tuple[str, str]]
WRITERS: list[Writer] = [as_json, as_carried, as_json_line]


def message(place: str, field: str, problem: str) -> str:
    """Join them as each encoding does: JSON has a path, the others the field alone."""
    path = f"{place}.{field}" if place.endswith("]") else f"{place} {field}"
    return f"{path}: {problem}"


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_a_wrong_value_in_json_is_refused_with_its_place(
    kind: str, name: str, write: Writer, tmp_path: Path
) -> None:
    found, expected = {}, {}
    for token, problem in WRONG_IN_JSON[TYPES.get(name, "number")].items():
        text, place = write(kind, RECORDS[kind] | {name: token}, name)
        suffix = place.partition(":")[0]
        found[token] = refusal(tmp_path / suffix, text)
        expected[token] = message(place, name, problem)
    assert found == expected


@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_a_wrong_value_in_csv_is_refused_with_its_line(
    kind: str, name: str, tmp_path: Path
) -> None:
    plain = {key: token.strip('"') for key, token in RECORDS[kind].items()}
    found, expected = {}, {}
    for token, problem in WRONG_IN_CSV[TYPES.get(name, "number")].items():
        found[token] = refusal(tmp_path / "log.csv", as_csv_row(kind, plain | {name: token}))
        expected[token] = f"log.csv:4: {name}: {problem}"
    assert found == expected


@pytest.mark.parametrize(("kind", "name"), [one for one in FIELDS if one[1] not in OPTIONAL])
def test_a_missing_field_is_named(kind: str, name: str, tmp_path: Path) -> None:
    rest = {key: token for key, token in RECORDS[kind].items() if key != name}
    problem = f"{name} is missing, a {kind} needs it"
    for write in WRITERS:
        text, place = write(kind, rest, name)
        path = tmp_path / place.partition(":")[0]
        assert refusal(path, text) == f"{place.removesuffix(':')}: {problem}"
    plain = {key: token.strip('"') for key, token in rest.items()}
    text = as_csv_row(kind, plain | {name: ""})
    assert refusal(tmp_path / "log.csv", text) == f"log.csv:4: {problem}"


@pytest.mark.parametrize(("kind", "name"), [("pose", "x"), ("meet", "upto")])
@pytest.mark.parametrize("write", WRITERS)
def test_a_value_that_no_json_reader_takes_is_refused_with_its_record(
    kind: str, name: str, write: Writer, tmp_path: Path
) -> None:
    fields = RECORDS[kind]
    text, place = write(kind, fields | {name: "9" * 5000}, "no such field")
    expected = f"{place.removesuffix(':')}: a number of more than 4300 digits"
    assert refusal(tmp_path / place.partition(":")[0], text) == expected
    token = fields[name]
    text, place = write(kind, fields | {name: f'{token}, "{name}": {token}'}, name)
    problem = f'the key "{name}" is given twice'
    assert refusal(tmp_path / place.partition(":")[0], text) == message(place, name, problem)


@pytest.mark.parametrize(
    ("kind", "key", "hint"),
    [
        ("pose", "headin", ', did you mean "heading"?'),
        ("pose", "x2", ', did you mean "x"?'),
        ("wall", "hit", f", expected followed, kind, seq, t, x, x2, y, y2{OWN}"),
        ("meet", "robot", f", expected kind, peer, peer_excursion, seq, t, upto{OWN}"),
    ],
)
def test_an_unknown_key_gets_a_hint(kind: str, key: str, hint: str, tmp_path: Path) -> None:
    for write in WRITERS:
        text, place = write(kind, RECORDS[kind] | {key: "1"}, key)
        path = tmp_path / place.partition(":")[0]
        problem = f'unknown key "{key}" of a {kind}{hint}'
        assert refusal(path, text) == message(place, key, problem)


KINDS = "pose, wall, beam, corner, meet, fix"


@pytest.mark.parametrize(
    ("token", "problem"),
    [
        ('"wal"', f'found "wal", expected one of {KINDS}, did you mean "wall"?'),
        ('"\\u001b[2J"', f'found "\\u001b[2J", expected one of {KINDS}'),
        ("null", f"found null, expected one of {KINDS}"),
        ('["pose"]', f'found ["pose"], expected one of {KINDS}'),
    ],
)
def test_an_unknown_kind_is_refused(token: str, problem: str, tmp_path: Path) -> None:
    for write in WRITERS:
        text, place = write("pose", RECORDS["pose"], "kind")
        head, _, tail = text.rpartition('"kind": "pose"')
        path = tmp_path / place.partition(":")[0]
        found = refusal(path, f'{head}"kind": {token}{tail}')
        assert found == message(place, "kind", problem)


def test_a_row_with_an_unknown_kind_or_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    wall = {"seq": "1", "x": "1"}
    assert refusal(path, as_csv_row("wal", wall)) == (
        f'log.csv:4: kind: found "wal", expected one of {KINDS}, did you mean "wall"?'
    )
    assert refusal(path, as_csv_row("", wall)) == (
        f"log.csv:4: kind is missing, expected one of {KINDS}"
    )
    assert refusal(path, as_csv_row("corner", wall | {"heading": "3"})) == (
        'log.csv:4: heading: unknown key "heading" of a corner, expected corner, kind, seq, t, x, '
        "y or a key that begins with x_"
    )
