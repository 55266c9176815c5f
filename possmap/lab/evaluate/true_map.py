"""The truth laid on the map's own lattice: walls, distances to them, free floor, solid inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from possmap.core.lattice import HAIR, Window
from possmap.lab.evaluate.distance import Squares, limit, reach_of, squared_distances
from possmap.lab.evaluate.raster import (
    Flags,
    Floats,
    Ints,
    Segments,
    cells_of,
    extent_of,
    grown,
)
from possmap.lab.evaluate.regions import Regions

FARTHEST_M = 0.3
"""Distances to walls are told up to here [m]."""

THICKEST_M = 0.6
"""What nobody can reach and is thinner is the inside of a wall [m]."""


@dataclass(frozen=True, eq=False)
class TrueMap:
    """What is true of the cells of a window; arrays of its shape unless they say otherwise.

    Attributes
    ----------
    window, resolution
        The cells, and their side [m].
    walls
        Wall cells that a robot could see: without those within solid, such as the wall behind a
        cupboard.
    squares
        Squared distance to the nearest wall cell, in cells, exact up to 0.3 m.
    free
        Cells that can be reached from where robots set out, without crossing a wall; None if that
        is not bounded, or nobody knows where they set out.
    free_cells
        How many there are, in the window and beyond; None as above.
    solid
        Cells inside of walls and pillars, into which nobody can get, and walls that face no floor
        that anybody can get to.
    wall_cells
        How many walls there are that could be seen, in the window and beyond.
    whole
        A window that holds this one and all walls, or as much of them as can be held.
    counts
        Wall cells of ``whole``, seen or not, below and left of each corner, shape (rows + 1,
        columns + 1).
    """

    window: Window
    resolution: float
    walls: Flags
    squares: Squares
    free: Flags | None
    free_cells: int | None
    solid: Flags
    wall_cells: int
    whole: Window
    counts: Squares

    def near(self, squares: Squares, tolerance_m: float) -> Flags:
        """Return which of some squared distances are within a tolerance of at most 0.3 m."""
        return squares <= limit(tolerance_m, self.resolution)

    def any_within(self, rows: Ints, columns: Ints, up: Ints, across: Ints) -> Flags:
        """Tell of cells (of the lattice) whether a wall lies within so many rows and columns."""
        height, width = self.whole.shape
        low = np.clip(rows - up - self.whole.row0, 0, height)
        high = np.clip(rows + up + 1 - self.whole.row0, 0, height)
        left = np.clip(columns - across - self.whole.column0, 0, width)
        right = np.clip(columns + across + 1 - self.whole.column0, 0, width)
        n = self.counts
        inside: Flags = n[high, right] - n[low, right] - n[high, left] + n[low, left] > 0
        return inside


def true_map(
    walls: Segments, inside: Floats, window: Window, resolution: float, most_cells: int
) -> TrueMap:
    """Lay the truth on a window.

    Parameters
    ----------
    walls
        True walls, x, y, x2, y2 [m].
    inside
        Places that are free for sure [m], shape (n, 2): home, the true tracks. They tell rooms
        from pillars; without any nothing is solid.
    most_cells
        Walls beyond the window are held too, as long as it takes no more cells than this.
    """
    margin = grown(window, reach_of(FARTHEST_M, resolution) + 1)
    whole = margin.union(grown(extent_of(walls, resolution), 1))
    if whole.cells > most_cells:
        whole = margin
    cells = cells_of(walls, whole, resolution)
    squares = squared_distances(cells, reach_of(FARTHEST_M, resolution))
    cut = window.slices_in(whole)
    free, solid = _free_and_solid(cells, inside, whole, resolution)
    seen = cells & ~solid
    return TrueMap(
        window=window,
        resolution=resolution,
        walls=seen[cut].copy(),
        squares=squares[cut].copy(),
        free=None if free is None else free[cut].copy(),
        free_cells=None if free is None else int(free.sum()),
        solid=solid[cut].copy(),
        wall_cells=int(seen.sum()),
        whole=whole,
        counts=integral(cells),
    )


def _free_and_solid(
    walls: Flags, inside: Floats, whole: Window, resolution: float
) -> tuple[Flags | None, Flags]:
    """Tell what is reached from places that are free for sure, and what is solid.

    Solid is what nobody reaches if walls close it in, or if it is thin: the insides of a building's
    thick walls hang together, and often with the world outside. So are walls without any free
    cell beside them: the building's own behind a cupboard.
    """
    places = np.floor(inside / resolution + HAIR).astype(np.int64)
    regions = Regions(walls)
    reached = regions.at(places[:, 1] - whole.row0, places[:, 0] - whole.column0)
    if not len(reached):
        return None, np.zeros(walls.shape, dtype=np.bool_)
    outside = regions.at_border()
    closed = np.setdiff1d(regions.all(), np.concatenate([reached, outside]))
    solid = regions.painted(closed)
    if np.isin(reached, outside).any():
        return None, solid
    free = regions.painted(reached)
    unreached = ~(free | walls)
    solid |= unreached & ~_opened(unreached, reach_of(THICKEST_M / 2, resolution))
    solid |= walls & ~_any_around(free, 1)
    return free, solid


def _opened(flags: Flags, reach: int) -> Flags:
    """Return what squares of 2·reach + 1 cells cover that fit into the flags; all fits beyond."""
    if not reach:
        return flags
    padded = np.pad(flags, reach, constant_values=True)
    cores = ~_any_around(~padded, reach)
    return _any_around(cores, reach)[reach:-reach, reach:-reach]


def _any_around(flags: Flags, reach: int) -> Flags:
    """Return whether any flag is set within so many rows and columns."""
    counts = integral(flags)
    for axis, size in enumerate(flags.shape):
        at = np.arange(size)
        high, low = np.minimum(at + reach + 1, size), np.maximum(at - reach, 0)
        counts = np.take(counts, high, axis) - np.take(counts, low, axis)
    found: Flags = counts > 0
    return found


def integral(flags: Flags) -> Squares:
    """Return how many flags lie below and left of each corner, shape (rows + 1, columns + 1)."""
    counts = np.zeros((flags.shape[0] + 1, flags.shape[1] + 1), dtype=np.int32)
    np.cumsum(flags, axis=0, dtype=np.int32, out=counts[1:, 1:])
    np.cumsum(counts[1:, 1:], axis=1, out=counts[1:, 1:])
    return counts
