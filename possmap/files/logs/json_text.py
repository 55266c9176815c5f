"""JSON read piece by piece, always knowing where: large logs never sit in memory twice."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from possmap.files.logs.fields import Fault, Step, unique_keys

_BLANK = re.compile(r"[ \t\n\r]*")
_DECODER = json.JSONDecoder(object_pairs_hook=unique_keys)


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
            if not self._took(","):
                self._take("]")
                return

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
