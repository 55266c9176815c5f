"""Marked cells as polygons: shells and holes along the borders of cells, from pieces of a map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.errors import OutputError
from possmap.exports.job import A_PART, Job, Marks, tidy

MOST_SIDES = 3_000_000
"""Sides of cells along outlines; more are not kept in memory."""

Ring: TypeAlias = list[tuple[int, int]]
"""Columns and rows of the corners, not closed: x and y in cells from the origin's corner."""

_Ints: TypeAlias = NDArray[np.int64]
_BITS = 31
"""Of a column or row, counted from the origin, in a key that holds both."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """Cells that hang together by their sides: a shell, anticlockwise, and holes, clockwise."""

    shell: Ring
    holes: list[Ring]


class _Borders(NamedTuple):
    """Straight parts of the rings, with marked cells on their left.

    line : row of horizontal ones, column of upright ones.
    low, high : where they lie along it.
    forward : whether they run right, or up.
    """

    line: _Ints
    low: _Ints
    high: _Ints
    forward: Marks

    @property
    def begin(self) -> _Ints:
        return np.where(self.forward, self.low, self.high)

    @property
    def end(self) -> _Ints:
        return np.where(self.forward, self.high, self.low)


def outlines(job: Job, marked: Callable[[Window], Marks]) -> list[Polygon]:
    """Return the outlines of marked cells, from the window's corner.

    Raises
    ------
    OutputError
        If they are too long for memory.
    """
    try:
        return polygons(job.window, ((area, marked(area)) for area in job.areas()))
    except OverflowError as error:
        raise OutputError(f"{job.name}: {error}, expected fewer; {A_PART}") from None


def metres(job: Job, ring: Ring, local: bool = False) -> list[tuple[float, float]]:
    """Return a ring's corners in the site frame, or ``local``: from the window's corner [m]."""
    row0, column0 = (0, 0) if local else (job.window.row0, job.window.column0)
    lattice = job.grid.lattice  # to ask the grid reads its settings
    corners = [lattice.corner_of(row + row0, column + column0) for column, row in ring]
    return [(tidy(x), tidy(y)) for x, y in corners]


def polygons(origin: Window, pieces: Iterable[tuple[Window, Marks]]) -> list[Polygon]:
    """Return the outlines of marked cells, from the lowest; so rings begin at a lowest corner.

    What it takes grows with the outlines and the pieces, however far apart these lie.

    Parameters
    ----------
    origin
        Whose first cell's corner the rings count from; all pieces lie within.
    pieces
        Windows that share no cell, and which of their cells are marked, shape (rows, columns).

    Raises
    ------
    OverflowError
        If they have more than MOST_SIDES sides.
    """
    across, upright = _borders(origin, pieces)
    rings = [one for ring in _traced(across, upright) for one in _simple(ring)]
    shells = {number: ring for number, ring in enumerate(rings) if _area(ring) > 0}
    holes: dict[int, list[Ring]] = {number: [] for number in shells}
    if len(shells) < len(rings):
        for number, shell in _shells_of_holes(rings, shells, upright):
            holes[shell].append(_from_lowest(rings[number]))
    found = [
        Polygon(_from_lowest(ring), sorted(holes[number], key=lambda hole: _low(hole[0])))
        for number, ring in shells.items()
    ]
    return sorted(found, key=lambda polygon: _low(polygon.shell[0]))


def _borders(origin: Window, pieces: Iterable[tuple[Window, Marks]]) -> tuple[_Borders, _Borders]:
    """Return the horizontal and the upright borders between marked cells and others."""
    keys: tuple[list[_Ints], list[_Ints]] = [], []
    sides = 0
    for window, marks in pieces:
        cells = np.pad(marks, 1).astype(np.int8)
        row0, column0 = window.row0 - origin.row0, window.column0 - origin.column0
        step = np.diff(cells[:, 1:-1], axis=0)  # 1 where a marked cell lies above
        row, column = np.nonzero(step)
        keys[0].append(_keys(row + row0, column + column0, step[row, column] > 0))
        step = np.diff(cells[1:-1], axis=1)  # 1 where one lies to the right
        row, column = np.nonzero(step)
        keys[1].append(_keys(column + column0, row + row0, step[row, column] < 0))
        sides += keys[0][-1].size + keys[1][-1].size
        if sides > MOST_SIDES:
            raise OverflowError(f"outlines of more than {MOST_SIDES:,} sides of cells")
    across, upright = (_joined(np.concatenate([np.empty(0, np.int64), *some])) for some in keys)
    return across, upright


def _keys(line: _Ints, along: _Ints, forward: Marks) -> _Ints:
    """Return numbers that sort by line, then along it, and tell the direction."""
    return ((line << _BITS | along) << 1) | forward


def _joined(keys: _Ints) -> _Borders:
    """Join sides of cells to borders; where pieces meet, a side seen from both is none."""
    keys = np.sort(keys)
    _, first, count = np.unique(keys >> 1, return_index=True, return_counts=True)
    keys = keys[first[count == 1]]
    joins = np.diff(keys) == 2  # the next cell in this line, in the same direction
    begins, ends = np.ones((2, keys.size), dtype=np.bool_)
    begins[1:] = ends[:-1] = ~joins
    first, last = keys[begins], keys[ends]
    mask = (1 << _BITS) - 1
    return _Borders(
        first >> _BITS + 1, first >> 1 & mask, (last >> 1 & mask) + 1, (first & 1).astype(np.bool_)
    )


def _traced(across: _Borders, upright: _Borders) -> Iterator[Ring]:
    """Yield the rings; where cells meet at a corner only, each keeps to its own: to the left."""
    up_after = np.empty(across.line.size, dtype=np.int64)
    up_after[np.argsort(_keys(across.line, across.end, ~across.forward))] = np.argsort(
        _keys(upright.begin, upright.line, ~upright.forward)
    )
    across_after = np.empty_like(up_after)
    across_after[np.argsort(_keys(upright.end, upright.line, ~upright.forward))] = np.argsort(
        _keys(across.line, across.begin, across.forward)
    )
    following = across_after[up_after].tolist()
    row, begin, end = across.line.tolist(), across.begin.tolist(), across.end.tolist()
    done = bytearray(len(following))
    for first in range(len(following)):
        ring: Ring = []
        here = first
        while not done[here]:
            done[here] = 1
            ring += (begin[here], row[here]), (end[here], row[here])
            here = following[here]
        if ring:
            yield ring


def _simple(ring: Ring) -> Iterator[Ring]:
    """Yield a ring in parts that pass no corner twice: programs take others for invalid."""
    if len(set(ring)) == len(ring):
        yield ring
        return
    path: Ring = []
    place: dict[tuple[int, int], int] = {}
    for corner in ring:
        if corner in place:
            part = path[place[corner] :]
            yield part
            del path[place[corner] :]
            for gone in part:
                del place[gone]
        place[corner] = len(path)
        path.append(corner)
    yield path


def _area(ring: Ring) -> int:
    """Return twice a ring's area in cells, below 0 if it runs clockwise."""
    following = ring[1:] + ring[:1]
    return sum(x * y2 - x2 * y for (x, y), (x2, y2) in zip(ring, following, strict=True))


