"""How two maps differ, cell by cell: changes, and sums of them that need little memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers, necessity_of, possibility_of
from possmap.core.lattice import Window
from possmap.core.views import contradicted

QUANTITIES = ("necessity", "possibility", "point")
"""What is compared: N and Π of a wall, and N of a singular point."""

THRESHOLDS = (0.01, 0.1, 0.5)
"""A cell counts as changed by more than so much."""


class CellPair(NamedTuple):
    """The same cells of two grids, A and B.

    a, b : one array for each layer, of the window's shape.
    equal : whether the grids are known to agree on all of them.
    """

    window: Window
    a: TileLayers
    b: TileLayers
    equal: bool


class Changes(NamedTuple):
    """The cells of a pair whose evidence differs; row and column are those of the lattice.

    a, b : the values of QUANTITIES, shape (3, cells).
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    a: NDArray[np.float64]
    b: NDArray[np.float64]

    @property
    def size(self) -> NDArray[np.float64]:
        """How far each value moves, shape (3, cells)."""
        return np.abs(self.b - self.a)


_NO_CHANGES = Changes(
    *np.zeros((2, 0), dtype=np.intp), *np.zeros((2, len(QUANTITIES), 0), dtype=np.float64)
)


def known(layers: TileLayers) -> NDArray[np.bool_]:
    """Return which cells are not pure ignorance."""
    walls, free, points = (layers[layer] != 0 for layer in Layer)
    found: NDArray[np.bool_] = walls | free | points
    return found


def changes(pair: CellPair) -> Changes:
    """Return where two grids differ, and by how much."""
    if pair.equal:
        return _NO_CHANGES
    moved = np.zeros(pair.window.shape, dtype=bool)
    for layer in Layer:
        moved |= pair.a[layer] != pair.b[layer]
    row, column = np.nonzero(moved)
    return Changes(
        row + pair.window.row0,
        column + pair.window.column0,
        _values(pair.a, moved),
        _values(pair.b, moved),
    )


def _values(layers: TileLayers, some: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.stack(
        [
            necessity_of(layers[Layer.WALLS][some].astype(np.int64, copy=False)),
            possibility_of(layers[Layer.FREE][some].astype(np.uint16, copy=False)),
            necessity_of(layers[Layer.POINTS][some].astype(np.int64, copy=False)),
        ]
    )


def _zeros() -> NDArray[np.int64]:
    return np.zeros((len(QUANTITIES), len(THRESHOLDS)), dtype=np.int64)


@dataclass
class Tally:
    """Counts and sums over cells, added up a piece at a time.

    in_a, in_b, in_both, in_either : cells that are not pure ignorance.
    beyond : cells that changed by more than each of THRESHOLDS, by QUANTITIES.
    moved : sum of the changes, by QUANTITIES.
    became, ceased : cells that are contradicted only in B, only in A.
    """

    in_a: int = 0
    in_b: int = 0
    in_both: int = 0
    in_either: int = 0
    beyond: NDArray[np.int64] = field(default_factory=_zeros)
    moved: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(QUANTITIES)))
    became: int = 0
    ceased: int = 0

    def add(self, pair: CellPair, found: Changes) -> None:
        """Add cells, and what changes among them."""
        a = known(pair.a)
        b = a if pair.equal else known(pair.b)
        # int: numpy's integers are not JSON's.
        both = int(np.count_nonzero(a & b))
        in_a, in_b = int(np.count_nonzero(a)), int(np.count_nonzero(b))
        self.in_a += in_a
        self.in_b += in_b
        self.in_both += both
        self.in_either += in_a + in_b - both
        if not found.row.size:
            return
        size = found.size
        for place, threshold in enumerate(THRESHOLDS):
            self.beyond[:, place] += np.count_nonzero(size > threshold, axis=1)
        self.moved += size.sum(axis=1)
        before, after = contradicted(found.a[0], found.a[1]), contradicted(found.b[0], found.b[1])
        self.became += int(np.count_nonzero(after & ~before))
        self.ceased += int(np.count_nonzero(before & ~after))
