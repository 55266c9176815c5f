"""How much one side's evidence contradicts the others', cell by cell (docs/audit.md).

A side is an excursion, or all excursions of a robot. What the others say is the grid without that
side, in the same integers: weights by subtraction, the largest denial but its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers, blank, necessity_of, possibility_of
from possmap.core.lattice import TILE, TileKey, Window, tile_window
from possmap.core.pyramid import Values, Weights
from possmap.core.views import Masses, masses

SQUARE = 32
"""Cells along a side of the squares among which the worst is looked for; divides TILE."""

FREE_COUNTS = 0.5
"""What agreeing on free space counts beside agreeing on a wall: most of a site is free."""

_CELLS = TILE * TILE
_ACROSS = TILE // SQUARE


class Said(NamedTuple):
    """What a side says of walls in one tile, where it says anything.

    cells : numbers of the cells, row by row in the tile, ascending; shape (cells,).
    weights : for a wall; denials : against one; of the same shape.
    """

    cells: NDArray[np.intp]
    weights: Weights
    denials: Values


def said(layers: TileLayers, key: TileKey, window: Window | None = None) -> Said:
    """Return what a partial tile says of walls, of all its cells or of those in a window."""
    whole = tile_window(key)
    weights, denials = (
        layers.get(layer, blank(layer)).copy() for layer in (Layer.WALLS, Layer.FREE)
    )
    if window is not None:
        inside = np.zeros((TILE, TILE), dtype=bool)
        inside[window.intersection(whole).slices_in(whole)] = True
        weights[~inside], denials[~inside] = 0, 0
    return _sparse(weights.reshape(-1), denials.reshape(-1))


def together(sides: Iterable[Said]) -> Said:
    """Return what several sides say as one: weights add up, of denials the larger counts."""
    weights, denials = blank(Layer.WALLS).reshape(-1), blank(Layer.FREE).reshape(-1)
    for side in sides:
        weights[side.cells] += side.weights
        denials[side.cells] = np.maximum(denials[side.cells], side.denials)
    return _sparse(weights, denials)


def _sparse(weights: NDArray[np.generic], denials: NDArray[np.generic]) -> Said:
    cells = np.flatnonzero((weights != 0) | (denials != 0))
    return Said(cells, weights[cells].astype(np.int64), denials[cells].astype(np.uint16))


class Crowd:
    """All sides of one tile, from which any one can be left out.

    Of denials the largest two are kept, and whose the largest is: enough for every side at once.
    """

    def __init__(self, sides: Sequence[Said]) -> None:
        self.sides = sides
        self._weights = np.zeros(_CELLS, dtype=np.int64)
        self._largest, self._second = np.zeros((2, _CELLS), dtype=np.uint16)
        self._owner = np.full(_CELLS, -1, dtype=np.intp)
        for number, side in enumerate(sides):
            self._weights[side.cells] += side.weights
            before = self._largest[side.cells]
            self._second[side.cells] = np.maximum(
                self._second[side.cells], np.minimum(before, side.denials)
            )
            self._owner[side.cells[side.denials > before]] = number
            self._largest[side.cells] = np.maximum(before, side.denials)

    def without(self, number: int) -> Said:
        """Return what all but one side say, in the cells of which that one says anything."""
        side = self.sides[number]
        own = self._owner[side.cells] == number
        denials = np.where(own, self._second[side.cells], self._largest[side.cells])
        return Said(side.cells, self._weights[side.cells] - side.weights, denials)


@dataclass
class Tally:
    """What a side and the others say of the same cells, added up tile by tile.

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
        Row and column of the cell that contradicts most in the square that does, and its K; None
        where nothing contradicts.
    """

    said: int = 0
    compared: int = 0
    wall_free: float = 0.0
    free_wall: float = 0.0
    wall_wall: float = 0.0
    free_free: float = 0.0
    worst: tuple[int, int, float] | None = None
    _worst_sum: float = 0.0

    @property
    def conflict(self) -> float:
        """Mean of Dempster's K over the cells compared; 0 if there are none."""
        return (self.wall_free + self.free_wall) / max(1, self.compared)

    @property
    def share(self) -> float:
        """Which share of its cells was compared."""
        return self.compared / max(1, self.said)

    @property
    def contradiction(self) -> float:
        """What contradicts, of all that both sides commit themselves on; 0 to 1."""
        against = self.wall_free + self.free_wall
        whole = against + self.wall_wall + FREE_COUNTS * self.free_free
        return against / whole if whole else 0.0

    def add(self, key: TileKey, mine: Said, others: Said) -> None:
        """Add one tile: what the side says, and the others in the same cells."""
        self.said += len(mine.cells)
        both = (others.weights != 0) | (others.denials != 0)
        if not both.any():
            return
        cells = mine.cells[both]
        self.compared += len(cells)
        one = committed(mine.weights[both], mine.denials[both])
        other = committed(others.weights[both], others.denials[both])
        wall_free, free_wall = one.wall * other.free, one.free * other.wall
        self.wall_free += float(wall_free.sum())
        self.free_wall += float(free_wall.sum())
        self.wall_wall += float((one.wall * other.wall).sum())
        self.free_free += float((one.free * other.free).sum())
        self._note(key, cells, wall_free + free_wall)

    def _note(self, key: TileKey, cells: NDArray[np.intp], against: NDArray[np.float64]) -> None:
        """Remember the square in which most contradicts, and in it the worst cell."""
        row, column = np.divmod(cells, TILE)
        square = row // SQUARE * _ACROSS + column // SQUARE
        sums = np.bincount(square, against)
        most = int(sums.argmax())
        if sums[most] > self._worst_sum:
            inside = np.flatnonzero(square == most)
            at = inside[int(against[inside].argmax())]
            self._worst_sum = float(sums[most])
            place = key.row * TILE + int(row[at]), key.column * TILE + int(column[at])
            self.worst = (*place, float(against[at]))


def committed(weights: Weights, denials: Values) -> Masses:
    """Return the masses of METHOD §4, each side's own conflict normalised away."""
    return masses(necessity_of(weights), possibility_of(denials))
