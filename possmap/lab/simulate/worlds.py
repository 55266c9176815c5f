"""The ``world:`` of a mission as YAML: walls, rooms and obstacles, or where to take them from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
import yaml

from possmap.core.ranges import Number, at_least, between, whole
from possmap.errors import SettingsError, printable
from possmap.lab.simulate.floor_plan import Rectangle, Wall, sides, united
from possmap.lab.simulate.generate import LARGEST, SMALLEST, office
from possmap.settings.binder import FileName, bind
from possmap.settings.yaml_file import members, place, read_yaml, refusal
from possmap.truth.plans import FINEST, Plan, Segments, read_image, read_ros_map

LARGEST_WALLS = 50_000
FARTHEST = 1e6  # [m], what a log can hold
BASES: Mapping[str, tuple[str, ...]] = {
    "file": (),
    "image": ("resolution", "origin"),
    "map": (),
    "generate": ("size", "seed"),
}
"""Where a world can be taken from, and what else that asks for."""

_Inside: TypeAlias = Callable[[float, float], bool]


class Line(NamedTuple):
    """A wall [m]."""

    x: Number
    y: Number
    x2: Number
    y2: Number


class Box(NamedTuple):
    """A rectangle [m]."""

    x0: Number
    y0: Number
    x1: Number
    y1: Number


class Door(NamedTuple):
    """An opening in a side of a room; from and to are x on south and north, else y [m]."""

    side: Literal["south", "north", "west", "east"]
    begin: Number
    end: Number


class Point(NamedTuple):
    """A place [m]."""

    x: Number
    y: Number


class Size(NamedTuple):
    """Outer sides of a building [m]."""

    x: Annotated[float, between(SMALLEST, LARGEST)]
    y: Annotated[float, between(SMALLEST, LARGEST)]


def _straight(line: Line) -> Line:
    x, y, x2, y2 = line
    if x != x2 and y != y2:
        raise ValueError("expected a wall along x or y: y = y2 or x = x2")
    if (x, y) == (x2, y2):
        raise ValueError("expected a wall with a length")
    return Line(min(x, x2), min(y, y2), max(x, x2), max(y, y2))


def _box(box: Box) -> Box:
    if not (box.x0 < box.x1 and box.y0 < box.y1):
        raise ValueError("expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1")
    return box


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """Four walls, and doors in them."""

    at: Annotated[Box, _box, "[x0, y0, x1, y1]"]
    doors: tuple[Door, ...] = ()

    def __post_init__(self) -> None:
        for door in self.doors:
            _, low, high = self._side(door)
            if not low <= door.begin < door.end <= high:
                found = f"[{door.side}, {door.begin:g}, {door.end:g}]"
                raise ValueError(
                    f"doors, found {found}, expected from < to within {low:g} to {high:g}"
                )

    def _side(self, door: Door) -> tuple[Wall, float, float]:
        names = ("south", "north", "west", "east")
        x, y, x2, y2 = dict(zip(names, sides(self.at), strict=True))[door.side]
        return (x, y, x2, y2), *((x, x2) if y == y2 else (y, y2))

    def openings(self) -> list[Wall]:
        """Return its doors as pieces of walls [m]."""
        found: list[Wall] = []
        for door in self.doors:
            (x, y, _, y2), _, _ = self._side(door)
            level = y == y2
            found.append((door.begin, y, door.end, y) if level else (x, door.begin, x, door.end))
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldFile:
    """The keys of a world: what it draws itself, and the one that it takes and adds to."""

    walls: tuple[Annotated[Line, _straight], ...] = ()
    rooms: tuple[Room, ...] = ()
    obstacles: tuple[Annotated[Box, _box], ...] = ()
    drops: tuple[Annotated[Box, _box], ...] = ()
    home: Point | None = None
    file: FileName | None = None
    image: FileName | None = None
    map: FileName | None = None
    generate: Literal["office"] | None = None
    resolution: Annotated[float, at_least(FINEST)] | None = None
    origin: Point | None = None
    size: Size | None = None
    seed: Annotated[int, whole(0)] | None = None

    def __post_init__(self) -> None:
        bases = [base for base in BASES if getattr(self, base) is not None]
        if len(bases) > 1:
            raise ValueError(f"found {' and '.join(bases)}, expected one of them")
        for base, more in BASES.items():
            for key in more:
                if getattr(self, key) is not None and base not in bases:
                    raise ValueError(f"{key}, which only a world with {base}: has")
        if self.image is not None and self.resolution is None:
            raise ValueError("resolution is missing, expected the side of a pixel of the image [m]")
        if self.generate is not None and self.size is None:
            raise ValueError("size is missing, expected [x, y] in metres")


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


def read_world(node: yaml.Node, folder: Path) -> Draft:
    """Read the mapping of a world.

    Parameters
    ----------
    folder
        What paths in it are relative to.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    nodes = {key: value for key, value, _ in members(node, "expected the keys of a world")}
    world = bind(node, WorldFile, "world")
    base = _base(world, folder, place(node))
    if world.home is not None:
        base = Draft(base.walls, base.drops, world.home, place(nodes["home"]), base.solid)
    draft = _with_own(base, world, nodes.get("rooms", node))
    if not len(draft.walls):
        raise SettingsError(f"{place(node)}: world, found no walls, expected some")
    if len(draft.walls) > LARGEST_WALLS:
        found = f"found {len(draft.walls)} walls, expected at most {LARGEST_WALLS}"
        raise SettingsError(f"{place(node)}: world, {found}")
    if np.abs(draft.walls).max() > FARTHEST:
        found = "found walls beyond 1e6 m, expected them within ±1e6 m"
        raise SettingsError(f"{place(node)}: world, {found}")
    return draft


