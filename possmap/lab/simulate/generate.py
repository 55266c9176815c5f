"""Plausible orthogonal office buildings of any size: corridors, rooms, doors and furniture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from possmap.lab.simulate.floor_plan import Rectangle, Wall, sides, united
from possmap.truth.plans import Segments

SMALLEST, LARGEST = 5.0, 200.0
"""Bounds of either side of a building [m]."""
CORRIDOR = (1.8, 2.5)
ROOM = (3.0, 8.0)
DOOR = (0.6, 1.2)
PASSAGE = 0.6
"""What stays free between obstacles, and between them and a wall that they do not touch [m]."""

_DEEPEST_PAIR = 14.0  # of two rows of rooms, back to back between two corridors [m]
_WING = 2 * ROOM[1]  # what a corridor leaves is cut so that each part takes one row, if it can
_CONNECTED = 0.2  # share of neighbours with a door between them
_AT_DOORS = 0.8  # what stays free of furniture around a door
_FLOOR_PER_TRY = 5.0  # [m2]: an attempt to place something; half of them fail
_FURNITURE = (  # length and width [m], and whether it stands against a wall
    ((1.4, 1.8), (0.7, 0.8), True),  # desk
    ((0.8, 2.0), (0.4, 0.6), True),  # cupboard
    ((1.2, 2.0), (0.8, 1.0), False),  # table
    ((0.3, 0.5), (0.3, 0.5), False),  # pillar
)

_Span: TypeAlias = tuple[float, float]
_X, _Y = 0, 1


@dataclass(frozen=True, slots=True)
class Office:
    """A building with its south-west corner at the origin.

    size : outer sides along x and y [m].
    rooms, obstacles : rectangles; floor that is in no room is corridor.
    doors : openings, each in one wall.
    home : a place in the first corridor [m].
    """

    size: tuple[float, float]
    rooms: list[Rectangle]
    doors: list[Wall]
    obstacles: list[Rectangle]
    home: tuple[float, float]

    @property
    def walls(self) -> Segments:
        """All walls, those of the obstacles too, shape (n, 4)."""
        outside = sides((0.0, 0.0, *self.size))
        inside = [side for rectangle in self.rooms + self.obstacles for side in sides(rectangle)]
        return united([*outside, *inside], self.doors)


def office(size_x: float, size_y: float, rng: np.random.Generator) -> Office:
    """Return a building in which every room can be reached from home.

    Corridors cut the floor into ever smaller blocks, each on a corridor, until rooms fit.

    size_x, size_y : outer sides [m], SMALLEST to LARGEST.
    """
    size_x, size_y = round(size_x, 6), round(size_y, 6)
    whole = _Block(((0.0, size_x), (0.0, size_y)), ((False, False), (False, False)))
    across = _X if size_x < size_y else _Y  # the first corridor runs along the longer side
    corridor, first = _cut(whole, across, rng)
    home = [0.0, 0.0]
    home[across] = _round(sum(corridor) / 2)
    home[1 - across] = _round((size_y, size_x)[across] * rng.uniform(0.3, 0.7))
    rooms: list[Rectangle] = []
    doors: list[Wall] = []
    for block in first:
        for row in _rows(block, rng):
            _furnish_row(row, rooms, doors, rng)
    obstacles = [thing for room in rooms for thing in _furniture(room, doors, rng)]
    return Office((size_x, size_y), rooms, doors, obstacles, (home[0], home[1]))


class _Block(NamedTuple):
    """A rectangle of floor, axis by axis, and which of its sides (low, high) lie on a corridor."""

    spans: tuple[_Span, _Span]
    on_corridor: tuple[tuple[bool, bool], tuple[bool, bool]]

    def part(self, axis: int, low: float, high: float, on: tuple[bool, bool]) -> _Block:
        spans, on_corridor = list(self.spans), list(self.on_corridor)
        spans[axis], on_corridor[axis] = (low, high), on
        return _Block((spans[0], spans[1]), (on_corridor[0], on_corridor[1]))


class _Row(NamedTuple):
    """Rooms side by side along an axis; each has its door in the low or high side across it."""

    block: _Block
    along: int
    high: bool


def _cut(block: _Block, axis: int, rng: np.random.Generator) -> tuple[_Span, list[_Block]]:
    """Lay a corridor across an axis; return its span on that axis, and the blocks beside it."""
    low, high = block.spans[axis]
    wings = 2 if high - low >= 2 * ROOM[0] + CORRIDOR[0] else 1
    width = _round(min(rng.uniform(*CORRIDOR), high - low - wings * ROOM[0]))
    left = high - low - width
    if wings == 1:
        share = left * float(rng.integers(2))  # the corridor runs along an outer wall
    elif left <= _WING:
        share = _between(max(ROOM[0], left - ROOM[1]), min(ROOM[1], left - ROOM[0]), rng)
    else:
        share = _round(left * rng.uniform(0.35, 0.65))
    begin, end = low + share, low + share + width
    begin, end = (low if begin - low < 1e-6 else begin), (high if high - end < 1e-6 else end)
    on_low, on_high = block.on_corridor[axis]
    blocks = []
    if begin > low:
        blocks.append(block.part(axis, low, begin, (on_low, True)))
    if end < high:
        blocks.append(block.part(axis, end, high, (True, on_high)))
    return (begin, end), blocks


def _rows(block: _Block, rng: np.random.Generator) -> Iterator[_Row]:
    """Yield rows of rooms that fill a block, after as many more corridors as that takes."""
    depths = [high - low for low, high in block.spans]
    for axis in np.argsort(depths).tolist():
        depth, on, (low, high) = depths[axis], block.on_corridor[axis], block.spans[axis]
        if all(on) and 2 * ROOM[0] <= depth <= _DEEPEST_PAIR:
            least = max(ROOM[0], depth - ROOM[1], 0.4 * depth)
            middle = low + _between(least, depth - least, rng)
            yield _Row(block.part(axis, low, middle, (True, False)), 1 - axis, high=False)
            yield _Row(block.part(axis, middle, high, (False, True)), 1 - axis, high=True)
            return
        if any(on) and depth <= ROOM[1]:
            yield _Row(block, 1 - axis, high=on[1] and not (on[0] and rng.random() < 0.5))
            return
    # A corridor must begin at a corridor. Of two ways, the one that cuts the longer side.
    axis = max((_X, _Y), key=lambda a: (any(block.on_corridor[1 - a]), depths[a]))
    for part in _cut(block, axis, rng)[1]:
        yield from _rows(part, rng)


def _furnish_row(
    row: _Row, rooms: list[Rectangle], doors: list[Wall], rng: np.random.Generator
) -> None:
    """Append the rooms of a row, their doors to the corridor and some from room to room."""
    low, high = row.block.spans[row.along]
    across = row.block.spans[1 - row.along]
    length = high - low
    fewest, most = int(np.ceil(length / ROOM[1])), int(length / ROOM[0])
    count = int(np.clip(round(length / rng.uniform(3.5, 6.0)), fewest, most))
    each = length / count
    play = min(each - ROOM[0], ROOM[1] - each) / 2
    inner = [_round(low + k * each + rng.uniform(-play, play)) for k in range(1, count)]
    cuts = [low, *inner, high]
    for begin, end in pairwise(cuts):
        rooms.append(_placed(row.along, (begin, end), across))
        opening = _door(begin, end, rng)
        doors.append(_placed(row.along, opening, (across[row.high],) * 2))
        if begin > low and rng.random() < _CONNECTED:
            doors.append(_placed(row.along, (begin, begin), _door(*across, rng)))


def _door(low: float, high: float, rng: np.random.Generator) -> _Span:
    """Return an opening of a wall, not in its corners."""
    width = _round(rng.uniform(*DOOR))
    begin = _between(low + 0.2, high - 0.2 - width, rng)
    return begin, begin + width


def _furniture(room: Rectangle, doors: list[Wall], rng: np.random.Generator) -> Iterator[Rectangle]:
    """Yield obstacles that leave passages free, round one another and from door to door."""
    x0, y0, x1, y1 = room
    kept = [
        _grown(door, _AT_DOORS)
        for door in doors
        if x0 <= door[0] <= door[2] <= x1 and y0 <= door[1] <= door[3] <= y1
    ]
    for _ in range(int((x1 - x0) * (y1 - y0) / _FLOOR_PER_TRY)):
        long, short, at_wall = _FURNITURE[rng.integers(len(_FURNITURE))]
        measures = rng.permutation([rng.uniform(*long), rng.uniform(*short)])
        walls = ((x0, x1), (y0, y1))
        spans = [_stood(_round(measures[axis]), *walls[axis], rng) for axis in (_X, _Y)]
        if at_wall:
            axis, side = rng.integers(2), rng.integers(2)
            (begin, end), (low, high) = spans[axis], walls[axis]
            spans[axis] = (low, low + end - begin) if side else (high + begin - end, high)
        thing = _placed(_X, *spans)
        if not any(_overlap(thing, other) for other in kept):
            kept.append(_grown(thing, PASSAGE))
            yield thing


def _stood(length: float, low: float, high: float, rng: np.random.Generator) -> _Span:
    """Return where something of a length stands: against either wall, or a passage away."""
    begin = _between(low, high - length, rng)
    if begin - low < PASSAGE:
        return low, low + length
    if high - begin - length < PASSAGE:
        return high - length, high
    return begin, begin + length


def _placed(along: int, span: _Span, across: _Span) -> Rectangle:
    """Return a rectangle, or a wall, from its extent along an axis and across it."""
    x, y = (span, across) if along == _X else (across, span)
    # No 12.120000000000001: rectangles that share a line must have it in one spelling.
    return round(x[0], 6), round(y[0], 6), round(x[1], 6), round(y[1], 6)


def _grown(rectangle: Rectangle, by: float) -> Rectangle:
    x0, y0, x1, y1 = rectangle
    return x0 - by, y0 - by, x1 + by, y1 + by


def _overlap(one: Rectangle, other: Rectangle) -> bool:
    # Touching by a hair's breadth of rounding is none.
    apart = max(one[0] - other[2], other[0] - one[2], one[1] - other[3], other[1] - one[3])
    return apart < -1e-9


def _between(low: float, high: float, rng: np.random.Generator) -> float:
    return _round(rng.uniform(low, max(low, high)))


def _round(length: float) -> float:
    """To whole centimetres, as a plan would have it."""
    return round(float(length), 2)
