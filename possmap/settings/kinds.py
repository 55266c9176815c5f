"""What a field's type says of its values: which they are, within which range, what they mean."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

from possmap.core.ranges import WHOLE, WITHIN, Range
from possmap.errors import did_you_mean

Value: TypeAlias = bool | int | float | str

_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")
_WHOLE = re.compile(r"[+-]?[0-9]{1,15}")


@dataclasses.dataclass(frozen=True, slots=True)
class Kind:
    """The values of a field.

    of : the type without its notes.
    range : of a number.
    becomes : functions that a value goes through.
    meaning : for people, with its unit in brackets.
    """

    of: Any
    range: Range
    becomes: tuple[Callable[[Any], Any], ...]
    meaning: str

    def parse(self, text: str) -> Value:
        """Return the value of a text.

        Raises
        ------
        ValueError
            ``expected ...``, for a text that is none.
        """
        if get_origin(self.of) is Literal:
            words = [str(word) for word in get_args(self.of)]
            if text not in words:
                raise ValueError(f"expected {_or(words)}{did_you_mean(text, words)}")
            return text
        if self.of is bool:
            if text not in ("true", "false"):
                raise ValueError("expected true or false")
            return text == "true"
        if self.of is str:
            return text
        if not (_WHOLE if self.of is int else _NUMBER).fullmatch(text):
            raise ValueError(f"expected {self.range.expected}")
        value: int | float = self.of(text) + self.of(0)  # -0 is 0
        if value not in self.range:
            raise ValueError(f"expected {self.range.expected_for(value)}")
        return value


@cache
def kind_of(hint: Any, /) -> Kind:
    """Return what a type says, ``None`` as an alternative left out."""
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (one for one in get_args(hint) if one is not NoneType)
    of, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    within = [note for note in notes if isinstance(note, Range)]
    return Kind(
        of,
        within[-1] if within else WHOLE if of is int else WITHIN,
        tuple(note for note in notes if callable(note)),
        " ".join(note for note in notes if isinstance(note, str)),
    )


@cache
def kinds_of(cls: Any) -> dict[str, Kind]:
    """Return what the fields of a dataclass or a NamedTuple may hold, by name."""
    hints = get_type_hints(cls, include_extras=True)
    names = [one.name for one in dataclasses.fields(cls)] if is_dataclass(cls) else hints
    return {name: kind_of(hints[name]) for name in names}


def is_dataclass(cls: Any) -> bool:
    """Whether something is a dataclass, not an instance of one."""
    return isinstance(cls, type) and dataclasses.is_dataclass(cls)


def _or(words: list[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last
