"""A mission as YAML: a world, and the settings of the team that explores it (docs/simulate.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeAlias, get_type_hints

import yaml

from possmap.errors import SettingsError, did_you_mean, printable, shown
from possmap.lab.simulate.reachable import check_home
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world import World
from possmap.lab.simulate.world_parts import Entries
from possmap.lab.simulate.worlds import OVERRIDABLE, Draft, read_world
from possmap.settings.yaml_nodes import (
    items,
    members,
    number,
    parse_yaml,
    place,
    read_yaml,
    refusal,
    scalar_text,
)

_Value: TypeAlias = bool | int | float | tuple[str, ...]

_TYPES: Mapping[str, object] = get_type_hints(MissionSettings)
SETTINGS = tuple(field.name for field in fields(MissionSettings))
WORLD = "world."
"""What the name of a world's value begins with on the command line."""
_FROM_COMMAND_LINE = "--set"


@dataclass(frozen=True, slots=True)
class Mission:
    """What a mission file says."""

    world: World
    settings: MissionSettings


def read_mission(path: Path, overrides: Mapping[str, str]) -> Mission:
    """Read a mission file.

    Parameters
    ----------
    overrides
        Values from the command line, which win, as text: each is named by a field of
        MissionSettings or ``world.home``, ``.resolution``, ``.origin``, ``.size``, ``.seed``;
        a list may do without brackets.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    name = printable(str(path))
    root = read_yaml(path, "a mission")
    if root is None:
        raise SettingsError(f"{name}: is empty, expected a mission with a world")
    given: Entries = {}
    for key, node, line in members(root, name, "expected the keys of a mission"):
        _check_key(key, ("world", *SETTINGS), f"{name}:{line}")
        given[key] = node, name
    of_world: Entries = {}
    for key, text in overrides.items():
        _check_key(key, (*SETTINGS, *(WORLD + part for part in OVERRIDABLE)), _FROM_COMMAND_LINE)
        value = _from_text(key, text), _FROM_COMMAND_LINE
        if key.startswith(WORLD):
            of_world[key.removeprefix(WORLD)] = value
        else:
            given[key] = value
    if "world" not in given:
        raise SettingsError(f"{name}: world is missing, expected where the robots are")
    draft = read_world(*given.pop("world"), path.parent, of_world)
    settings = _settings(given, name)
    return Mission(_world(draft, path, name, settings), settings)


def _check_key(key: str, known: tuple[str, ...], origin: str) -> None:
    if key not in known:
        guess = did_you_mean(key, known) or "; docs/simulate.md lists the known ones"
        raise SettingsError(f"{origin}: unknown key {shown(key)}{guess}")


def _from_text(key: str, text: str) -> yaml.Node:
    """Return what stands behind ``--set key=``."""
    listed = "," in text and not text.lstrip().startswith("[")
    node = parse_yaml(f"[{text}]" if listed else text, f"{_FROM_COMMAND_LINE} {key}")
    if node is None:
        raise SettingsError(f"{_FROM_COMMAND_LINE}: {key}, found nothing, expected a value")
    return node


def _settings(given: Entries, name: str) -> MissionSettings:
    values = {key: _value(key, *entry) for key, entry in given.items()}
    try:
        return MissionSettings(**values)  # type: ignore[arg-type]  # read by each field's type
    except ValueError as error:
        key = str(error).partition(",")[0]
        origin = place(*given[key]) if key in given else name
        raise SettingsError(f"{origin}: {printable(str(error))}") from None


def _value(key: str, node: yaml.Node, name: str) -> _Value:
    """Return the value of a setting, read as its field's type asks."""
    if _TYPES[key] is float:
        return number(node, name, key)
    if _TYPES[key] is bool:
        text = scalar_text(node, place(node, name), key)
        if text not in ("true", "false"):
            raise refusal(node, name, key, "expected true or false")
        return text == "true"
    if _TYPES[key] is int:
        text = scalar_text(node, place(node, name), key)
        if not re.fullmatch(r"[+-]?[0-9]{1,15}", text):
            raise refusal(node, name, key, "expected a whole number")
        return int(text)
    if isinstance(node, yaml.ScalarNode):
        return (str(node.value),)
    entries = items(node, name, key, "expected a list")
    return tuple(scalar_text(entry, place(entry, name), key) for entry in entries)


def _world(draft: Draft, path: Path, name: str, settings: MissionSettings) -> World:
    """Return the finished world, with a home from which robots can set out."""
    if draft.home is None:
        raise SettingsError(f"{name}: world.home is missing, expected [x, y]")
    x, y = draft.home
    world = World(path.stem, draft.walls, draft.drops, draft.home)
    if draft.solid(x, y):
        raise SettingsError(
            f"{draft.home_at}: world.home, found [{x:g}, {y:g}], inside a wall or an obstacle, "
            "expected free floor"
        )
    try:
        check_home(world, settings.length, settings.width)
    except ValueError as error:
        raise SettingsError(f"{draft.home_at}: world.{error}") from None
    return world
