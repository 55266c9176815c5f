"""YAML as nodes that still know their line: what reads single values, until all is bound."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from stat import S_ISREG

import yaml

from possmap.core.model import LARGEST
from possmap.errors import SettingsError, shown
from possmap.settings.yaml_file import is_null, kind, parse_yaml, read_yaml

__all__ = ["is_null", "kind", "parse_yaml", "read_yaml"]

_SHORT = 6  # entries of a list that a message repeats
NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


def members(node: yaml.Node, name: str, expected: str) -> Iterator[tuple[str, yaml.Node, int]]:
    """Yield key, value and line of a mapping, each key once.

    Raises
    ------
    SettingsError
        ``name:line: what is wrong``, if it is no mapping, or gives a key twice.
    """
    line = node.start_mark.line + 1
    if not isinstance(node, yaml.MappingNode):
        raise SettingsError(f"{name}:{line}: found {kind(node)}, {expected}")
    seen: set[str] = set()
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise SettingsError(f"{name}:{line}: found {kind(key)} for a name, {expected}")
        if key.value in seen:
            raise SettingsError(f"{name}:{line}: {shown(key.value)} is given twice")
        seen.add(key.value)
        yield key.value, value, line


def scalar_text(node: yaml.Node, origin: str, key: str) -> str:
    """Return a single value as it was written.

    Raises
    ------
    SettingsError
        ``origin: key, what was found``, for a list or a mapping.
    """
    if not isinstance(node, yaml.ScalarNode):
        raise SettingsError(f"{origin}: {key}, found {kind(node)}, expected one value")
    return str(node.value)


def place(node: yaml.Node, name: str) -> str:
    """Return where a node stands, ``file:line``; an option of the command line has no lines."""
    return name if name.startswith("--") else f"{name}:{node.start_mark.line + 1}"


def items(node: yaml.Node, name: str, key: str, expected: str) -> list[yaml.Node]:
    """Return the entries of a list; none if it says nothing.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    if is_null(node):
        return []
    if not isinstance(node, yaml.SequenceNode):
        raise refusal(node, name, key, expected)
    entries: list[yaml.Node] = node.value
    return entries


def number(node: yaml.Node, name: str, key: str, expected: str = "expected a number") -> float:
    """Return a number within ±1e6.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    if not (isinstance(node, yaml.ScalarNode) and NUMBER.fullmatch(node.value)):
        raise refusal(node, name, key, expected)
    value = float(node.value)
    if not -LARGEST <= value <= LARGEST:
        raise refusal(node, name, key, "expected a number within ±1e6")
    return value + 0.0


def numbers(node: yaml.Node, name: str, key: str, expected: str, count: int) -> list[float]:
    """Return a list of so many numbers.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    entries = items(node, name, key, expected)
    if len(entries) != count:
        raise refusal(node, name, key, expected)
    try:
        return [number(entry, name, key, expected) for entry in entries]
    except SettingsError:
        raise refusal(node, name, key, f"{expected}, numbers within ±1e6") from None


def file_path(node: yaml.Node, name: str, key: str, folder: Path) -> Path:
    """Return the path that a node names, relative to a folder.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found``, for what cannot be a path.
    """
    text = scalar_text(node, place(node, name), key)
    if not text or "\0" in text:
        raise refusal(node, name, key, "expected the path of a file")
    path = folder / text
    try:
        mode = path.stat().st_mode
    except OSError:
        return path  # opening it says why
    if not S_ISREG(mode):  # opening a FIFO, or a terminal, would wait for ever
        raise refusal(node, name, key, "expected the path of a file, a regular one")
    return path


def refusal(node: yaml.Node, name: str, key: str, expected: str) -> SettingsError:
    """Return the error for a value that is not what was expected."""
    found = kind(node)
    if isinstance(node, yaml.SequenceNode) and 0 < len(node.value) <= _SHORT:
        words = [entry.value for entry in node.value if isinstance(entry, yaml.ScalarNode)]
        if len(words) == len(node.value):
            found = shown(words).replace('"', "")
    return SettingsError(f"{place(node, name)}: {key}, found {found}, {expected}")