def _shells_of_holes(
    rings: list[Ring], shells: dict[int, Ring], upright: _Borders
) -> Iterator[tuple[int, int]]:
    """Yield each hole with its shell, by number.

    Left of a hole's leftmost border lies a border of the same polygon: that of its shell, or of
    a hole farther left.
    """
    owner = {
        (x, min(y, y2)): number
        for number, ring in enumerate(rings)
        for (x, y), (x2, y2) in zip(ring, ring[1:] + ring[:1], strict=True)
        if x == x2
    }
    # Every side of every upright border, by row and column, and where that border begins below.
    length = upright.high - upright.low
    low = np.repeat(upright.low, length)
    row = np.arange(low.size) - np.repeat(np.cumsum(length) - length, length) + low
    places = row << _BITS | np.repeat(upright.line, length)
    order = np.argsort(places)
    places, low = places[order], low[order]
    parents = {number: number for number in shells}
    for number in range(len(rings)):
        chain = [number]
        while chain[-1] not in parents:
            x, y = min(rings[chain[-1]])
            at = int(np.searchsorted(places, y << _BITS | x)) - 1
            chain.append(owner[int(places[at]) & ((1 << _BITS) - 1), int(low[at])])
        parents.update(dict.fromkeys(chain, parents[chain[-1]]))
        if number not in shells:
            yield number, parents[number]


def _from_lowest(ring: Ring) -> Ring:
    """Return a ring's corners from its lowest left one on, wherever it was found first."""
    first = min(range(len(ring)), key=lambda index: _low(ring[index]))
    return ring[first:] + ring[:first]


def _low(corner: tuple[int, int]) -> tuple[int, int]:
    column, row = corner
    return row, column
