"""The ``world:`` of a mission as YAML: walls, rooms and obstacles, or where to take them from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import yaml

from possmap.core.ranges import Number, at_least, between, whole
from possmap.errors import SettingsError
from possmap.lab.simulate.floor_plan import Rectangle, Wall, sides, united
from possmap.lab.simulate.generate import LARGEST, SMALLEST, office
from possmap.settings.binder import FileName, bind
from possmap.settings.yaml_file import place, refusal, required_yaml
from possmap.truth.plans import FINEST, Plan, Segments, read_image, read_ros_map

LARGEST_WALLS = 50_000
FARTHEST = 1e6  # [m], what a log can hold
BASES = {"file": (), "image": ("resolution", "origin"), "map": (), "generate": ("size", "seed")}
"""Where a world can be taken from, and what else that asks for."""


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
        x0, y0, x1, y1 = self.at
        for side, begin, end in self.doors:
            low, high = (x0, x1) if side in ("south", "north") else (y0, y1)
            if not low <= begin < end <= high:
                raise ValueError(
                    f"doors, found [{side}, {begin:g}, {end:g}], expected from < to within "
                    f"{low:g} to {high:g}"
                )

    def openings(self) -> list[Wall]:
        """Return its doors as pieces of walls [m]."""
        x0, y0, x1, y1 = self.at
        at = {"south": y0, "north": y1, "west": x0, "east": x1}
        return [
            (begin, at[side], end, at[side])
            if side in ("south", "north")
            else (at[side], begin, at[side], end)
            for side, begin, end in self.doors
        ]


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


_NONE: Segments = np.empty((0, 4))


class Draft(NamedTuple):
    """A world as read; without a home it is none yet.

    walls, drops : as in a World.
    home : and the ``file:line`` that gave it.
    solid : whether a place lies in what robots cannot enter, walls apart.
    """

    walls: Segments = _NONE
    drops: Segments = _NONE
    home: tuple[float, float] | None = None
    home_at: str = ""
    solid: Callable[[float, float], bool] = lambda x, y: False


def read_world(node: yaml.Node, folder: Path, is_shared: bool = False) -> Draft:
    """Read the mapping of a world.

    Parameters
    ----------
    folder
        What paths in it are relative to.
    is_shared
        Whether another world takes this one.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    world = bind(node, WorldFile, "world")
    nodes = {key.value: value for key, value in node.value}
    if is_shared and world.file is not None:
        at = place(nodes["file"])
        raise SettingsError(f"{at}: file, which a shared world cannot have again")
    draft = _with_own(_base(world, folder, place(node)), world, nodes.get("rooms", node))
    if world.home is not None:
        draft = draft._replace(home=world.home, home_at=place(nodes["home"]))
    problem = ""
    if not len(draft.walls):
        problem = "found no walls, expected some"
    elif len(draft.walls) > LARGEST_WALLS:
        problem = f"found {len(draft.walls)} walls, expected at most {LARGEST_WALLS}"
    elif np.abs(draft.walls).max() > FARTHEST:
        problem = "found walls beyond 1e6 m, expected them within ±1e6 m"
    if problem:
        raise SettingsError(f"{place(node)}: world, {problem}")
    return draft


def _with_own(base: Draft, world: WorldFile, rooms: yaml.Node) -> Draft:
    """Return a world with what its own keys add: walls, rooms, obstacles and drops."""
    walls: list[Wall] = [*world.walls]
    doors: list[Wall] = []
    for room in world.rooms:
        walls += sides(room.at)
        doors += room.openings()
        if len(doors) > LARGEST_WALLS:  # a few lines of YAML can repeat one list without end
            raise refusal(rooms, "world.rooms", f"expected {LARGEST_WALLS} doors at most")
    everything, things = base.walls, world.obstacles
    if walls or things:
        # Doors open walls, not the furniture that somebody put there.
        own = [*united(walls, doors).tolist(), *(side for thing in things for side in sides(thing))]
        everything = united([*base.walls.tolist(), *own])
    drops = np.array(world.drops, dtype=np.float64).reshape(-1, 4)
    return base._replace(
        walls=everything,
        drops=np.concatenate([base.drops, drops]),
        solid=lambda x, y: base.solid(x, y) or _in_any(things, x, y),
    )


def _in_any(rectangles: Sequence[Rectangle], x: float, y: float) -> bool:
    return any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in rectangles)


def _base(world: WorldFile, folder: Path, at: str) -> Draft:
    """Return the world that another one takes and adds to."""
    if world.file is not None:
        path = folder / world.file
        return read_world(required_yaml(path, "a world"), path.parent, is_shared=True)
    if world.image is not None and world.resolution is not None:
        origin = world.origin or (0.0, 0.0)
        return _of_plan(read_image(folder / world.image, world.resolution, origin))
    if world.map is not None:
        return _of_plan(read_ros_map(folder / world.map))
    if world.size is not None:
        building = office(
            *world.size, np.random.default_rng(1 if world.seed is None else world.seed)
        )
        return Draft(
            walls=building.walls,
            home=building.home,
            home_at=at,
            solid=lambda x, y: _in_any(building.obstacles, x, y),
        )
    return Draft()


def _of_plan(plan: Plan) -> Draft:
    return Draft(walls=plan.walls(), solid=lambda x, y: not plan.is_free(x, y))
