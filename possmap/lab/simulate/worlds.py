"""The ``world:`` of a mission as YAML: walls, rooms and obstacles, or where to take them from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import yaml

from possmap.errors import SettingsError, did_you_mean, printable, shown
from possmap.lab.simulate.floor_plan import Rectangle, Wall, sides, united
from possmap.lab.simulate.generate import LARGEST, SMALLEST, office
from possmap.lab.simulate.world import Segments
from possmap.lab.simulate.world_parts import Entries, read_rectangles, read_rooms, read_walls
from possmap.settings.yaml_nodes import (
    file_path,
    members,
    number,
    numbers,
    place,
    read_yaml,
    refusal,
    scalar_text,
)
from possmap.truth.plans import FINE, FINEST, Plan, read_image, read_ros_map

LARGEST_WALLS = 50_000
FARTHEST = 1e6  # [m], what a log can hold
BASES: Mapping[str, tuple[str, ...]] = {
    "file": (),
    "image": ("resolution", "origin"),
    "map": (),
    "generate": ("size", "seed"),
}
"""Where a world can be taken from, and what else that asks for."""
OWN = ("walls", "rooms", "obstacles", "drops", "home")
"""What a world says itself, or adds to the one that it takes."""
KEYS = (*OWN, *BASES, *(key for more in BASES.values() for key in more))
OVERRIDABLE = ("home", "resolution", "origin", "size", "seed")


_Inside: TypeAlias = Callable[[float, float], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """A world as read; without a home it is none yet.

    walls, drops : as in a World.
    home : and the ``file:line`` that gave it.
    solid : whether a place lies in what robots cannot enter, walls apart.
    """

    walls: Segments
    drops: Segments
    home: tuple[float, float] | None
    home_at: str
    solid: _Inside


def read_world(node: yaml.Node, name: str, folder: Path, overrides: Entries) -> Draft:
    """Read the mapping of a world.

    Parameters
    ----------
    name, folder
        Of the file that it stands in; paths in it are relative to the folder.
    overrides
        Values of ``world.KEY`` that win.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    at = place(node, name)
    entries: Entries = {}
    for key, value, line in members(node, name, "expected the keys of a world"):
        if key not in KEYS:
            guess = did_you_mean(key, KEYS) or f", expected one of {', '.join(KEYS)}"
            raise SettingsError(f"{name}:{line}: unknown key {shown(key)} of a world{guess}")
        entries[key] = value, name
    entries.update(overrides)
    bases = [key for key in BASES if key in entries]
    if len(bases) > 1:
        raise SettingsError(f"{at}: world, found {' and '.join(bases)}, expected one of them")
    for base, more in BASES.items():
        for key in more:
            if key in entries and base not in entries:
                raise SettingsError(
                    f"{place(*entries[key])}: world.{key}, which only a world with {base}: has"
                )
    draft = _BASE[bases[0]](entries, folder) if bases else _NOTHING
    draft = _with_own(draft, entries)
    if not len(draft.walls):
        raise SettingsError(f"{at}: world, found no walls, expected some")
    if len(draft.walls) > LARGEST_WALLS:
        raise SettingsError(
            f"{at}: world, found {len(draft.walls)} walls, expected at most {LARGEST_WALLS}"
        )
    if np.abs(draft.walls).max() > FARTHEST:
        raise SettingsError(f"{at}: world, found walls beyond 1e6 m, expected them within ±1e6 m")
    return draft


