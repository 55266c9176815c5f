"""JSON read piece by piece, always knowing where: what is large never sits in memory twice."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator

from possmap.logs.fields import Fault, Step, unique_keys

SHORT = 1 << 20
"""Of a text of at most so many characters a list may be decoded whole."""

LARGEST_VALUE = 1 << 24
"""No value of a text that is read on the way is larger [characters]."""

_MARGIN = 16
"""More than what may be missing of a number, a word or an escape where a text is cut."""

_ENDS = ("true", "false", "null", "NaN", "Infinity", "-Infinity", ".", "e+", "e-", "E+", "E-")
"""Ends of values: what a text that is cut there may stop in the middle of."""

_BLANKS = " \t\n\r"
_BLANK = re.compile(r"[ \t\n\r]*")
_COMMA = re.compile(r",[ \t\n\r]*")
_CAREFUL = json.JSONDecoder(object_pairs_hook=unique_keys).raw_decode
_QUICK = json.JSONDecoder().raw_decode
"""Stays in C for a whole value, but does not tell a key given twice."""


class JsonSyntaxError(Exception):
    """Text that is not JSON, at a position of what the cursor holds; perhaps only cut short."""

    def __init__(self, position: int, problem: str, is_cut: bool = False) -> None:
        super().__init__(problem)
        self.position = position
        self.is_cut = is_cut


class JsonText:
    """A cursor over JSON text. What a walk yields, the caller consumes before asking for more.

    Parameters
    ----------
    text
        All of it, or its beginning.
    more
        Gives what follows, piece by piece, and nothing in the end. What is consumed is forgotten.
    """

    _line, _counted = 1, 0

    def __init__(self, text: str, more: Callable[[], str] | None = None) -> None:
        self.text, self.position = text, 0
        self._more = more
        self._skip(0)

    @property
    def line(self) -> int:
        """The number of the line here, from 1."""
        return self.line_of(self.position)

    def line_of(self, position: int) -> int:
        """Return the line number of a position not before the last that was asked for."""
        self._line += self.text.count("\n", self._counted, position)
        self._counted = position
        return self._line

    def value(self) -> object:
        """Consume one value and return it decoded.

        Raises
        ------
        JsonSyntaxError
            Where the text is not JSON, or a value is too large.
        Fault
            For nesting or a number beyond what Python reads at all.
        """
        while True:
            problem = None
            try:
                value, end = _CAREFUL(self.text, self.position)
            except json.JSONDecodeError as error:
                problem, end = error.msg, error.pos
            except RecursionError:
                raise Fault((), "nested too deep (setting limit_nesting)") from None
            except ValueError:  # Python refuses to read whole numbers of thousands of digits
                raise Fault((), "a number of more than 4300 digits") from None
            is_open = len(self.text) - end < _MARGIN or (problem or "").startswith("Unterminated")
            if len(self.text) - self.position > LARGEST_VALUE and self._more and is_open:
                raise Fault((), "a value of more than 16 MiB")
            if is_open and self._read_on():  # the rest may mend it, or go on with a number
                continue
            is_cut = self._is_cut(end)
            if problem is not None:
                is_cut |= is_open and problem.startswith(("Unterminated", "Invalid \\u"))
                raise JsonSyntaxError(end, problem, is_cut)
            if is_cut and self._more and isinstance(value, int | float):  # perhaps half a number
                raise JsonSyntaxError(end, "Expecting more", is_cut)
            self._skip(end)
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
        self._skip(end)
        objects: list[dict[str, object]] = found
        return objects

    def record(self) -> object:
        """Consume one value, as ``value`` does, sooner if it is a plain object (see above) or list.

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
        if type(found) is dict:
            is_plain = len(found) == text.count(":", start, end)
        else:
            is_plain = type(found) is list and text.find("{", start, end) < 0
        if not is_plain:
            return self.value()
        self._skip(end)
        return found

    def is_at(self, character: str) -> bool:
        """Whether the next character is this one."""
        return self.text.startswith(character, self.position)

    def members(self) -> Iterator[str]:
        """Walk an object: yield each key, the cursor at its value."""
        self._take("{")
        if self._took("}"):
            return
        while True:
            at = self.position
            key = self.value()
            if not isinstance(key, str):
                raise JsonSyntaxError(at, "Expecting property name enclosed in double quotes")
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
            if comma and comma.end() < len(self.text):  # mostly: sooner than the careful way
                self.position = comma.end()
            elif not self._took(","):
                self._take("]")
                return

    def end(self) -> None:
        """Raise JsonSyntaxError unless all text is consumed."""
        if self.position < len(self.text):
            raise JsonSyntaxError(self.position, "Extra data")

    def _took(self, character: str) -> bool:
        if not self.is_at(character):
            return False
        self._skip(self.position + 1)
        return True

    def _take(self, character: str) -> None:
        if not self._took(character):
            problem = f"Expecting '{character}' delimiter"
            raise JsonSyntaxError(self.position, problem, self._is_cut(self.position))

    def _is_cut(self, position: int) -> bool:
        """Whether what is left of the text may be the beginning of something."""
        rest = self.text[position : position + _MARGIN].rstrip()
        return any(end.startswith(rest) for end in _ENDS)

    def _skip(self, position: int) -> None:
        """Go to the first character from a position on that is no blank."""
        self.position = position
        if self.text[position : position + 1] not in _BLANKS:  # mostly: sooner than the search
            return
        while True:
            blank = _BLANK.match(self.text, self.position)
            self.position = blank.end() if blank else self.position
            if self.position < len(self.text) or not self._read_on():
                return

    def _read_on(self) -> bool:
        """Read as much again as is held and not consumed; whether there was more to read."""
        if self._more is None:
            return False
        wanted = max(1, len(self.text) - self.position)
        parts: list[str] = []
        while wanted > 0 and (part := self._more()):
            parts.append(part)
            wanted -= len(part)
        if parts:
            self.line_of(self.position)
            self.text = self.text[self.position :] + "".join(parts)
            self.position = self._counted = 0
        return bool(parts)


def find(text: str, path: tuple[Step, ...]) -> int:
    """Return the position of the value at ``path``, or of the last step found."""
    cursor = JsonText(text)
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
