"""A mission as YAML: a world, and the settings of the team that explores it (docs/simulate.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import yaml

from possmap.errors import SettingsError, did_you_mean, printable, shown
from possmap.lab.simulate.reachable import check_home
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world import World
from possmap.lab.simulate.worlds import Draft, read_world
from possmap.settings.binder import bind
from possmap.settings.yaml_file import members, parse_yaml, read_yaml

SETTINGS = tuple(field.name for field in fields(MissionSettings))
WORLD = "world"
OF_WORLD = ("home", "resolution", "origin", "size", "seed")
"""What of a world the command line may say, as ``world.home``."""
_OPTION = "--set"


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
        MissionSettings or ``world.`` and one of OF_WORLD; a list may do without brackets.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    name = printable(str(path))
    root = read_yaml(path, "a mission")
    if root is None:
        raise SettingsError(f"{name}: is empty, expected a mission with a world")
    given = {key: node for key, node, _ in members(root, "expected the keys of a mission")}
    if WORLD not in given:
        raise SettingsError(f"{name}: world is missing, expected where the robots are")
    known = (*SETTINGS, *(f"{WORLD}.{key}" for key in OF_WORLD))
    for key in overrides:
        if key not in known:
            guess = did_you_mean(key, known) or "; docs/simulate.md lists the known ones"
            raise SettingsError(f"{_OPTION}: unknown key {shown(key)}{guess}")
    world = _with(given[WORLD], overrides, f"{WORLD}.")
    settings = bind(_with(_without(root, WORLD), overrides, ""), MissionSettings)
    return Mission(_checked(read_world(world, path.parent), path, settings), settings)


def _without(root: yaml.Node, key: str) -> yaml.Node:
    pairs = [(name, value) for name, value in root.value if name.value != key]
    return yaml.MappingNode(root.tag, pairs, root.start_mark)


def _with(node: yaml.Node, overrides: Mapping[str, str], prefix: str) -> yaml.Node:
    """Return a mapping in which what the command line says replaces what the file does."""
    own = {
        key.removeprefix(prefix): text
        for key, text in overrides.items()
        if key.startswith(prefix) and "." not in key.removeprefix(prefix)
    }
    if not own or not isinstance(node, yaml.MappingNode):
        return node
    kept = [(name, value) for name, value in node.value if name.value not in own]
    added = [_pair(prefix + key, key, text) for key, text in own.items()]
    return yaml.MappingNode(node.tag, [*kept, *added], node.start_mark)


def _pair(flag: str, key: str, text: str) -> tuple[yaml.Node, yaml.Node]:
    """Return what stands behind ``--set flag=`` as a key and its value."""
    if not text:
        raise SettingsError(f"{_OPTION}: {flag}, found nothing, expected a value")
    listed = f"[{text}]" if "," in text and not text.lstrip().startswith("[") else text
    node = parse_yaml(listed, f"{_OPTION} {flag}")
    if node is None:
        raise SettingsError(f"{_OPTION}: {flag}, found {shown(text)}, expected a value")
    return yaml.ScalarNode("tag:yaml.org,2002:str", key, node.start_mark), node


def _checked(draft: Draft, path: Path, settings: MissionSettings) -> World:
    """Return the finished world, with a home from which robots can set out."""
    if draft.home is None:
        raise SettingsError(f"{printable(str(path))}: world.home is missing, expected [x, y]")
    x, y = draft.home
    world = World(path.stem, draft.walls, draft.drops, draft.home)
    try:
        if draft.solid(x, y):
            raise ValueError(
                f"home, found [{x:g}, {y:g}], inside a wall or an obstacle, expected free floor"
            )
        check_home(world, settings.length, settings.width)
    except ValueError as error:
        raise SettingsError(f"{draft.home_at}: world.{error}") from None
    return world
