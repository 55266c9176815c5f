"""How the cells of two grids differ: changes of a tile, sums over all, and the largest."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import necessity_of
from possmap.core.lattice import Lattice, TileKey, Window
from possmap.core.patches import Patch, cropped, extent_of, spread
from possmap.core.settings import FreeFusion
from possmap.core.views import Readout
from possmap.grid.grid import Grid

QUANTITIES = ("belief", "plausibility", "point")
"""What is compared: Bel and Pl of a wall, and N of a singular point."""

THRESHOLDS = (0.01, 0.1, 0.5)
"""A cell counts as changed by more than so much."""

CONTESTED = 0.5
"""A cell is contested above this."""

APART_M = 1.0
"""Changes nearer to each other than this, along x and y, are one [m]."""

_IN_REACH = 16
"""A change rules out at most so many of those chosen in its own tile and those around it."""

Fusions: TypeAlias = tuple[FreeFusion, FreeFusion]
"""How numbers of free space add up in A and in B."""


class Changes(NamedTuple):
    """Some cells of two grids, A and B, and those of them whose evidence differs.

    known_a, known_b : which cells of the window are not pure ignorance.
    row, column : of those that differ, on the lattice.
    a, b : the values of QUANTITIES there, and how contested they are, shape (4, cells).
    """

    window: Window
    known_a: NDArray[np.bool_]
    known_b: NDArray[np.bool_]
    row: NDArray[np.intp]
    column: NDArray[np.intp]
    a: NDArray[np.float64]
    b: NDArray[np.float64]

    @property
    def size(self) -> NDArray[np.float64]:
        """How far each of QUANTITIES moves, shape (3, cells)."""
        return np.abs(self.b - self.a)[: len(QUANTITIES)]


def changes_in_row(row: int, a: Grid, b: Grid, window: Window) -> Iterator[Changes]:
    """Yield the tiles of a row that A or B holds; what neither knows is left out.

    Equal hashes tell that no cell differs: of those tiles one is read for the two.
    """
    hashes = [grid.tiles.directory.hashes_of_row(row, window) for grid in (a, b)]
    fusions = a.settings.free_fusion, b.settings.free_fusion
    for column in sorted(hashes[0].keys() | hashes[1].keys()):
        key = TileKey(row, column)
        same = fusions[0] == fusions[1] and hashes[0].get(column) == hashes[1].get(column)
        one = cropped(a.tiles.patch(key), window)
        other = one if same else cropped(b.tiles.patch(key), window)
        held = [extent_of(patch) for patch in (one, other) if patch]
        if held:
            yield changes(held[0].union(held[-1]), one, other, fusions)


def changes(window: Window, a: Patch, b: Patch, fusions: Fusions) -> Changes:
    """Return where the cells of two grids differ in a window; one patch twice: nowhere."""
    stored = [[spread(patch, layer, window) for layer in Layer] for patch in (a, b)]
    in_a, in_b = ((walls != 0) | (free != 0) | (points != 0) for walls, free, points in stored)
    moved = np.full(window.shape, fusions[0] != fusions[1])
    for one, other in zip(*stored, strict=True) if a is not b else ():
        moved |= one != other
    row, column = np.nonzero(moved)
    values = []
    for layers, fusion in zip(stored, fusions, strict=True):
        walls, free, points = (layer[moved] for layer in layers)
        cells = Readout.of(walls, free, fusion)
        point = necessity_of(points.astype(np.int64, copy=False))
        values.append(np.stack([cells.belief, cells.plausibility, point, cells.contested]))
    return Changes(window, in_a, in_b, row + window.row0, column + window.column0, *values)


class Change(NamedTuple):
    """A cell that changed.

    x, y : its centre [m].
    quantity : one of QUANTITIES.
    a, b : its value in each grid.
    """

    x: float
    y: float
    quantity: str
    a: float
    b: float


def _zeros() -> NDArray[np.int64]:
    return np.zeros((len(QUANTITIES), len(THRESHOLDS)), dtype=np.int64)


@dataclass
class ChangedCells:
    """Counts and sums over cells, added up a piece at a time.

    in_a, in_b, in_both : cells that are not pure ignorance.
    beyond : cells that changed by more than each of THRESHOLDS, by QUANTITIES.
    moved : sum of the changes, by QUANTITIES.
    became, ceased : cells that are contested only in B, only in A.
    """

    in_a: int = 0
    in_b: int = 0
    in_both: int = 0
    beyond: NDArray[np.int64] = field(default_factory=_zeros)
    moved: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(QUANTITIES)))
    became: int = 0
    ceased: int = 0

    @property
    def in_either(self) -> int:
        """Cells that A or B knows."""
        return self.in_a + self.in_b - self.in_both

    def add(self, found: Changes) -> None:
        """Add cells, and what changes among them."""
        # int: numpy's integers are not JSON's.
        self.in_a += int(np.count_nonzero(found.known_a))
        self.in_b += int(np.count_nonzero(found.known_b))
        self.in_both += int(np.count_nonzero(found.known_a & found.known_b))
        size = found.size
        for place, threshold in enumerate(THRESHOLDS):
            self.beyond[:, place] += np.count_nonzero(size > threshold, axis=1)
        self.moved += size.sum(axis=1)
        before, after = found.a[-1] > CONTESTED, found.b[-1] > CONTESTED
        self.became += int(np.count_nonzero(after & ~before))
        self.ceased += int(np.count_nonzero(before & ~after))


class Largest:
    """The largest changes that lie far enough apart to be different places."""

    def __init__(self, count: int, lattice: Lattice) -> None:
        self._count, self._lattice = count, lattice
        self._radius = max(1, math.ceil(APART_M / lattice.resolution - 1e-9))
        self._best: list[tuple[float, int, int, int, float, float]] = []

    def add(self, found: Changes) -> None:
        """Add the largest changes of one tile."""
        size = found.size
        for _ in range(self._count):
            if not size.any():
                break
            place = int(size.max(axis=0).argmax())
            quantity = int(size[:, place].argmax())
            row, column = int(found.row[place]), int(found.column[place])
            a, b = float(found.a[quantity, place]), float(found.b[quantity, place])
            self._best.append((-float(size[quantity, place]), row, column, quantity, a, b))
            size[:, self._near(found.row - row) & self._near(found.column - column)] = 0
        self._best = heapq.nsmallest(self._count * _IN_REACH, self._best)

    def chosen(self) -> tuple[Change, ...]:
        """Return the largest changes, the largest first."""
        cells: list[tuple[int, int]] = []
        found: list[Change] = []
        for _, row, column, quantity, a, b in sorted(self._best):
            if len(found) == self._count:
                break
            if not any(self._near(row - r) and self._near(column - c) for r, c in cells):
                cells.append((row, column))
                place = self._lattice.centre_of(row, column)
                found.append(Change(*place, QUANTITIES[quantity], a, b))
        return tuple(found)

    def _near(self, cells: NDArray[np.intp] | int) -> NDArray[np.bool_]:
        return np.asarray(np.abs(cells) < self._radius)
