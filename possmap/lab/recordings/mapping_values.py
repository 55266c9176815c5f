"""Single values of a mapping's YAML, each refused with its line."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias, TypeVar

import yaml

from possmap.errors import SettingsError, did_you_mean, shown
from possmap.settings.yaml_nodes import members, number, place, refusal, scalar_text

T = TypeVar("T")
D = TypeVar("D")

Nodes: TypeAlias = dict[str, yaml.Node]


def given(nodes: Nodes, key: str, read: Callable[[yaml.Node], T], default: D) -> T | D:
    """Return what the value of a key says, or the default where there is none."""
    return read(nodes[key]) if key in nodes else default


def known_members(node: yaml.Node, name: str, known: Iterable[str]) -> Nodes:
    """Return the values of a mapping by their keys, none unknown."""
    known = tuple(known)
    found: Nodes = {}
    for key, value, line in members(node, name, f"expected {', '.join(known)}"):
        if key not in known:
            guess = did_you_mean(key, known) or f", expected one of {', '.join(known)}"
            raise SettingsError(f"{name}:{line}: unknown key {shown(key)}{guess}")
        found[key] = value
    return found


def need(parts: Nodes, keys: Iterable[str], node: yaml.Node, name: str) -> None:
    """Raise SettingsError if one of the keys is missing."""
    for key in keys:
        if key not in parts:
            raise SettingsError(f"{place(node, name)}: {key} is missing")


def text_of(node: yaml.Node, name: str, key: str) -> str:
    """Return a value as it was written."""
    return scalar_text(node, place(node, name), key)


def column_of(node: yaml.Node, name: str, key: str) -> str:
    """Return where something stands: any text but none."""
    text = text_of(node, name, key)
    if not text.strip():
        raise refusal(node, name, key, "expected where it stands")
    return text


def word(node: yaml.Node, name: str, key: str, known: tuple[str, ...]) -> str:
    """Return a value that is one of a few words."""
    text = text_of(node, name, key)
    if text not in known:
        guess = did_you_mean(text, known)
        raise refusal(node, name, key, f"expected one of {', '.join(known)}{guess}")
    return text


def flag(node: yaml.Node, name: str, key: str) -> bool:
    """Return whether a value says true."""
    return word(node, name, key, ("true", "false")) == "true"


def positive(node: yaml.Node, name: str, key: str) -> float:
    """Return a number > 0."""
    value = number(node, name, key)
    if value <= 0:
        raise refusal(node, name, key, "expected a number > 0")
    return value


def not_negative(node: yaml.Node, name: str, key: str) -> float:
    """Return a number >= 0."""
    value = number(node, name, key)
    if value < 0:
        raise refusal(node, name, key, "expected a number >= 0")
    return value


def delimiter_of(node: yaml.Node, name: str) -> str | None:
    """Return what parts columns: a character, or None for white space."""
    text = text_of(node, name, "delimiter")
    if text in ("whitespace", " "):
        return None
    if text == "tab":
        return "\t"
    if len(text) != 1 or text in '"\r\n\0':
        raise refusal(node, name, "delimiter", "expected one character, tab, or whitespace")
    return text
