"""A mission as YAML: a world, and the settings of the team that explores it (docs/simulate.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import yaml

from possmap.errors import SettingsError, did_you_mean, printable, shown
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world import World
from possmap.lab.simulate.world_file import read_world
from possmap.settings.binder import bind
from possmap.settings.yaml_file import members, parse_yaml, required_yaml

ON_THE_COMMAND_LINE = (
    *(field.name for field in fields(MissionSettings)),
    *(f"world.{key}" for key in ("home", "resolution", "origin", "size", "seed")),
)
_OPTION = "--set"
ENOUGH = 2.0
"""Floor that a robot must reach from home [m2]; less is a cupboard."""
SHARE, MOST = 0.05, 20.0
"""So much of what the walls span it must reach too, or so much floor [m2]: a closed room is a world
of its own, but not within a building."""


@dataclass(frozen=True, slots=True)
class MissionPlan:
    """What a mission file says."""

    world: World
    settings: MissionSettings


def read_mission(path: Path, overrides: Mapping[str, str]) -> MissionPlan:
    """Read a mission file.

    Parameters
    ----------
    overrides
        Values from the command line, which win, as text, each named as in ON_THE_COMMAND_LINE;
        a list may do without brackets.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    name = printable(str(path))
    root = required_yaml(path, "a mission with a world")
    world = {key: node for key, node, _ in members(root, "expected keys of a mission")}.get("world")
    if world is None:
        raise SettingsError(f"{name}: world is missing, expected where the robots are")
    for key, text in overrides.items():
        if key not in ON_THE_COMMAND_LINE:
            guess = did_you_mean(key, ON_THE_COMMAND_LINE) or "; docs/simulate.md lists all"
            raise SettingsError(f"{_OPTION}: unknown key {shown(key)}{guess}")
        mapping = world if key.startswith("world.") else root
        if isinstance(mapping, yaml.MappingNode):
            own = key.removeprefix("world.")
            kept = [pair for pair in mapping.value if pair[0].value != own]
            mapping.value = [*kept, _pair(key, own, text)]
    root.value = [pair for pair in root.value if pair[0].value != "world"]
    settings = bind(root, MissionSettings)
    draft = read_world(world, path.parent)
    if draft.home is None:
        raise SettingsError(f"{name}: world.home is missing, expected [x, y]")
    true_world = World(path.stem, draft.walls, draft.drops, draft.home)
    x, y = draft.home
    problem = (
        "inside a wall or an obstacle, expected free floor"
        if draft.solid(x, y)
        else wrong_with_home(true_world, settings.length, settings.width)
    )
    if problem:
        raise SettingsError(f"{draft.home_at}: world.home, found [{x:g}, {y:g}], {problem}")
    return MissionPlan(true_world, settings)


def _pair(flag: str, key: str, text: str) -> tuple[yaml.Node, yaml.Node]:
    """Return what stands behind ``--set flag=`` as a key and its value."""
    listed = f"[{text}]" if "," in text and not text.lstrip().startswith("[") else text
    node = parse_yaml(listed, f"{_OPTION} {flag}")
    if node is None:
        raise SettingsError(f"{_OPTION}: {flag}, found {shown(text)}, expected a value")
    return yaml.ScalarNode("tag:yaml.org,2002:str", key, node.start_mark), node


def wrong_with_home(world: World, length: float, width: float) -> str:
    """Return why a robot cannot set out from home, and what was expected; nothing if it can.

    length, width : of its body [m].
    """
    x, y = world.home
    low_x, low_y, high_x, high_y = world.bounds
    if not (low_x <= x <= high_x and low_y <= y <= high_y):
        return (
            f"outside the walls, expected within x {low_x:g} to {high_x:g} and "
            f"y {low_y:g} to {high_y:g}"
        )
    half, apart = math.hypot(length, width) / 2, world.clearance(x, y)
    if apart < half:
        return f"{apart:.2f} m from a wall, expected at least {half:.2f} m, half the robot"
    for x0, y0, x1, y1 in world.drops.tolist():
        if x0 - half < x < x1 + half and y0 - half < y < y1 + half:
            return f"at the drop [{x0:g}, {y0:g}, {x1:g}, {y1:g}], expected {half:.2f} m off"
    enough = max(ENOUGH, min(MOST, SHARE * (high_x - low_x) * (high_y - low_y)))
    area = world.reachable(width, enough)
    if area < enough - 0.005:  # half a step of the robot that tries
        return (
            f"where walls enclose a robot {width:g} m wide: it reaches {area:.1f} m2, "
            f"expected {enough:.3g} m2 or more"
        )
    return ""
