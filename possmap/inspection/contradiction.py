"""How much one side's evidence contradicts the others', cell by cell (docs/audit.md).

A side is an excursion, or all excursions of a robot. What the others say is the grid without that
side, in the same integers: weights by subtraction, the largest denial but its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, possibility_of
from possmap.core.lattice import TILE, Window
from possmap.core.patches import Crop, Patch, extent_of, spread
from possmap.core.pyramid import Weights
from possmap.core.settings import FreeFusion
from possmap.core.views import CellArray, Readout

SQUARE = 32
"""Cells along a side of the squares among which the worst is looked for; divides TILE."""

FREE_COUNTS = 0.5
"""What agreeing on free space counts beside agreeing on a wall: most of a site is free."""

_ACROSS = TILE // SQUARE


class Crowd:
    """What sides say together in a window, from which any one can be left out.

    Under ``free_fusion: minimum`` the largest two denials are kept: enough for every side at once.
    However many sides there are, it takes 24 bytes a cell.
    """

    def __init__(self, window: Window, free_fusion: FreeFusion) -> None:
        self.window = window
        self._adds_up = free_fusion == "dempster"
        self._walls = False
        self._weights = np.zeros(window.shape, dtype=np.int64)
        self._largest, self._second = np.zeros((2, *window.shape), dtype=np.int64)

    def add(self, side: Patch) -> None:
        """Add a side, which lies within the window."""
        if Layer.WALLS in side:
            window, weights = side[Layer.WALLS]
            self._weights[window.slices_in(self.window)] += weights
            self._walls = True
        if Layer.FREE in side:
            window, denials = side[Layer.FREE]
            inside = window.slices_in(self.window)
            largest, second = self._largest[inside], self._second[inside]
            if self._adds_up:
                largest += denials
                return
            np.maximum(second, np.minimum(largest, denials), out=second)
            np.maximum(largest, denials, out=largest)

    def whole(self) -> Patch:
        """Return what all sides say as one, fused as in the grid."""
        layers = ((Layer.WALLS, self._weights), (Layer.FREE, self._largest))
        return {layer: Crop(self.window, cells) for layer, cells in layers if cells.any()}

    def without(self, side: Patch) -> Patch:
        """Return what all but one of the sides added say, in the cells around what that one says.

        Whoever denies as much as the largest is left with the second, which is as large if two do.
        """
        if not side:
            return {}
        window = extent_of(side)
        around = window.slices_in(self.window)
        denials = self._largest[around]
        if Layer.FREE in side:
            own = spread(side, Layer.FREE, window)
            if self._adds_up:
                denials = denials - own
            else:
                denials = np.where(own == denials, self._second[around], denials)
        found = {Layer.FREE: Crop(window, denials)}
        if self._walls:
            weights = self._weights[around]
            if Layer.WALLS in side:
                weights = weights - spread(side, Layer.WALLS, window)
            found[Layer.WALLS] = Crop(window, weights)
        return found


class Worst(NamedTuple):
    """The cell that contradicts most, in the square of a tile that does.

    row, column, conflict : of the cell, and K there. in_square : the sum of K over the square.
    """

    row: int
    column: int
    conflict: float
    in_square: float


class Compared(NamedTuple):
    """A side beside the others in one tile; the sums that ``Tally`` adds up."""

    said: int = 0
    compared: int = 0
    wall_free: float = 0.0
    free_wall: float = 0.0
    wall_wall: float = 0.0
    free_free: float = 0.0
    worst: Worst | None = None


def compare(mine: Patch, others: Patch, free_fusion: FreeFusion) -> Compared:
    """Compare what a side says in one tile with what the others say in the same cells."""
    if not mine:
        return Compared()
    window = extent_of(mine)
    somewhere = _says_anything(mine, window)
    said = int(np.count_nonzero(somewhere))
    if not others:
        return Compared(said)
    cells = np.flatnonzero(somewhere & _says_anything(others, window))
    if not len(cells):
        return Compared(said)
    if Layer.WALLS not in mine and Layer.WALLS not in others:
        # Paths alone contradict nobody.
        free = [_free_alone(_denials(side, window, cells), free_fusion) for side in (mine, others)]
        return Compared(said, len(cells), free_free=float((free[0] * free[1]).sum()))
    one, other = (
        committed(_weights(side, window, cells), _denials(side, window, cells), free_fusion)
        for side in (mine, others)
    )
    wall_free, free_wall = one.wall * other.free, one.free * other.wall
    return Compared(
        said,
        len(cells),
        wall_free=float(wall_free.sum()),
        free_wall=float(free_wall.sum()),
        wall_wall=float((one.wall * other.wall).sum()),
        free_free=float((one.free * other.free).sum()),
        worst=_worst(window, cells, wall_free + free_wall),
    )


def _says_anything(side: Patch, window: Window) -> NDArray[np.bool_]:
    found = np.zeros(window.shape, dtype=np.bool_)
    for layer in side:
        found |= spread(side, layer, window) != 0
    return found


def _weights(side: Patch, window: Window, cells: NDArray[np.intp]) -> Weights:
    return _in_cells(side, Layer.WALLS, window, cells)


def _denials(side: Patch, window: Window, cells: NDArray[np.intp]) -> Weights:
    return _in_cells(side, Layer.FREE, window, cells)


def _in_cells(side: Patch, layer: Layer, window: Window, cells: NDArray[np.intp]) -> LayerArray:
    every = spread(side, layer, window).reshape(-1)
    return every if len(cells) == len(every) else every[cells]


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
        Of all tiles; None where nothing contradicts.
    """

    said: int = 0
    compared: int = 0
    wall_free: float = 0.0
    free_wall: float = 0.0
    wall_wall: float = 0.0
    free_free: float = 0.0
    worst: Worst | None = None

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

    def add(self, found: Compared) -> None:
        """Add one tile."""
        self.said += found.said
        self.compared += found.compared
        self.wall_free += found.wall_free
        self.free_wall += found.free_wall
        self.wall_wall += found.wall_wall
        self.free_free += found.free_free
        if found.worst and found.worst.in_square > (self.worst.in_square if self.worst else 0):
            self.worst = found.worst


class Committed(NamedTuple):
    """What a side commits itself to: m(wall) and m(free) of METHOD §4, of the same shape."""

    wall: CellArray
    free: CellArray


def committed(weights: Weights, denials: Weights, free_fusion: FreeFusion) -> Committed:
    """Return the masses of METHOD §4, each side's own conflict normalised away."""
    # Most cells hold no weight: then what is denied is free.
    wall, free = np.zeros(weights.shape), _free_alone(denials, free_fusion)
    some = np.flatnonzero(weights)
    if len(some):
        found = Readout.of(weights[some], denials[some], free_fusion).masses
        wall[some], free[some] = found.wall, found.free
    return Committed(wall, free)


def _free_alone(denials: Weights, free_fusion: FreeFusion) -> CellArray:
    """Return m(free) where there is no weight."""
    return 1 - possibility_of(denials, free_fusion)
