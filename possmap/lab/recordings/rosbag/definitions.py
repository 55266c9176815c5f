"""Message definitions of a bag, looked at before rosbags makes code of them.

rosbags compiles each definition and runs what it made. So only what it can be trusted with gets
there: plain names, lists that are not laid out by the million, types that do not multiply.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc

Types: TypeAlias = Mapping[str, tuple[Sequence[Any], Sequence[tuple[str, "FieldDesc"]]]]
"""Type -> constants and fields, as rosbags has them."""

LONGEST_TEXT = 1 << 20
"""No definition is longer [characters]; those of ROS have some thousands."""

MOST_VALUES = 100_000
"""A message may consist of so many single values, lists of numbers counted as one."""

LONGEST_LIST = 1_000_000
"""No list in a message is longer; the scan of a laser has some thousands of readings."""

_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags.interfaces.Nodetype
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_LITERALS = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_ANNOTATION = re.compile(r"@[\w:]+\s*\([^()]*\)", re.ASCII)
_COMPUTED = re.compile(r"[(]|<<|>>")


class _Size(NamedTuple):
    """Of how many values a type consists; how many of them take bytes in every message."""

    values: int
    bytes: int


class DefinitionError(Exception):
    """A definition that is not given to rosbags; the message says why."""


def check_text(text: str, is_idl: bool) -> None:
    """Refuse text that rosbags would take too long over.

    Of IDL, it tries nested parentheses in some seventy ways for each level, and computes shifts.
    Messages of robots have neither.

    Raises
    ------
    DefinitionError
        If it is too long, or computes.
    """
    if len(text) > LONGEST_TEXT:
        raise DefinitionError(f"of {len(text)} characters, expected at most {LONGEST_TEXT}")
    if is_idl:
        found = _COMPUTED.search(_ANNOTATION.sub(" ", _LITERALS.sub("0", text)))
        if found is not None:
            raise DefinitionError(f"found {found[0]} in an expression, expected plain values")


def check_types(types: Types) -> None:
    """Refuse types of which rosbags would make code without end, or other code than it should.

    Raises
    ------
    DefinitionError
        For a name that is none, or a type that holds too much.
    """
    for name, (_, fields) in types.items():
        names = [str(desc[1]) for desc in map(_inner, fields) if desc[0] == _NAME]
        if not all(map(_TYPE_NAME.fullmatch, (name, *names))):
            raise DefinitionError("found a type whose name is none")
        if not all(_FIELD_NAME.fullmatch(field) for field, _ in fields):
            raise DefinitionError("found a field whose name is none")
    sizes: dict[str, _Size] = {}
    for name in types:
        _measure(name, types, sizes)


def _inner(field: tuple[str, FieldDesc]) -> Any:
    """Return what a field consists of; of a list, what its entries do."""
    desc: Any = field[1]
    return desc if desc[0] in (_BASE, _NAME) else desc[1][0]


def _measure(root: str, types: Types, sizes: dict[str, _Size]) -> None:
    """Measure a type, and those that it holds, without recursing."""
    waiting = [(root, False)]
    open_ones: set[str] = set()
    while waiting:
        name, is_ready = waiting.pop()
        if name in sizes or name not in types:
            continue
        if not is_ready:
            if name in open_ones:
                raise DefinitionError("found a type that holds itself")
            open_ones.add(name)
            waiting.append((name, True))
            parts = [_inner(field) for field in types[name][1]]
            waiting += [(str(part[1]), False) for part in parts if part[0] == _NAME]
            continue
        open_ones.discard(name)
        found = [_size(field[1], sizes) for field in types[name][1]]
        size = _Size(1 + sum(one.values for one in found), sum(one.bytes for one in found))
        if size.values > MOST_VALUES:
            raise DefinitionError(f"found a type of more than {MOST_VALUES} values")
        sizes[name] = size


def _size(desc: Any, sizes: Mapping[str, _Size]) -> _Size:
    if desc[0] == _BASE:
        return _Size(1, 1)
    if desc[0] == _NAME:
        return sizes.get(desc[1], _Size(1, 1))
    inner, length = desc[1]
    one = _size(inner, sizes)
    if not one.bytes:  # a few bytes could announce millions of it
        raise DefinitionError("found a list of messages that hold nothing")
    if desc[0] != _ARRAY:
        return one
    is_one = inner[0] == _BASE and inner[1][0] != "string"  # one array of numpy
    return _Size(one.values * (1 if is_one else max(1, length)), min(1, length))