def _with_own(base: Draft, world: WorldFile, rooms: yaml.Node) -> Draft:
    """Return a world with what its own keys add: walls, rooms, obstacles and drops."""
    walls: list[Wall] = [*world.walls]
    things = world.obstacles
    doors: list[Wall] = []
    for room in world.rooms:
        walls += sides(room.at)
        doors += room.openings()
        if len(doors) > LARGEST_WALLS:  # a few lines of YAML can repeat one list without end
            raise refusal(rooms, "world.rooms", f"expected {LARGEST_WALLS} doors at most")
    everything = base.walls
    if walls or things:
        # Doors open walls, not the furniture that somebody put there.
        own = [*united(walls, doors).tolist(), *(side for thing in things for side in sides(thing))]
        everything = united([*base.walls.tolist(), *own])
    return Draft(
        everything,
        np.concatenate([base.drops, np.array(world.drops, dtype=np.float64).reshape(-1, 4)]),
        base.home,
        base.home_at,
        lambda x, y: base.solid(x, y) or _in_any(things)(x, y),
    )


def _in_any(rectangles: Sequence[Rectangle]) -> _Inside:
    return lambda x, y: any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in rectangles)


_NO_BOXES = np.empty((0, 4))


def _base(world: WorldFile, folder: Path, at: str) -> Draft:
    """Return the world that another one takes and adds to."""
    if world.file is not None:
        return _shared(folder / world.file)
    if world.image is not None and world.resolution is not None:
        origin = world.origin or (0.0, 0.0)
        return _of_plan(read_image(folder / world.image, world.resolution, origin))
    if world.map is not None:
        return _of_plan(read_ros_map(folder / world.map))
    if world.size is not None:
        rng = np.random.default_rng(1 if world.seed is None else world.seed)
        building = office(*world.size, rng)
        solid = _in_any(building.obstacles)
        return Draft(building.walls, _NO_BOXES, building.home, at, solid)
    return Draft(_NO_BOXES, _NO_BOXES, None, "", _in_any(()))


def _of_plan(plan: Plan) -> Draft:
    return Draft(plan.walls(), _NO_BOXES, None, "", lambda x, y: not plan.is_free(x, y))


def _shared(path: Path) -> Draft:
    name = printable(str(path))
    root = read_yaml(path, "a world")
    if root is None:
        raise SettingsError(f"{name}: is empty, expected a world")
    for key, _, at in members(root, "expected the keys of a world"):
        if key == "file":
            raise SettingsError(f"{place(at)}: file, which a shared world cannot have again")
        if key == "world":
            found = "found a mission, expected what stands under world:"
            raise SettingsError(f"{place(at)}: world, {found}")
    return read_world(root, path.parent)
