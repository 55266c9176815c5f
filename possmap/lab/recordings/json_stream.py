"""The entries of a list or an object deep in a JSON file, one by one, however long the file."""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from possmap.errors import RecordingError, shown
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.stream import Progress, opened

LARGEST_ENTRY = 1 << 24
"""No entry of a recording is larger [characters]."""

_TOO_LARGE = "an entry of more than 16 MiB"
_PATIENCE = 1 << 25
"""So much may be read in vain, more than of what is read well [characters]."""

_CHUNK = 1 << 18
_NAMED = 20
_SPACE = re.compile(r"[ \t\r\n]*")
_DECODER = json.JSONDecoder()

_WORDS = ("true", "false", "null", "NaN", "Infinity", "-Infinity")
_NUMBER_ENDS = frozenset(["", ".", "e", "E", "e+", "e-", "E+", "E-"])
_BEGINNINGS = _NUMBER_ENDS | {word[:n] for word in _WORDS for n in range(1, len(word))}
_ESCAPE = 12
"""Longer than the escape of a character, and than all of these [characters]."""


class _Cut(RecordingError):
    """The file ends in the middle."""


class _NotJson(RecordingError):
    """Something else than JSON stands here; to find out, ``read`` characters were read."""

    read = 0


class _Text:
    """A window on the file's text that moves on."""

    def __init__(self, path: Path, read: Any) -> None:
        self.path = path
        self._read = read
        self._decode = codecs.getincrementaldecoder("utf-8-sig")()
        self.text = ""
        self.at = 0
        self.ended = False
        self._line = 1
        self._counted = 0

    def more(self) -> bool:
        """Read on; whether there was more to read."""
        if self.ended:
            return False
        data = b""
        while len(data) < _CHUNK:  # a compressed file may give a byte at a time
            try:
                part = self._read(_CHUNK)
            except EOFError:
                part = b""
            if not part:
                self.ended = True
                break
            data += part
        if not data:
            return False
        try:
            new = self._decode.decode(data)  # at the end, part of a character is a cut like others
        except UnicodeDecodeError as error:
            line = self.line + self.text.count("\n", self.at) + data.count(b"\n", 0, error.start)
            problem = "found bytes that are not UTF-8, expected JSON"
            raise RecordingError(f"{self.path}:{line}", problem) from error
        _ = self.line
        self._counted = 0
        self.text = self.text[self.at :] + new
        self.at = 0
        return True

    @property
    def line(self) -> int:
        """The number of the line here."""
        self._line += self.text.count("\n", self._counted, self.at)
        self._counted = self.at
        return self._line

    def skip_space(self) -> str:
        """Go to the next character that is no white space, and return it; empty at the end."""
        while True:
            found = _SPACE.match(self.text, self.at)
            self.at = found.end() if found else self.at
            if self.at < len(self.text):
                return self.text[self.at]
            if not self.more():
                return ""

    def expect(self, character: str) -> None:
        found = self.skip_space()
        if not found:
            raise self.cut()
        if found != character:
            raise self.fault(f"found {shown(found)}, expected {character}")
        self.at += 1

    def skip_line(self) -> None:
        """Go to the next line."""
        while True:
            end = self.text.find("\n", self.at)
            self.at = len(self.text) if end < 0 else end + 1
            if end >= 0 or not self.more():
                return

    def value(self) -> Any:
        """Decode one value here."""
        self.skip_space()
        while True:
            try:
                value, end = _DECODER.raw_decode(self.text, self.at)
            except json.JSONDecodeError as error:
                if not self._may_go_on(error):
                    raise self.fault(f"not JSON: {error.msg}", error.pos) from None
            except RecursionError:
                raise self.fault("nested too deep", read=_PATIENCE) from None
            except ValueError:  # Python refuses to read whole numbers of thousands of digits
                raise self.fault("a number of more than 4300 digits") from None
            else:
                # Where the window ends, a number may go on.
                is_number = isinstance(value, (int, float))
                if end - self.at > LARGEST_ENTRY:
                    raise self.fault(_TOO_LARGE, read=LARGEST_ENTRY)
                if not is_number or self.text[end : end + _ESCAPE] not in _NUMBER_ENDS:
                    self.at = end
                    return value
            if len(self.text) - self.at > LARGEST_ENTRY:
                raise self.fault(_TOO_LARGE, read=LARGEST_ENTRY)
            if not self._grow():
                raise self.cut()

    def _may_go_on(self, error: json.JSONDecodeError) -> bool:
        """Whether what is no JSON here may become some when more is read."""
        rest = self.text[error.pos : error.pos + _ESCAPE]
        if error.msg.startswith("Invalid \\u"):
            return len(rest) < _ESCAPE
        return error.msg.startswith("Unterminated") or rest.rstrip() in _BEGINNINGS

    def _grow(self) -> bool:
        """Read as much again as the window holds, so that a large entry is not tried too often."""
        wanted = max(_CHUNK, len(self.text) - self.at)
        grown = False
        while wanted > 0 and self.more():
            wanted -= _CHUNK
            grown = True
        return grown

    def fault(self, problem: str, at: int | None = None, read: int = 0) -> RecordingError:
        at = self.at if at is None else at
        line = self.line + self.text.count("\n", self.at, at)
        found = _NotJson(f"{self.path}:{line}", problem)
        found.read = max(read, at - self.at)
        return found

    def cut(self) -> _Cut:
        return _Cut(f"{self.path}:{self.line}", "not JSON: the file ends too early")


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
    steps = [] if rows == "*" else [step for step in rows.split(".") if step]
    with opened(path, progress) as stream:
        text = _Text(path, stream.read1)
        for step in steps:
            _enter(text, step)
        listed = _entries(text, is_object=bool(rows))
        told = False
        while True:
            try:
                entry = next(listed, None)
            except _Cut:
                if not told:
                    raise
                tally.add("files cut short, used up to the cut", f"{path}:{text.line}")
                return
            if entry is None:
                break
            told = True
            yield entry
        if not steps and (found := text.skip_space()):
            raise text.fault(f"found {shown(found)}, expected the end of the file")


