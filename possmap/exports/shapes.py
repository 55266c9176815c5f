"""Areas of the map as polygons in metres, whatever format they are written in."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import TILE, Window
from possmap.errors import OutputError
from possmap.exports import outline
from possmap.exports.bands import Marks, known
from possmap.exports.job import Job, tidy
from possmap.exports.outline import Polygon, Ring, TooManyCornersError, polygons

_CORNER_BYTES = 500
"""What a corner takes: in tables, in rings, and as text."""

_BAND_CELLS = 1 << 20
"""Cells that are looked at together."""

_MOST_IN_A_LINE = 1 << 22
"""More rows or columns that hold evidence are too many."""


def outline_of_evidence(job: Job) -> list[Polygon]:
    """Return the outlines of the cells that hold evidence, from the window's corner.

    Raises
    ------
    OutputError
        If they are too large or too jagged for memory.
    """
    return _polygons(job, lambda area: known(job.grid, area))


def outline_of_walls(job: Job) -> list[Polygon]:
    """Return the outlines of the occupied cells, whose N reaches the threshold, likewise.

    Raises
    ------
    OutputError
        If they are too large or too jagged for memory.
    """
    return _polygons(job, lambda area: job.grid.necessity(area) >= job.choices.occupied)


def _polygons(job: Job, marks: Callable[[Window], Marks]) -> list[Polygon]:
    """Find outlines on a lattice without the rows and columns of tiles that hold nothing.

    Where some are left out, one blank row or column keeps apart what is apart.
    """
    window = job.window
    tile_rows: set[int] = set()
    tile_columns: set[int] = set()
    for area in job.grid.tiles.areas(window):
        tile_rows.add(area.row0 // TILE)
        tile_columns.update(range(area.column0 // TILE, -(-area.column1 // TILE)))
    longest = TILE * max(len(tile_rows), len(tile_columns))
    if longest > _MOST_IN_A_LINE:
        raise OutputError(
            f"{job.name}: evidence in {longest:,} rows or columns, expected at most "
            f"{_MOST_IN_A_LINE:,} where outlines are drawn; take a part of it: --window X0,Y0,X1,Y1"
        )
    columns = _borders(tile_columns, window.column0, window.column1)
    rows = _borders(tile_rows, window.row0, window.row1)
    most, expected = outline.MOST_CORNERS, "expected fewer; "
    if job.grid.budget is not None:
        most, expected = job.grid.budget.fewest(most, _CORNER_BYTES)
    try:
        found = polygons(len(columns) - 1, _bands(job, marks, rows, columns), most)
    except TooManyCornersError:
        raise OutputError(
            f"{job.name}: outlines of more than {most:,} corners, {expected}"
            "take a part of it: --window X0,Y0,X1,Y1"
        ) from None
    xs, ys = (columns - window.column0).tolist(), (rows - window.row0).tolist()

    def spread(ring: Ring) -> Ring:
        return [(xs[column], ys[row]) for column, row in ring]

    return [Polygon(spread(one.shell), [spread(hole) for hole in one.holes]) for one in found]


def _borders(tiles: set[int], begin: int, end: int) -> NDArray[np.int64]:
    """Return all borders of the cells of some rows or columns of tiles, from begin to end, sorted.

    Between tiles that are not neighbours one cell, from the one's last border to the other's first,
    stands for all that is left out.
    """
    firsts = TILE * np.array(sorted(tiles), dtype=np.int64)
    borders = (firsts[:, np.newaxis] + np.arange(TILE + 1)).clip(begin, end)
    found: NDArray[np.int64] = np.unique(borders)
    return found


def _bands(
    job: Job,
    marks: Callable[[Window], Marks],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
) -> Iterator[Marks]:
    """Yield the marks of the rows between borders, the lowest first, a few rows at a time."""
    width = len(columns) - 1
    most = max(1, min(TILE, _BAND_CELLS // width))
    first = 0
    while first < len(rows) - 1:
        row = int(rows[first])
        # To the next border of tiles, and not beyond what is left out.
        last = min(first + most, len(rows) - 1, first + TILE - row % TILE)
        gap = int(rows[last]) - row != last - first
        last = first + 1 if gap else last
        found = np.zeros((last - first, width), dtype=np.bool_)
        band = Window(row, int(rows[last]), job.window.column0, job.window.column1)
        if not gap:
            for area in job.grid.tiles.areas(band):
                left = int(np.searchsorted(columns, area.column0))
                found[:, left : left + area.shape[1]] = marks(area)
        yield found
        first = last


def metres(job: Job, ring: Ring, local: bool = False) -> list[tuple[float, float]]:
    """Return a ring's corners in the site frame, or ``local``: from the window's corner [m]."""
    row0, column0 = (0, 0) if local else (job.window.row0, job.window.column0)
    lattice = job.grid.lattice  # to ask the grid reads its settings
    corners = [lattice.corner_of(row + row0, column + column0) for column, row in ring]
    return [(tidy(x), tidy(y)) for x, y in corners]
