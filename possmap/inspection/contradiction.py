"""How much one side's evidence contradicts the others', cell by cell (docs/audit.md).

A side is an excursion; the others are the excursions of other robots. Both are weights of evidence
for a wall and against it, which add up over excursions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, Window
from possmap.core.patches import Patch, extent_of, spread
from possmap.core.views import CellArray, Masses, Readout

SQUARE = 32
"""Cells along a side of the squares among which the worst is looked for; divides TILE."""

FREE_COUNTS = 0.5
"""What agreeing on free space counts beside agreeing on a wall: most of a site is free."""

_ACROSS = TILE // SQUARE
_LAYERS = (Layer.WALLS, Layer.FREE)


class Crowd:
    """What sides say together in a window: sums, from which any of them can be taken out again."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self._weights = np.zeros((len(_LAYERS), *window.shape), dtype=np.int64)

    def add(self, side: Patch) -> None:
        """Add a side, which lies within the window."""
        for number, layer in enumerate(_LAYERS):
            if layer in side:
                window, cells = side[layer]
                self._weights[number][window.slices_in(self.window)] += cells

    def without(self, other: Crowd) -> Crowd:
        """Return what is left without some of the sides added, of the same window."""
        left = Crowd(self.window)
        np.subtract(self._weights, other._weights, out=left._weights)
        return left

    def around(self, window: Window) -> NDArray[np.int64]:
        """Return the weights for a wall and against it in a part of the window."""
        part: NDArray[np.int64] = self._weights[(slice(None), *window.slices_in(self.window))]
        return part


class Worst(NamedTuple):
    """The cell that contradicts most, in the square of a tile that does.

    row, column, conflict : of the cell, and K there. in_square : the sum of K over the square.
    """

    row: int
    column: int
    conflict: float
    in_square: float


@dataclass(frozen=True, slots=True)
class Contradiction:
    """What a side and the others say of the same cells; of several tiles or sides it adds up.

    Attributes
    ----------
    said
        Cells of which the side says anything.
    compared
        Those of them of which the others do too.
    wall_free, free_wall
        Sum of m(wall)·m'(free), the side's wall where the others are free, and of m(free)·m'(wall).
    wall_wall, free_free
        Sums of the products that agree.
    worst
        Of all tiles; None where nothing contradicts.
    """

    said: int = 0
    compared: int = 0
    wall_free: float = 0.0
    free_wall: float = 0.0
    wall_wall: float = 0.0
    free_free: float = 0.0
    worst: Worst | None = None

    def __add__(self, more: Contradiction) -> Contradiction:
        worst = [one for one in (self.worst, more.worst) if one]
        return Contradiction(
            self.said + more.said,
            self.compared + more.compared,
            self.wall_free + more.wall_free,
            self.free_wall + more.free_wall,
            self.wall_wall + more.wall_wall,
            self.free_free + more.free_free,
            max(worst, key=lambda one: one.in_square) if worst else None,
        )

    @property
    def conflict(self) -> float:
        """Mean of Dempster's K over the cells compared; 0 if there are none."""
        return (self.wall_free + self.free_wall) / max(1, self.compared)

    @property
    def share(self) -> float:
        """Which share of its cells was compared."""
        return self.compared / max(1, self.said)

    @property
    def degree(self) -> float:
        """What contradicts, of all that both sides commit themselves on; 0 to 1."""
        against = self.wall_free + self.free_wall
        whole = against + self.wall_wall + FREE_COUNTS * self.free_free
        return against / whole if whole else 0.0


def compare(mine: Patch, others: Crowd) -> Contradiction:
    """Compare what a side says in one tile with what the others say in the same cells."""
    if not mine:
        return Contradiction()
    window = extent_of(mine)
    own = np.stack([spread(mine, layer, window) for layer in _LAYERS])
    theirs = others.around(window)
    says = own.any(axis=0)
    cells = np.flatnonzero(says & theirs.any(axis=0))
    said = int(np.count_nonzero(says))
    if not len(cells):
        return Contradiction(said)
    one, other = (_masses(side.reshape(2, -1)[:, cells]) for side in (own, theirs))
    wall_free, free_wall = one.wall * other.free, one.free * other.wall
    return Contradiction(
        said,
        len(cells),
        wall_free=float(wall_free.sum()),
        free_wall=float(free_wall.sum()),
        wall_wall=float((one.wall * other.wall).sum()),
        free_free=float((one.free * other.free).sum()),
        worst=_worst(window, cells, wall_free + free_wall),
    )


def _masses(weights: NDArray[np.int64]) -> Masses:
    return Readout.of(weights[0], weights[1], "dempster").masses


def _worst(window: Window, cells: NDArray[np.intp], against: CellArray) -> Worst | None:
    """Return the square in which most contradicts, and in it the worst cell."""
    some = np.flatnonzero(against)
    if not len(some):
        return None
    row, column = np.divmod(cells[some], window.shape[1])
    row, column, against = row + window.row0, column + window.column0, against[some]
    square = row % TILE // SQUARE * _ACROSS + column % TILE // SQUARE
    sums = np.bincount(square, against)
    most = int(sums.argmax())
    inside = np.flatnonzero(square == most)
    at = inside[int(against[inside].argmax())]
    return Worst(int(row[at]), int(column[at]), float(against[at]), float(sums[most]))
