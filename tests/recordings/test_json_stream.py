"""JSON read piece by piece: the same as json.load gives, wherever the pieces are cut."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.errors import RecordingError
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import json_stream
from possmap.lab.recordings.json_stream import entries

CUT = "files cut short, used up to the cut"
SIZES = (1, 2, 5, 13, 64, 1 << 18)
FEW = (1, 5, 64, 1 << 18)

numbers = st.integers() | st.floats(allow_nan=False, allow_infinity=True)
texts = st.text(st.characters(codec="utf-8"), max_size=8)
values = st.recursive(
    st.none() | st.booleans() | numbers | texts,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4),
    max_leaves=8,
)
dumped = st.sampled_from([
    {}, {"indent": 1}, {"ensure_ascii": False}, {"separators": (",", ":")},
    {"indent": 2, "ensure_ascii": False},
])  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("json") / "drive.json"


@pytest.fixture(params=SIZES)
def size(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Read so many bytes at a time."""
    monkeypatch.setattr(json_stream, "_CHUNK", request.param)
    return int(request.param)


def read(path: Path, text: str | bytes, rows: str = "") -> list[tuple[int, str, Any]]:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return list(entries(path, rows, Tally()))


def found(path: Path, text: str | bytes, rows: str = "") -> list[Any]:
    return [value for _, _, value in read(path, text, rows)]


def refusal(path: Path, text: str | bytes, rows: str = "") -> str:
    with pytest.raises(RecordingError) as caught:
        read(path, text, rows)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{path}:")


# --- The same as json.load ---------------------------------------------------------------------


def at_every_size(path: Path, text: str, rows: str = "") -> Iterator[list[tuple[int, str, Any]]]:
    kept = json_stream._CHUNK
    try:
        for one in SIZES:
            json_stream._CHUNK = one
            yield read(path, text, rows)
    finally:
        json_stream._CHUNK = kept


@given(given_=st.lists(values, max_size=5), how=dumped, ends=st.sampled_from(["", "\n", " \r\n\t"]))
def test_a_list_gives_its_entries(path: Path, given_: list[Any], how: Any, ends: str) -> None:
    text = ends + json.dumps(given_, **how) + ends
    for told in at_every_size(path, text):
        assert [value for _, _, value in told] == json.loads(text)
        assert {key for _, key, _ in told} <= {""}


@given(given_=st.dictionaries(texts, values, max_size=5), how=dumped)
def test_an_object_gives_its_members(path: Path, given_: dict[str, Any], how: Any) -> None:
    text = json.dumps(given_, **how)
    for told in at_every_size(path, text, "*"):
        assert [(key, value) for _, key, value in told] == list(json.loads(text).items())


@given(
    inner=st.lists(values, max_size=3) | st.dictionaries(texts, values, max_size=3),
    beside=st.dictionaries(texts, values, max_size=3),
    names=st.lists(st.sampled_from(["a", "log", "été", "x y"]), min_size=1, max_size=3),
    how=dumped,
)
def test_a_nested_path_gives_what_lies_there(
    path: Path, inner: Any, beside: dict[str, Any], names: list[str], how: Any
) -> None:
    whole: Any = inner
    for name in reversed(names):
        whole = {key: value for key, value in beside.items() if key != name} | {name: whole, "": 1}
    text = json.dumps(whole, **how)
    expected = inner if isinstance(inner, list) else list(inner.items())
    for told in at_every_size(path, text, ".".join(names)):
        got = [value if isinstance(inner, list) else (key, value) for _, key, value in told]
        assert got == json.loads(json.dumps(expected)) or got == expected


@given(
    rows=st.lists(st.dictionaries(texts, values, max_size=3), min_size=1, max_size=5),
    end=st.sampled_from(["\n", "\r\n", "\n\n"]),
)
def test_json_lines_give_one_entry_a_line(path: Path, rows: list[Any], end: str) -> None:
    text = "".join(json.dumps(row) + end for row in rows)
    for told in at_every_size(path, text):
        assert [value for _, _, value in told] == rows


def test_a_byte_order_mark_is_passed_over(path: Path, size: int) -> None:
    assert found(path, b"\xef\xbb\xbf[1, 2]") == [1, 2]


def test_lines_are_told(path: Path, size: int) -> None:
    text = '\n{"a":\n 1, "rows": [\n5,\n\n [6,\n7], 8\n\n,9]}'
    assert [(line, value) for line, _, value in read(path, text, "rows")] == [
        (4, 5), (6, [6, 7]), (7, 8), (9, 9),
    ]  # fmt: skip


# --- Files that are cut ------------------------------------------------------------------------

ROW = {"t": 1.25, "ok": True, "name": "é\n", "raw": [1, -2.5e-3, None], "in": {"a": {}}}


@pytest.mark.parametrize("size", FEW, indirect=True)
@pytest.mark.parametrize("rows", ["", "*", "log.rows"])
def test_a_file_cut_anywhere_is_used_up_to_the_cut(path: Path, size: int, rows: str) -> None:
    text = {
        "": json.dumps([ROW] * 3, ensure_ascii=False),
        "*": json.dumps(dict.fromkeys("abc", ROW), ensure_ascii=False),
        "log.rows": json.dumps({"a": 1, "log": {"rows": [ROW] * 3}}, ensure_ascii=False),
    }[rows].encode()
    first = text.index(b"}}", text.index(b'"t"')) + 4
    last = text.rindex(b"}}}") + 3 if rows != "log.rows" else text.rindex(b"]}}")
    for length in range(first, last, 1 if size > 5 else 3):
        path.write_bytes(text[:length])
        tally = Tally()
        told = [value for _, _, value in entries(path, rows, tally)]
        assert told == [ROW] * len(told)
        assert 1 <= len(told) <= 3
        assert tally.of(CUT) == 1


