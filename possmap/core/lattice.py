"""Cells and metres: the lattice anchored at (0, 0), its windows and its tiles (METHOD §0)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

TILE = 256
"""Cells along a side of a tile."""

HAIR = 1e-6
"""Share of a cell by which rounding may put a point below a border (METHOD §0)."""


class TileKey(NamedTuple):
    """Row and column of a tile; cell (row, column) lies in tile (row // TILE, column // TILE)."""

    row: int
    column: int


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of cells: rows row0 <= row < row1, columns likewise. Row 0 is the lowest y."""

    row0: int
    row1: int
    column0: int
    column1: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.row1 - self.row0, self.column1 - self.column0

    @property
    def cells(self) -> int:
        """Number of cells."""
        return max(0, self.row1 - self.row0) * max(0, self.column1 - self.column0)

    def intersection(self, other: Window) -> Window:
        """Return the cells in both, possibly none."""
        row0, column0 = max(self.row0, other.row0), max(self.column0, other.column0)
        return Window(
            row0,
            max(row0, min(self.row1, other.row1)),
            column0,
            max(column0, min(self.column1, other.column1)),
        )

    def union(self, other: Window) -> Window:
        """Return the smallest window that holds both."""
        return Window(
            min(self.row0, other.row0),
            max(self.row1, other.row1),
            min(self.column0, other.column0),
            max(self.column1, other.column1),
        )

    def bands(self, cells: int) -> Iterator[Window]:
        """Cut the window into pieces of at most so many cells, in the order of an array's rows."""
        width = max(1, self.column1 - self.column0)
        rows, columns = max(1, cells // width), min(width, cells)
        for row in range(self.row0, self.row1, rows):
            for column in range(self.column0, self.column1, columns):
                yield Window(
                    row,
                    min(row + rows, self.row1),
                    column,
                    min(column + columns, self.column1),
                )

    def slices_in(self, outer: Window) -> tuple[slice, slice]:
        """Return the index of this window in an array that covers ``outer``."""
        return (
            slice(self.row0 - outer.row0, self.row1 - outer.row0),
            slice(self.column0 - outer.column0, self.column1 - outer.column0),
        )


def tile_window(key: TileKey) -> Window:
    """Return the cells of a tile."""
    row, column = key.row * TILE, key.column * TILE
    return Window(row, row + TILE, column, column + TILE)


ABREAST = 4
"""Tiles side by side that are looked at together: more take memory and save no time."""


def joined(keys: Iterable[TileKey], window: Window) -> Iterator[Window]:
    """Yield the cells of tiles within a window, neighbours in a row together.

    keys : sorted, by row and then by column.
    """
    run: list[TileKey] = []
    for key in keys:
        follows = run and key == (run[-1].row, run[-1].column + 1) and len(run) < ABREAST
        if run and not follows:
            yield _of_run(run, window)
            run = []
        run.append(key)
    if run:
        yield _of_run(run, window)


def _of_run(run: list[TileKey], window: Window) -> Window:
    return tile_window(run[0]).union(tile_window(run[-1])).intersection(window)


def tiles_of(window: Window) -> Iterator[TileKey]:
    """Yield the tiles that a window touches."""
    for row in range(window.row0 // TILE, -(-window.row1 // TILE)):
        for column in range(window.column0 // TILE, -(-window.column1 // TILE)):
            yield TileKey(row, column)


@dataclass(frozen=True, slots=True)
class Lattice:
    """The only place where metres become cells, and cells metres; ``resolution`` [m per cell]."""

    resolution: float

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, column) of the cell that holds the point: floor(p / c + 1e-6)."""
        return math.floor(y / self.resolution + HAIR), math.floor(x / self.resolution + HAIR)

    def centre_of(self, row: int, column: int) -> tuple[float, float]:
        """Return (x, y) of a cell's centre [m]."""
        return (column + 0.5) * self.resolution, (row + 0.5) * self.resolution

    def corner_of(self, row: int, column: int) -> tuple[float, float]:
        """Return (x, y) of a cell's lower left corner [m]."""
        return column * self.resolution, row * self.resolution

    def window_of(self, x0: float, y0: float, x1: float, y1: float) -> Window:
        """Return the cells that a rectangle given in metres covers, wholly or in part.

        Raises
        ------
        ValueError
            If the rectangle has no area.
        """
        if not (x0 < x1 and y0 < y1):
            raise ValueError(f"expected x0 < x1 and y0 < y1, found {x0},{y0},{x1},{y1}")
        row0, column0 = self.cell_of(x0, y0)
        row1 = math.ceil(y1 / self.resolution - HAIR)
        column1 = math.ceil(x1 / self.resolution - HAIR)
        return Window(row0, max(row1, row0 + 1), column0, max(column1, column0 + 1))