def _with_own(base: Draft, entries: Entries) -> Draft:
    """Return a world with what its own keys add: walls, rooms, obstacles, drops, home."""
    walls = read_walls(entries)
    doors: list[Wall] = []
    for room, of_room in read_rooms(entries):
        walls += sides(room)
        doors += of_room
        if len(doors) > LARGEST_WALLS:  # a few lines of YAML can repeat one list without end
            raise refusal(
                *entries["rooms"], "world.rooms", f"expected {LARGEST_WALLS} doors at most"
            )
    things, drops = read_rectangles(entries, "obstacles"), read_rectangles(entries, "drops")
    home, home_at = base.home, base.home_at
    if "home" in entries:
        x, y = numbers(*entries["home"], "world.home", "expected [x, y]", 2)
        home, home_at = (x, y), place(*entries["home"])
    if walls or things:
        # Doors open walls, not the furniture that somebody put there.
        own = [*united(walls, doors).tolist(), *(side for thing in things for side in sides(thing))]
        everything = united([*base.walls.tolist(), *own])
    else:
        everything = base.walls
    return Draft(
        everything,
        np.concatenate([base.drops, np.array(drops, dtype=np.float64).reshape(-1, 4)]),
        home,
        home_at,
        lambda x, y: base.solid(x, y) or _in_any(things)(x, y),
    )


def _in_any(rectangles: Sequence[Rectangle]) -> _Inside:
    return lambda x, y: any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in rectangles)


_NO_BOXES = np.empty((0, 4))
_NOTHING = Draft(_NO_BOXES, _NO_BOXES, None, "", _in_any(()))


def _of_plan(plan: Plan) -> Draft:
    return Draft(plan.walls(), _NO_BOXES, None, "", lambda x, y: not plan.is_free(x, y))


def _path(entries: Entries, key: str, folder: Path) -> Path:
    return file_path(*entries[key], f"world.{key}", folder)


def _from_file(entries: Entries, folder: Path) -> Draft:
    path = _path(entries, "file", folder)
    name = printable(str(path))
    root = read_yaml(path, "a world")
    if root is None:
        raise SettingsError(f"{name}: is empty, expected a world")
    for key, _, line in members(root, name, "expected the keys of a world"):
        if key == "file":
            raise SettingsError(f"{name}:{line}: file, which a shared world cannot have again")
        if key == "world":
            raise SettingsError(
                f"{name}:{line}: world, found a mission, expected what stands under world:"
            )
    return read_world(root, name, path.parent, {})


def _from_image(entries: Entries, folder: Path) -> Draft:
    node, name = entries["image"]
    if "resolution" not in entries:
        raise SettingsError(
            f"{place(node, name)}: world.resolution is missing, expected the side of a pixel "
            f"of world.image [m]"
        )
    size = entries["resolution"]
    resolution = number(*size, "world.resolution")
    if resolution < FINEST:
        raise refusal(*size, "world.resolution", FINE)
    origin = [0.0, 0.0]
    if "origin" in entries:
        origin = numbers(*entries["origin"], "world.origin", "expected [x, y]", 2)
    return _of_plan(read_image(_path(entries, "image", folder), resolution, (origin[0], origin[1])))


def _from_map(entries: Entries, folder: Path) -> Draft:
    return _of_plan(read_ros_map(_path(entries, "map", folder)))


def _generated(entries: Entries, folder: Path) -> Draft:
    node, name = entries["generate"]
    if scalar_text(node, place(node, name), "world.generate") != "office":
        raise refusal(node, name, "world.generate", "expected office")
    if "size" not in entries:
        raise SettingsError(
            f"{place(node, name)}: world.size is missing, expected [x, y] in metres"
        )
    expected = f"expected [x, y], each {SMALLEST:g} to {LARGEST:g} m"
    x, y = numbers(*entries["size"], "world.size", expected, 2)
    if not (SMALLEST <= x <= LARGEST and SMALLEST <= y <= LARGEST):
        raise refusal(*entries["size"], "world.size", expected)
    seed = 1.0
    if "seed" in entries:
        seed = number(*entries["seed"], "world.seed")
        if seed < 0 or seed != int(seed):
            raise refusal(*entries["seed"], "world.seed", "expected a whole number >= 0")
    building = office(x, y, np.random.default_rng(int(seed)))
    home_at = place(node, name)
    return Draft(building.walls, _NO_BOXES, building.home, home_at, _in_any(building.obstacles))


_BASE: Mapping[str, Callable[[Entries, Path], Draft]] = {
    "file": _from_file,
    "image": _from_image,
    "map": _from_map,
    "generate": _generated,
}
