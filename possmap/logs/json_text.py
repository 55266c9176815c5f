"""JSON read piece by piece, always knowing where: large logs never sit in memory twice."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from possmap.logs.fields import Fault, Step, unique_keys

_BLANKS = " \t\n\r"
_BLANK = re.compile(r"[ \t\n\r]*")
_COMMA = re.compile(r",[ \t\n\r]*")
_DECODER = json.JSONDecoder(object_pairs_hook=unique_keys)
SHORT = 1 << 20
"""Of a text of at most so many characters a list may be decoded whole."""

_QUICK = json.JSONDecoder().raw_decode
"""Stays in C for a whole value, but does not tell a key given twice."""


class JsonSyntaxError(Exception):
    """Text that is not JSON, at a position."""

    def __init__(self, position: int, problem: str) -> None:
        super().__init__(problem)
        self.position = position


class JsonText:
    """A cursor over JSON text. What a walk yields, the caller consumes before asking for more."""

    def __init__(self, text: str, position: int = 0) -> None:
        self.text = text
        self.position = _skip(text, position)

    def line(self, position: int) -> int:
        """Return the line number of a position, from 1."""
        return self.text.count("\n", 0, position) + 1

    def value(self) -> object:
        """Consume one value and return it decoded.

        Raises
        ------
        JsonSyntaxError
            Where the text is not JSON.
        Fault
            For nesting or a number beyond what Python reads at all.
        """
        try:
            value, end = _DECODER.raw_decode(self.text, self.position)
        except json.JSONDecodeError as error:
            is_marked = self.text.startswith("\ufeff", error.pos)
            problem = "Unexpected byte-order mark" if is_marked else error.msg
            raise JsonSyntaxError(error.pos, problem) from None
        except RecursionError:
            raise Fault((), "nested too deep (setting limit_nesting)") from None
        except ValueError:  # Python refuses to read whole numbers of thousands of digits
            raise Fault((), "a number of more than 4300 digits") from None
        self.position = _skip(self.text, end)
        found: object = value
        return found

    def plain_objects(self) -> list[dict[str, object]] | None:
        """Consume a list of plain objects in one go, in a third of the time.

        Return None, and consume nothing, if it is none, or might be long. A plain object has a
        colon behind each key and nowhere else. One colon more than keys, and one may hold a key
        twice, an object of its own or a colon in a text: that needs a closer look, one by one, as
        does what is not JSON.
        """
        text, start = self.text, self.position
        if len(text) > SHORT or not self.is_at("["):
            return None
        try:
            found, end = _QUICK(text, start)
        except (ValueError, RecursionError):
            return None
        if not set(map(type, found)) <= {dict}:
            return None
        if text.count(":", start, end) != sum(map(len, found)):
            return None
        self.position = _skip(text, end)
        objects: list[dict[str, object]] = found
        return objects

    def record(self) -> object:
        """Consume one value, as ``value`` does, sooner if it is a plain object (see above).

        Raises
        ------
        JsonSyntaxError, Fault
            As ``value``.
        """
        text, start = self.text, self.position
        try:
            found, end = _QUICK(text, start)
        except (ValueError, RecursionError):
            return self.value()  # which says what is wrong
        if type(found) is dict and len(found) == text.count(":", start, end):
            self.position = _skip(text, end)
            return found
        return self.value()

    def is_at(self, character: str) -> bool:
        """Whether the next character is this one."""
        return self.text.startswith(character, self.position)

    def members(self) -> Iterator[str]:
        """Walk an object: yield each key, the cursor at its value."""
        self._take("{")
        seen: set[str] = set()
        if self._took("}"):
            return
        while True:
            at = self.position
            key = self.value()
            if not isinstance(key, str):
                raise JsonSyntaxError(at, "Expecting property name enclosed in double quotes")
            if key in seen:
                raise Fault((key,), "the key is given twice")
            seen.add(key)
            self._take(":")
            yield key
            if not self._took(","):
                self._take("}")
                return

    def items(self) -> Iterator[int]:
        """Walk a list: yield each index, the cursor at the item."""
        self._take("[")
        if self._took("]"):
            return
        index = 0
        while True:
            yield index
            index += 1
            comma = _COMMA.match(self.text, self.position)
            if comma is None:
                self._take("]")
                return
            self.position = comma.end()

    def end(self) -> None:
        """Raise JsonSyntaxError unless all text is consumed."""
        if self.position < len(self.text):
            raise JsonSyntaxError(self.position, "Extra data")

    def _took(self, character: str) -> bool:
        if not self.is_at(character):
            return False
        self.position = _skip(self.text, self.position + 1)
        return True

    def _take(self, character: str) -> None:
        if not self._took(character):
            raise JsonSyntaxError(self.position, f"Expecting '{character}' delimiter")


def _skip(text: str, position: int) -> int:
    if text[position : position + 1] not in _BLANKS:  # mostly: sooner than the search
        return position
    blank = _BLANK.match(text, position)
    return blank.end() if blank else position


def find(text: str, start: int, path: tuple[Step, ...]) -> int:
    """Return the position of the value at ``path`` below ``start``, or of the last step found."""
    cursor = JsonText(text, start)
    try:
        for step in path:
            begin = cursor.position
            walk: Iterator[Step]
            if cursor.is_at("{"):
                walk = cursor.members()
            elif cursor.is_at("["):
                walk = cursor.items()
            else:
                return begin
            for found in walk:
                if found == step:
                    break
                cursor.value()
            else:
                return begin
    except (JsonSyntaxError, Fault):  # already reported at a better place
        pass
    return cursor.position
