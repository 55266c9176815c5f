"""The entries of a list or an object deep in a JSON file, one by one, however long the file."""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from possmap.errors import RecordingError, shown
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.stream import Progress, head_of, lines, opened

LARGEST_ENTRY = 1 << 24
"""No entry of a recording is larger [characters]."""

_CUT = "files cut short, used up to the cut"
_CHUNK = 1 << 18
_NAMED = 20
_SPACE = re.compile(r"[ \t\r\n]*")
_DECODER = json.JSONDecoder()
_NEAR = 12
"""An error nearer than this to the end of what was read may be none when more is [characters]."""

_WORDS = ("true", "false", "null", "NaN", "Infinity", "-Infinity")
_NUMBER_ENDS = frozenset(["", ".", "e", "E", "e+", "e-", "E+", "E-"])
_BEGINNINGS = _NUMBER_ENDS | {word[:n] for word in _WORDS for n in range(1, len(word))}


class _CutShort(RecordingError):
    """The file ends in the middle."""


class _Text:
    """A window on the file's text that moves on."""

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        self._path = path
        self._stream = stream
        self._decode = codecs.getincrementaldecoder("utf-8-sig")()
        self._text = ""
        self._at = 0
        self._line = 1
        self._counted = 0

    @property
    def line(self) -> int:
        """The number of the line here."""
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at
        return self._line

    def peek(self) -> str:
        """Go to the next character that is no white space, and return it; empty at the end."""
        while True:
            found = _SPACE.match(self._text, self._at)
            self._at = found.end() if found else self._at
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._read(_CHUNK):
                return ""

    def take(self, character: str) -> bool:
        """Go past a character; whether it stands here."""
        found = self.peek() == character
        self._at += found
        return found

    def expect(self, character: str) -> None:
        """Go past a character that must stand here."""
        if not self.take(character):
            self.fail(f"found {shown(self.peek())}, expected {character}")

    def value(self) -> Any:
        """Decode one value here."""
        self.peek()
        while True:
            start = self._at
            error: json.JSONDecodeError | None = None
            try:
                value, end = _DECODER.raw_decode(self._text, start)
            except json.JSONDecodeError as fault:
                value, end, error = None, fault.pos, fault
            except RecursionError:
                self.fail("nested too deep")
            except ValueError:  # Python refuses to read whole numbers of thousands of digits
                self.fail("a number of more than 4300 digits")
            if end - start > LARGEST_ENTRY:
                self.fail("an entry of more than 16 MiB")
            is_sure = end + _NEAR <= len(self._text)
            if error is None and is_sure:
                self._at = end
                return value
            if error is not None and is_sure and not error.msg.startswith("Unterminated"):
                self.fail(f"not JSON: {error.msg}", end)
            if len(self._text) - start > LARGEST_ENTRY:
                self.fail("an entry of more than 16 MiB")
            # As much again as there is, so that a large entry is not tried too often.
            if not self._read(max(_CHUNK, len(self._text) - start)):
                return self._last(value, end, error)

    def _last(self, value: Any, end: int, error: json.JSONDecodeError | None) -> Any:
        """Return the value that ends where the file does, unless it was cut."""
        rest = self._text[end:].rstrip()
        if error is not None:
            if rest in _BEGINNINGS or error.msg.startswith(("Unterminated", "Invalid \\u")):
                self._fail_cut()
            self.fail(f"not JSON: {error.msg}", end)
        if isinstance(value, (int, float)) and rest in _NUMBER_ENDS:
            self._fail_cut()
        self._at = end
        return value

    def fail(self, problem: str, at: int | None = None) -> NoReturn:
        """Raise an error for what stands here; for a file that ends here, another one."""
        if at is None and not self.peek():
            self._fail_cut()
        line = self.line + self._text.count("\n", self._at, self._at if at is None else at)
        raise RecordingError(f"{self._path}:{line}", problem)

    def _fail_cut(self) -> NoReturn:
        raise _CutShort(f"{self._path}:{self.line}", "not JSON: the file ends too early")

    def _read(self, size: int) -> bool:
        """Read on, so many bytes or to the end; whether there was more to read."""
        data = bytearray()
        while len(data) < size:  # a compressed file may give a byte at a time
            try:
                part = self._stream.read1(_CHUNK)  # type: ignore[attr-defined]
            except EOFError:
                part = b""
            if not part:
                break
            data += part
        if not data:
            return False
        try:
            new = self._decode.decode(bytes(data))  # at the end, part of a character is a cut
        except UnicodeDecodeError as error:
            line = self.line + self._text.count("\n", self._at) + data.count(b"\n", 0, error.start)
            problem = "found bytes that are not UTF-8, expected JSON"
            raise RecordingError(f"{self._path}:{line}", problem) from error
        _ = self.line
        self._text = self._text[self._at :] + new
        self._at = self._counted = 0
        return True


def entries(
    path: Path, rows: str, tally: Tally, progress: Progress | None = None
) -> Iterator[tuple[int, str, Any]]:
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
    if not rows and head_of(path).lstrip(codecs.BOM_UTF8 + b" \t\r\n")[:1] == b"{":
        yield from _lines(path, tally, progress)
        return
    with opened(path, progress) as stream:
        text = _Text(path, stream)
        for step in rows.split(".") if rows not in ("", "*") else ():
            _enter(text, step)
        told = False
        try:
            for entry in _entries(text, is_object=bool(rows)):
                told = True
                yield entry
        except _CutShort:
            if not told:
                raise
            tally.add(_CUT, f"{path}:{text.line}")
            return
        if rows in ("", "*") and (found := text.peek()):
            text.fail(f"found {shown(found)}, expected the end of the file")


def _lines(path: Path, tally: Tally, progress: Progress | None) -> Iterator[tuple[int, str, Any]]:
    for number, line in lines(path, tally, progress):
        if number == 1:
            line = line.removeprefix(codecs.BOM_UTF8)
        if not line.strip():
            continue
        try:
            value = json.loads(line)
        except (ValueError, RecursionError):
            if not line.endswith(b"\n"):
                if number == 1:
                    raise _CutShort(f"{path}:1", "not JSON: the file ends too early") from None
                tally.add(_CUT, f"{path}:{number}")
                return
            value = None
        yield number, "", value


def _entries(text: _Text, is_object: bool) -> Iterator[tuple[int, str, Any]]:
    """Yield the entries of the list or object that begins here."""
    is_list = text.take("[")
    if not is_list and not (is_object and text.take("{")):
        text.fail(f"found {shown(text.peek())}, expected a list or an object")
    end = "]" if is_list else "}"
    if text.take(end):
        return
    while True:
        text.peek()
        line = text.line
        key = "" if is_list else _key(text)
        yield line, key, text.value()
        if not text.take(","):
            text.expect(end)
            return


def _key(text: _Text) -> str:
    key = text.value()
    if not isinstance(key, str):
        text.fail(f"found {shown(key)}, expected a key")
    text.expect(":")
    return key


def _enter(text: _Text, step: str) -> None:
    """Go to the value of a key of the object that begins here."""
    text.expect("{")
    names: list[str] = []
    if text.take("}"):
        text.fail(f"found no keys, expected {shown(step)}", 0)
    while True:
        key = _key(text)
        if key == step:
            return
        if len(names) < _NAMED:
            names.append(key)
        text.value()
        if not text.take(","):
            known = ", ".join(shown(name) for name in names)
            text.fail(f"found the keys {known}, expected {shown(step)}")