def _entries(text: _Text, is_object: bool) -> Iterator[tuple[int, str, Any]]:
    first = text.skip_space()
    if first == "[":
        return _list(text)
    if first == "{":
        return _object(text) if is_object else _lines(text)
    if not first:
        raise text.cut()
    raise text.fault(f"found {shown(first)}, expected a list or an object")


def _enter(text: _Text, step: str) -> None:
    """Go to the value of a key of the object that begins here."""
    text.expect("{")
    names: list[str] = []
    if text.skip_space() == "}":
        raise text.fault(f"found no keys, expected {shown(step)}")
    while True:
        key = text.value()
        text.expect(":")
        if key == step:
            return
        if len(names) < _NAMED:
            names.append(str(key))
        text.value()
        after = text.skip_space()
        if not after:
            raise text.cut()
        if after != ",":
            known = ", ".join(shown(name) for name in names)
            raise text.fault(f"found the keys {known}, expected {shown(step)}")
        text.at += 1


def _list(text: _Text) -> Iterator[tuple[int, str, Any]]:
    text.expect("[")
    if text.skip_space() == "]":
        text.at += 1
        return
    while True:
        text.skip_space()
        line = text.line
        yield line, "", text.value()
        if text.skip_space() != ",":
            text.expect("]")
            return
        text.at += 1


def _object(text: _Text) -> Iterator[tuple[int, str, Any]]:
    text.expect("{")
    if text.skip_space() == "}":
        text.at += 1
        return
    while True:
        text.skip_space()
        line = text.line
        key = text.value()
        if not isinstance(key, str):
            raise text.fault(f"found {shown(key)}, expected a key")
        text.expect(":")
        yield line, key, text.value()
        if text.skip_space() != ",":
            text.expect("}")
            return
        text.at += 1


def _lines(text: _Text) -> Iterator[tuple[int, str, Any]]:
    """Yield the objects of JSON Lines, one by one; give up where too much is read in vain.

    What is none may reach over many lines, each of which is then looked at for itself.
    """
    patience = _PATIENCE
    while text.skip_space():
        line, start = text.line, text.at
        try:
            value = text.value()
            patience = min(_PATIENCE, patience + max(0, text.at - start))
        except _NotJson as fault:
            patience -= fault.read
            if patience < 0:
                raise
            text.skip_line()
            value = None
        yield line, "", value
