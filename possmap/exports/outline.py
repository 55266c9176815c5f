"""Marked cells as polygons: shells and holes along the borders of cells, found row by row."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.exports.bands import Marks

MOST_CORNERS = 5_000_000
"""More are not kept in memory."""

Ring: TypeAlias = list[tuple[int, int]]
"""Columns and rows of the corners, not closed: x and y in cells from the window's corner."""

_Ints: TypeAlias = NDArray[np.int64]

# Around a corner lie four cells: bit 1 lower left, 2 lower right, 4 upper left, 8 upper right.
# A ring passes it with marked cells on its left, once, or twice where cells meet at a corner only:
# then each passage keeps to its own cell. Of a passage: the marks around, whether it leaves
# sideways, whether its sideways border lies to the right (else left), and its upright one above
# (else below).
_PASSAGES = (
    (1, True, False, False),
    (2, False, True, False),
    (4, False, False, True),
    (8, True, True, True),
    (7, False, True, True),
    (11, True, False, True),
    (13, True, True, False),
    (14, False, False, False),
    (9, True, False, False),
    (9, True, True, True),
    (6, False, False, True),
    (6, False, True, False),
)


class TooManyCornersError(Exception):
    """An outline with more corners than may be held in memory."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """Cells that hang together by their sides: a shell, anticlockwise, and holes, clockwise."""

    shell: Ring
    holes: list[Ring]


class _Corners(NamedTuple):
    """Passages of rings through corners.

    sideways, right, above : as in _PASSAGES.
    pinched : whether another passes there too.
    start : where the run of marked cells begins that ends here, rightwards and above; else -1.
    """

    row: _Ints
    column: _Ints
    sideways: Marks
    right: Marks
    above: Marks
    pinched: Marks
    start: _Ints


def polygons(width: int, bands: Iterable[Marks], most: int | None = None) -> list[Polygon]:
    """Return the outlines of marked cells, from the lowest; so rings begin at a lowest corner.

    Parameters
    ----------
    width
        Columns of every band.
    bands
        The cells from the lowest row up, some rows at a time; only two bands' rows are in memory.
    most
        Corners; None: MOST_CORNERS.

    Raises
    ------
    TooManyCornersError
        If there are more corners.
    """
    corners = _corners(width, bands, MOST_CORNERS if most is None else most)
    if not corners.row.size:
        return []
    across = _partners(corners.row, corners.column, corners.right)
    upright = _partners(corners.column, corners.row, corners.above)
    following = np.where(corners.sideways, across, upright)
    rings, ring_of, shells = _traced(corners, following)
    parents = _parents(corners, upright, rings, ring_of, shells)
    found = {ring: Polygon(_points(corners, rings[ring]), []) for ring in sorted(set(parents))}
    for ring, shell in enumerate(parents):
        if ring != shell:
            found[shell].holes.append(_points(corners, rings[ring]))
    for polygon in found.values():
        polygon.holes.sort(key=lambda hole: _low(hole[0]))
    return sorted(found.values(), key=lambda polygon: _low(polygon.shell[0]))


def _corners(width: int, bands: Iterable[Marks], most: int) -> _Corners:
    parts: list[_Corners] = []
    below = np.zeros((1, width), dtype=np.bool_)
    row, count = 0, 0

    def add(marks: Marks) -> None:
        nonlocal count
        part = _corners_of(row, np.pad(np.vstack([below, marks]), ((0, 0), (1, 1))))
        parts.append(part)
        count += part.row.size
        if count > most:
            raise TooManyCornersError

    for marks in bands:
        add(marks)
        row, below = row + len(marks), marks[-1:]
    add(np.zeros((1, width), dtype=np.bool_))
    return _Corners(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _corners_of(row: int, cells: Marks) -> _Corners:
    """Return the passages at the lower borders of cells' rows but the first; ``row``: of these."""
    bits = cells.astype(np.uint8)
    around = bits[:-1, :-1] | bits[:-1, 1:] << 1 | bits[1:, :-1] << 2 | bits[1:, 1:] << 3
    column = np.arange(cells.shape[1])
    begins = cells[1:] & ~np.pad(cells[1:, :-1], ((0, 0), (1, 0)))
    run = np.maximum.accumulate(np.where(begins, column, 0), axis=1)
    found: list[_Corners] = []
    for code, sideways, right, above in _PASSAGES:
        rows, columns = np.nonzero(around == code)
        # A border above, with marked cells to its left: the left upper cell is marked.
        ends_run = above and code & 4
        start = run[rows, columns] - 1 if ends_run else np.full(rows.size, -1)
        flags = (np.full(rows.size, flag) for flag in (sideways, right, above, code in (6, 9)))
        found.append(_Corners._make([rows + row, columns, *flags, start]))
    return _Corners(*(np.concatenate(columns) for columns in zip(*found, strict=True)))


