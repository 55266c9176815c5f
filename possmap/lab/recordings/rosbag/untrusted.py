"""What of a stranger's bag rosbags is not given: code in a definition, views, endless metadata.

rosbags compiles each message definition and runs what it made, and SQLite runs what a view says.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.interfaces.typing import FieldDesc
    from rosbags.typesys.store import Typestore

Types: TypeAlias = Mapping[str, tuple[Sequence[Any], Sequence[tuple[str, "FieldDesc"]]]]
"""Type -> constants and fields, as rosbags has them."""

LARGEST_TEXT = 1 << 20
"""Of a definition [characters] or metadata.yaml [bytes]; those of ROS have some thousands."""

MOST_VALUES = 100_000
"""A message may consist of so many single values, lists of numbers counted as one."""

_LONGEST_LIST = 1_000_000  # in a message; the scan of a laser has some thousands of readings
_MOST_TABLES = 100
_PLAIN = re.compile(r"\s*CREATE\s+(TABLE|(UNIQUE\s+)?INDEX|TRIGGER)\b", re.IGNORECASE)
_GENERATED = re.compile(r"\b(AS|GENERATED)\b", re.IGNORECASE)
_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags.interfaces.Nodetype
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_LITERALS = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_ANNOTATION = re.compile(r"@[\w:]+\s*\([^()]*\)", re.ASCII)
_COMPUTED = re.compile(r"[(]|<<|>>")


class UntrustedError(Exception):
    """Part of a bag that could run, or grow without end; no bag needs it."""


def check_files(bag: Path) -> None:
    """Refuse databases with more than tables and indices, and metadata larger than they look.

    What is no database and no YAML, rosbags says.

    Raises
    ------
    UntrustedError
        For a view, a virtual table, a computed column; for metadata.yaml with an alias, or too
        large.
    OSError
        If one cannot be read.
    """
    if not bag.is_dir():
        _check_database(bag)
        return
    with (bag / "metadata.yaml").open("rb") as stream:
        data = stream.read(LARGEST_TEXT + 1)
    if len(data) > LARGEST_TEXT:
        raise UntrustedError("found a metadata.yaml larger than 1 MiB")
    with suppress(yaml.YAMLError, ValueError):
        for token in yaml.scan(data.decode(), Loader=yaml.SafeLoader):
            if isinstance(token, yaml.AliasToken):
                raise UntrustedError("found an alias in metadata.yaml, expected plain values")
    for path in sorted(bag.glob("*.db3")):
        _check_database(path)


def _check_database(path: Path) -> None:
    with suppress(sqlite3.Error, UnicodeError):
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            found = connection.execute(
                "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL LIMIT ?", (_MOST_TABLES + 1,)
            ).fetchall()
        if len(found) > _MOST_TABLES:
            raise UntrustedError(f"found more than {_MOST_TABLES} tables and indices")
        for (sql,) in found:
            if not isinstance(sql, str) or not _PLAIN.match(sql):
                raise UntrustedError("found a view or a virtual table, expected tables of messages")
            if _GENERATED.search(sql) and "TRIGGER" not in sql.upper():
                raise UntrustedError("found a computed column, expected tables of messages")


def store_of(connection: Connection) -> Typestore | None:
    """Return a store with the types of a connection's messages; None if nobody knows them.

    Of this topic alone (docs/decisions): what nobody reads need not be understood.

    Raises
    ------
    UntrustedError
        If its definition computes, or makes types without end; rosbags has errors of its own.
    """
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    text = connection.msgdef.data
    check_text(text, connection.msgdef.format == Form.IDL)
    if connection.msgdef.format == Form.NONE:
        # Bags tell their types since ROS 2 Iron, which also changed some of them.
        store = get_typestore(Stores.ROS2_HUMBLE)
        store.max_sequence_length = _LONGEST_LIST
        return store if connection.msgtype in store.fielddefs else None
    types = {}
    if connection.msgdef.format == Form.MSG:
        types = get_types_from_msg(text, connection.msgtype)
    else:
        line = "=" * 80 + "\n"
        parts = text.split(line)[1:] if text.startswith(f"{line}IDL: ") else [f"\n{text}"]
        for part in parts:  # each behind a line with its name
            types.update(get_types_from_idl(part.split("\n", 1)[1]))
    check_types(types)
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = _LONGEST_LIST
    store.register(types)
    return store


def check_text(text: str, is_idl: bool) -> None:
    """Refuse a definition that rosbags would take too long over.

    Of IDL, it tries nested parentheses in some seventy ways for each level, and computes shifts.

    Raises
    ------
    UntrustedError
        If it is too long, or computes.
    """
    if len(text) > LARGEST_TEXT:
        raise UntrustedError(f"of {len(text)} characters, expected at most {LARGEST_TEXT}")
    if is_idl:
        found = _COMPUTED.search(_ANNOTATION.sub(" ", _LITERALS.sub("0", text)))
        if found is not None:
            raise UntrustedError(f"found {found[0]} in an expression, expected plain values")


def check_types(types: Types) -> None:
    """Refuse types of which rosbags would make code without end, or other code than it should.

    Raises
    ------
    UntrustedError
        For a name that is none, or a type that holds itself or too much.
    """
    held = {name: [_inner(desc) for _, desc in fields] for name, (_, fields) in types.items()}
    for name, (_, fields) in types.items():
        named = [str(one[1]) for one in held[name] if one[0] == _NAME]
        if not all(map(_TYPE_NAME.fullmatch, (name, *named))):
            raise UntrustedError("found a type whose name is none")
        if not all(_FIELD_NAME.fullmatch(field) for field, _ in fields):
            raise UntrustedError("found a field whose name is none")
    sizes: dict[str, tuple[int, bool]] = {}
    waiting = [(name, False) for name in types]
    open_ones: set[str] = set()
    while waiting:  # without recursing
        name, is_ready = waiting.pop()
        if name in sizes or name not in types:
            continue
        if is_ready:
            open_ones.discard(name)
            found = [_size(desc, sizes) for _, desc in types[name][1]]
            values = 1 + sum(count for count, _ in found)
            if values > MOST_VALUES:
                raise UntrustedError(f"found a type of more than {MOST_VALUES} values")
            sizes[name] = values, any(is_told for _, is_told in found)
            continue
        if name in open_ones:
            raise UntrustedError("found a type that holds itself")
        open_ones.add(name)
        waiting.append((name, True))
        waiting += [(str(one[1]), False) for one in held[name] if one[0] == _NAME]


def _inner(desc: Any) -> Any:
    """Return what a field consists of; of a list, what its entries do."""
    return desc if desc[0] in (_BASE, _NAME) else desc[1][0]


def _size(desc: Any, sizes: Mapping[str, tuple[int, bool]]) -> tuple[int, bool]:
    """Return of how many values a field consists, and whether it takes bytes in every message."""
    if desc[0] == _BASE:
        return 1, True
    if desc[0] == _NAME:
        return sizes.get(desc[1], (1, True))
    inner, length = desc[1]
    values, is_told = _size(inner, sizes)
    if not is_told:  # a few bytes could announce millions of it
        raise UntrustedError("found a list of messages that hold nothing")
    if desc[0] != _ARRAY:
        return values, True
    is_one = inner[0] == _BASE and inner[1][0] != "string"  # one array of numpy
    return values * (1 if is_one else max(1, length)), length > 0
