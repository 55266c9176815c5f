"""How the cells of two grids differ: changes of a tile, sums over all, and the largest."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

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


class CellPair(NamedTuple):
    """The same cells of two grids, A and B; ``equal``: they are known to agree on all."""

    window: Window
    a: Patch
    b: Patch
    equal: bool = False

    def known(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which cells of A and of B are not pure ignorance."""
        a = _known(self.a, self.window)
        return a, a if self.equal else _known(self.b, self.window)


class Changes(NamedTuple):
    """The cells of a pair whose evidence differs; row and column are those of the lattice.

    a, b : the values of QUANTITIES, and how contested each cell is, shape (4, cells).
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    a: NDArray[np.float64]
    b: NDArray[np.float64]

    @property
    def size(self) -> NDArray[np.float64]:
        """How far each of QUANTITIES moves, shape (3, cells)."""
        return np.abs(self.b - self.a)[: len(QUANTITIES)]


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


def pairs(row: int, a: Grid, b: Grid, window: Window) -> Iterator[CellPair]:
    """Yield the tiles of a row that A or B holds; what neither knows is left out.

    Equal hashes tell that no cell differs: of those tiles one is read for the two.
    """
    hashes = [grid.tiles.directory.hashes_of_row(row, window) for grid in (a, b)]
    comparable = a.settings.free_fusion == b.settings.free_fusion
    for column in sorted(hashes[0].keys() | hashes[1].keys()):
        key = TileKey(row, column)
        one = cropped(a.tiles.patch(key), window)
        if comparable and hashes[0].get(column) == hashes[1].get(column):
            if one:
                yield CellPair(extent_of(one), one, one, equal=True)
            continue
        other = cropped(b.tiles.patch(key), window)
        held = [extent_of(patch) for patch in (one, other) if patch]
        if held:
            yield CellPair(held[0].union(held[-1]), one, other)


def changes(pair: CellPair, fusions: tuple[FreeFusion, FreeFusion]) -> Changes:
    """Return where two grids differ, and by how much; ``fusions``: of A and B."""
    if pair.equal:
        nothing = np.zeros(0, dtype=np.intp)
        return Changes(nothing, nothing, *np.zeros((2, len(QUANTITIES) + 1, 0)))
    moved = np.full(pair.window.shape, fusions[0] != fusions[1])
    for layer in Layer:
        moved |= spread(pair.a, layer, pair.window) != spread(pair.b, layer, pair.window)
    row, column = np.nonzero(moved)
    a, b = (
        _values(patch, pair.window, moved, fusion)
        for patch, fusion in zip((pair.a, pair.b), fusions, strict=True)
    )
    return Changes(row + pair.window.row0, column + pair.window.column0, a, b)


def _known(patch: Patch, window: Window) -> NDArray[np.bool_]:
    found = np.zeros(window.shape, dtype=np.bool_)
    for layer in patch:
        found |= spread(patch, layer, window) != 0
    return found


def _values(
    patch: Patch, window: Window, some: NDArray[np.bool_], fusion: FreeFusion
) -> NDArray[np.float64]:
    walls, free, points = (spread(patch, layer, window)[some] for layer in Layer)
    cells = Readout.of(walls, free, fusion)
    point = necessity_of(points.astype(np.int64, copy=False))
    return np.stack([cells.belief, cells.plausibility, point, cells.contested])


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

    def add(self, pair: CellPair, found: Changes) -> None:
        """Add cells, and what changes among them."""
        a, b = pair.known()
        # int: numpy's integers are not JSON's.
        self.in_a += int(np.count_nonzero(a))
        self.in_b += int(np.count_nonzero(b))
        self.in_both += int(np.count_nonzero(a & b))
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