def _partners(line: _Ints, along: _Ints, forward: Marks) -> _Ints:
    """Return at the other end of each corner's border, on one line of the lattice, which corner is.

    forward : whether the border lies behind the corner along the line, or before it.
    """
    order = np.lexsort((forward, along, line))
    partner = np.empty_like(order)
    partner[order[0::2]], partner[order[1::2]] = order[1::2], order[0::2]
    return partner


def _traced(corners: _Corners, following: _Ints) -> tuple[list[list[int]], list[int], list[int]]:
    """Follow all rings; one that passes a corner twice is taken apart there.

    Returns the rings, as corners; the ring in which each corner is left; and for each ring the
    shell of the cells that it borders, or -1 for a hole that does not touch its shell.
    """
    after, pinched = following.tolist(), corners.pinched.tolist()
    row, column = corners.row.tolist(), corners.column.tolist()
    ring_of = [-1] * len(after)
    rings: list[list[int]] = []
    shells: list[int] = []
    for first in range(len(after)):
        if ring_of[first] >= 0:
            continue
        begun = len(rings)
        path: list[int] = []
        passed: dict[tuple[int, int], int] = {}
        here = first
        while ring_of[here] < 0:
            ring_of[here] = begun
            if pinched[here]:
                place = row[here], column[here]
                if place in passed:
                    at = passed[place]
                    rings.append(path[at:])
                    del path[at:]
                    for gone in rings[-1]:
                        passed.pop((row[gone], column[gone]), None)
                passed[place] = len(path)
            path.append(here)
            here = after[here]
        rings.append(path)
        for ring in range(begun, len(rings)):
            for corner in rings[ring]:
                ring_of[corner] = ring
        shell = next(
            (ring for ring in range(begun, len(rings)) if _area(row, column, rings[ring]) > 0), -1
        )
        shells += [shell] * (len(rings) - begun)
    return rings, ring_of, shells


def _area(row: list[int], column: list[int], ring: list[int]) -> int:
    """Return a ring's area in cells, below 0 if it runs clockwise: from its sideways borders."""
    return sum(
        (column[here] - column[there]) * row[here]
        for here, there in zip(ring, ring[1:] + ring[:1], strict=True)
        if row[here] == row[there]
    )


def _parents(
    corners: _Corners,
    upright: _Ints,
    rings: list[list[int]],
    ring_of: list[int],
    shells: list[int],
) -> list[int]:
    """Return for each ring its shell.

    From the lower end of a hole's leftmost border one run of marked cells reaches left, to
    a border of the same polygon: that of its shell, or of a hole farther left.
    """
    height = int(corners.row.max()) + 1
    lower = np.flatnonzero(corners.above)
    place = corners.column[lower] * height + corners.row[lower]
    order = np.argsort(place)
    lower, place = lower[order], place[order]
    found = list(shells)

    def left_of(ring: int) -> int:
        corner = min(
            (one for one in rings[ring] if corners.start[one] >= 0),
            key=lambda one: (int(corners.column[one]), int(corners.row[one])),
        )
        wanted = int(corners.start[corner]) * height + int(corners.row[corner])
        end = int(upright[lower[np.searchsorted(place, wanted, side="right") - 1]])
        return ring_of[end]  # the border runs downwards, away from its upper end

    for ring in range(len(rings)):
        chain = [ring]
        while found[chain[-1]] < 0:
            chain.append(left_of(chain[-1]))
        for one in chain:
            found[one] = found[chain[-1]]
    return found


def _points(corners: _Corners, ring: list[int]) -> Ring:
    """Return a ring's corners from its lowest left one on, wherever it was found first."""
    found = list(zip(corners.column[ring].tolist(), corners.row[ring].tolist(), strict=True))
    first = min(range(len(found)), key=lambda index: _low(found[index]))
    return found[first:] + found[:first]


def _low(corner: tuple[int, int]) -> tuple[int, int]:
    column, row = corner
    return row, column