@pytest.mark.parametrize("rows", ["", "log.rows", "*"])
@pytest.mark.parametrize("text", ["[", "{", '{"log": {"ro', '{"log": 1', "", '[{"a": 1', "[1"])
def test_a_file_cut_before_its_first_entry_is_refused(
    path: Path, size: int, rows: str, text: str
) -> None:
    told = refusal(path, text, rows)
    assert told == "1: not JSON: the file ends too early" or told.startswith("1: not JSON: Exp")


def test_a_last_line_of_json_lines_that_is_cut_is_counted(path: Path, size: int) -> None:
    path.write_text('{"a": 1}\n{"a": 2}\n{"a":')
    tally = Tally()
    assert [value for _, _, value in entries(path, "", tally)] == [{"a": 1}, {"a": 2}]
    assert (tally.of(CUT), tally.counts[CUT].first) == (1, f"{path}:3")


def test_a_bad_line_of_json_lines_is_nothing_and_the_next_is_read(path: Path, size: int) -> None:
    text = '{"a": 1}\n{"a": x}\n{"b" 1}\n{"a": "b\n{"a": {\n{"a": 2}\n'
    assert found(path, text) == [{"a": 1}, None, None, None, None, {"a": 2}]


# --- What cannot be used -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "rows", "told"),
    [
        ("5", "", "1: not JSON: Expecting '[' delimiter"),
        ('"a"', "", "1: not JSON: Expecting '[' delimiter"),
        ("\n\nt,x,y\n", "", "3: not JSON: Expecting '[' delimiter"),
        ("[1,\n2 3]", "", "2: not JSON: Expecting ']' delimiter"),
        ("[1,\n\n 2,,3]", "", "3: not JSON: Expecting value"),
        ("[1, 2,]", "", "1: not JSON: Expecting value"),
        ('[{"a": 1,\n\n"b" 2}]', "", "3: not JSON: Expecting ':' delimiter"),
        ('[{"a": 1}}', "", "1: not JSON: Expecting ']' delimiter"),
        ("[1] [2]", "", "1: not JSON: Extra data"),
        ("[1, 2]\n[3, 4]\n", "", "2: not JSON: Extra data"),
        ('{"a": 1} 5', "*", "1: not JSON: Extra data"),
        ('{"a" 1}', "*", "1: not JSON: Expecting ':' delimiter"),
        ("{5: 1}", "*", "1: not JSON: Expecting property name enclosed in double quotes"),
        ('{"a": 1, "b": 2}', "c", '1: found the keys "a", "b", expected "c"'),
        ("{}", "c", '1: found no keys, expected "c"'),
        ("[1]", "c", "1: not JSON: Expecting '{' delimiter"),
        ('{"c": 1}', "c.d", "1: not JSON: Expecting '{' delimiter"),
        ('{"c": 1}', "c", "1: not JSON: Expecting '[' delimiter"),
        (f"[{'[' * 100_000}", "", "1: nested too deep"),
        (f"[{'1' * 5000}]", "", "1: a number of more than 4300 digits"),
        ("[1, trux]", "", "1: not JSON: Expecting value"),
        ('["\\q"]', "", "1: not JSON: Invalid \\escape"),
        ('["\\u12x4"' + " " * 20 + "]", "", "1: not JSON: Invalid \\uXXXX escape"),
        ("\x00[1]", "", "1: not JSON: Expecting '[' delimiter"),
    ],
)
def test_what_is_not_json_is_refused_with_its_line(
    path: Path, text: str, rows: str, told: str
) -> None:
    assert refusal(path, text, rows) == told


@pytest.mark.parametrize("text", [b'[1,\n"\xff"]', b"[1,\n2, \xe4]", b'["a",\n"\xc3('])
def test_bytes_that_are_not_utf_8_are_refused_with_their_line(path: Path, text: bytes) -> None:
    assert refusal(path, text) == "2: found bytes that are not UTF-8, expected JSON"


def test_a_fault_is_told_at_once_not_at_the_end_of_a_long_file(path: Path) -> None:
    rest = b'{"a": 1}, ' * 100_000
    path.write_bytes(b'[{"a": oops}, ' + rest + b"1]")
    told: list[int] = []
    with pytest.raises(RecordingError, match="not JSON: Expecting value"):
        list(entries(path, "", Tally(), told.append))
    assert sum(told) < 600_000


def test_an_entry_too_large_is_refused_without_keeping_the_file(path: Path) -> None:
    with path.open("wb") as stream:
        stream.write(b'[{"a": 1}, "')
        for _ in range(64):
            stream.write(b"x" * (1 << 20))
        stream.write(b'"]')
    tracemalloc.start()
    with pytest.raises(RecordingError, match=r":1: a value of more than 16 MiB$"):
        list(entries(path, "", Tally()))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    path.write_bytes(b"")
    assert peak < 200 << 20


@pytest.mark.thorough
def test_a_long_file_takes_little_memory(path: Path) -> None:
    row = json.dumps({"t": 1, "range": [1.25] * 180}).encode()
    with path.open("wb") as stream:
        stream.write(b"[" + b",\n".join([row] * 20_000) + b"]")
    tracemalloc.start()
    count = sum(1 for _ in entries(path, "", Tally()))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    path.write_bytes(b"")
    assert count == 20_000
    assert peak < 8 << 20
