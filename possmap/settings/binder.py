"""YAML bound to dataclasses: every key known, every value of its field's type and bounds.

A type says all: ``float``, ``int``, ``bool``, ``str``, a ``Literal`` of words, ``X | None``,
``tuple[X, ...]``, ``Mapping[str, X]``, a dataclass ({key: value}), a NamedTuple ([x, y]).
``Annotated`` adds a Range, a function that takes the value and returns what it stands for (its
ValueError says what was expected), or a string: the meaning, for people.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin

import yaml

from possmap.errors import SettingsError, did_you_mean, shown
from possmap.settings.kinds import Kind, is_dataclass, kind_of, kinds_of
from possmap.settings.yaml_file import is_null, members, place, refusal, required_yaml

T = TypeVar("T")

_LISTED = 200
"""So many characters of known keys does a message hold."""


def _of_a_file(text: str) -> str:
    if not text or "\0" in text:
        raise ValueError("expected the path of a file")
    return text


FileName: TypeAlias = Annotated[str, _of_a_file]


def bind_file(path: Path, cls: type[T], what: str, ignore: bool = False) -> T:
    """Return what a YAML file says, as an instance of a dataclass.

    Parameters
    ----------
    what
        What the file should be, for messages: ``a mission``.
    ignore
        Whether unknown keys are somebody else's and pass.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    return bind(required_yaml(path, what), cls, ignore=ignore)


def bind(node: yaml.Node, cls: type[T], key: str = "", ignore: bool = False) -> T:
    """Return what a node says, as an instance of a dataclass or a NamedTuple.

    Parameters
    ----------
    key
        Path to the node, for messages: ``world.rooms[0]``.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    hint: Any = cls
    bound: T = _bound(node, kind_of(hint), key, ignore)
    return bound


def _bound(node: yaml.Node, kind: Kind, key: str, ignore: bool = False) -> Any:
    value = _READERS.get(get_origin(kind.of), _plain)(node, kind, key, ignore)
    try:
        for become in kind.becomes:
            value = become(value)
    except ValueError as error:
        raise refusal(node, key, str(error)) from None
    return value


def _plain(node: yaml.Node, kind: Kind, key: str, ignore: bool) -> Any:
    if is_dataclass(kind.of):
        return _record(node, kind.of, key, ignore)
    if hasattr(kind.of, "_fields"):
        return _row(node, kind.of, key)
    if not isinstance(node, yaml.ScalarNode):
        raise refusal(node, key, "expected one value")
    try:
        return kind.parse(str(node.value))
    except ValueError as error:
        raise refusal(node, key, str(error)) from None


def _record(node: yaml.Node, cls: Any, key: str, ignore: bool) -> Any:
    """Return a dataclass; its own ValueError may begin with the key that it is about."""
    kinds = kinds_of(cls)
    nodes = {}
    for name, value, line in members(node, f"expected {_some(kinds)}", key):
        if name in kinds:
            nodes[name] = value
        elif not ignore:
            guess = did_you_mean(name, kinds) or f", expected one of {_some(kinds)}"
            where = f" of {key}" if key else ""
            raise SettingsError(f"{place(line)}: unknown key {shown(name)}{where}{guess}")
    for field in dataclasses.fields(cls):
        if field.name not in nodes and field.default is field.default_factory:  # both missing
            expected = kinds[field.name].meaning
            raise SettingsError(
                f"{place(node)}: {_path(key, field.name)} is missing"
                f"{expected and f', expected {expected}'}"
            )
    values = {name: _bound(part, kinds[name], _path(key, name)) for name, part in nodes.items()}
    try:
        return cls(**values)
    except ValueError as error:
        name = re.split(r"\W", str(error), maxsplit=1)[0]
        if name in kinds:
            at = place(nodes.get(name, node))
            raise SettingsError(f"{at}: {_path(key, str(error))}") from None
        raise SettingsError(f"{place(node)}: {f'{key}, ' * bool(key)}{error}") from None


def _row(node: yaml.Node, cls: Any, key: str) -> Any:
    """Return a NamedTuple, written as a list of its fields in their order."""
    kinds = kinds_of(cls)
    if not isinstance(node, yaml.SequenceNode) or len(node.value) != len(kinds):
        raise refusal(node, key, f"expected [{', '.join(kinds)}]")
    parts = zip(node.value, kinds.items(), strict=True)
    return cls(*(_bound(part, kind, _path(key, name)) for part, (name, kind) in parts))


def _list(node: yaml.Node, kind: Kind, key: str, _: bool) -> tuple[Any, ...]:
    """Return entries of one kind; one word alone is a list of one."""
    each = kind_of(get_args(kind.of)[0])
    if is_null(node):
        return ()
    if isinstance(node, yaml.SequenceNode):
        return tuple(_bound(one, each, f"{key}[{n}]") for n, one in enumerate(node.value))
    if isinstance(node, yaml.ScalarNode) and (each.of is str or get_origin(each.of) is Literal):
        return (_bound(node, each, key),)
    raise refusal(node, key, "expected a list")


def _mapping(node: yaml.Node, kind: Kind, key: str, _: bool) -> dict[str, Any]:
    """Return values of one kind by their names, which may be of a few."""
    names, values = map(kind_of, get_args(kind.of))
    found = {}
    for name, value, line in members(node, f"expected {kind.meaning or 'name: value'}", key):
        try:
            names.parse(name)
        except ValueError as error:
            raise SettingsError(f"{place(line)}: unknown key {shown(name)}, {error}") from None
        found[name] = _bound(value, values, _path(key, name))
    return found


_READERS: Mapping[Any, Callable[[yaml.Node, Kind, str, bool], Any]] = {
    tuple: _list,
    Mapping: _mapping,
}


def _path(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _some(names: Mapping[str, Kind]) -> str:
    text = ", ".join(names)
    return text if len(text) <= _LISTED else text[:_LISTED].rpartition(",")[0] + ", ..."
