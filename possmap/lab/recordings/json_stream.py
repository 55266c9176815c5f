"""The entries of a list or an object deep in a JSON file, one by one, however long the file."""

from __future__ import annotations

import codecs
import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BufferedReader
from pathlib import Path
from typing import Any, TypeAlias

from possmap.errors import RecordingError, shown
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.stream import Progress, head_of, lines, opened
from possmap.logs.fields import Fault
from possmap.logs.json_text import JsonSyntaxError, JsonText

_CHUNK = 1 << 18
_NAMED = 20
_CUT = "files cut short, used up to the cut"
_TOO_EARLY = "not JSON: the file ends too early"
_NOT_UTF_8 = "found bytes that are not UTF-8, expected JSON"

Entry: TypeAlias = tuple[int, str, Any]


def entries(
    path: Path, rows: str, tally: Tally, progress: Progress | None = None
) -> Iterator[Entry]:
    """Yield line, key and value of each entry; the key is empty in a list.

    Parameters
    ----------
    rows
        Path to the list or object, names parted by points; empty for an outermost list or for
        JSON Lines, ``*`` for an outermost object.

    A file that ends in the middle is counted, and what comes before is used. A line of JSON Lines
    that is none has the value None.

    Raises
    ------
    RecordingError
        ``file:line: what was found, what was expected``.
    """
    if not rows and head_of(path).removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"{"):
        return _of_lines(path, tally, progress)
    steps = [] if rows == "*" else [step for step in rows.split(".") if step]
    return _of_document(path, steps, rows == "*", tally, progress)


def _of_lines(path: Path, tally: Tally, progress: Progress | None) -> Iterator[Entry]:
    for number, line in lines(path, tally, progress):
        try:
            text = line.decode("utf-8-sig" if number == 1 else "utf-8")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path}:{number}", _NOT_UTF_8) from error
        if text.isspace():
            continue
        value = None
        with suppress(ValueError, RecursionError):
            value = json.loads(text)
        if value is None and not text.endswith("\n"):
            if number == 1:
                raise RecordingError(f"{path}:1", _TOO_EARLY)
            tally.add(_CUT, f"{path}:{number}")
            return
        yield number, "", value


def _of_document(
    path: Path, steps: list[str], is_object: bool, tally: Tally, progress: Progress | None
) -> Iterator[Entry]:
    with opened(path, progress) as stream:
        text = JsonText("", _reader(path, stream))
        told = False
        try:
            for step in steps:
                _enter(text, step)
            listed = _members(text) if is_object or (steps and text.is_at("{")) else _items(text)
            for entry in listed:
                told = True
                yield entry
            if not steps:
                text.end()
        except JsonSyntaxError as error:
            place = f"{path}:{text.line_of(error.position)}"
            if not told or not error.is_cut:
                problem = _TOO_EARLY if error.is_cut else f"not JSON: {error}"
                raise RecordingError(place, problem) from None
            tally.add(_CUT, place)
        except Fault as fault:
            problem = fault.problem.removesuffix(" (setting limit_nesting)")
            raise RecordingError(f"{path}:{text.line}", problem) from None


def _reader(path: Path, stream: BufferedReader) -> Callable[[], str]:
    """Return what reads on; at a file's end part of a character is a cut like others."""
    decoder = codecs.getincrementaldecoder("utf-8-sig")()
    line = 1

    def more() -> str:
        nonlocal line
        text = ""
        while not text:
            try:
                data = stream.read1(_CHUNK)
            except EOFError:
                data = b""
            if not data:
                return ""
            try:
                text = decoder.decode(data)
            except UnicodeDecodeError as error:
                line += error.object.count(b"\n", 0, error.start)
                raise RecordingError(f"{path}:{line}", _NOT_UTF_8) from error
            line += text.count("\n")
        return text

    return more


def _items(text: JsonText) -> Iterator[Entry]:
    for _ in text.items():
        line = text.line
        yield line, "", text.record()


def _members(text: JsonText) -> Iterator[Entry]:
    for key in text.members():
        line = text.line
        yield line, key, text.record()


def _enter(text: JsonText, step: str) -> None:
    """Go to the value of a key of the object that begins here."""
    names: list[str] = []
    for key in text.members():
        if key == step:
            return
        if len(names) < _NAMED:
            names.append(key)
        text.record()
    known = "the keys " + ", ".join(map(shown, names)) if names else "no keys"
    raise Fault((), f"found {known}, expected {shown(step)}")
