"""How much one excursion's evidence contradicts that of other robots, cell by cell (docs/audit.md).

Both are weights of evidence for a wall and against it, which add up over excursions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import denial_table, stamp_layer
from possmap.core.lattice import TILE, TileKey, Window, tile_window
from possmap.core.patches import Crop, Patch, extent_of, spread
from possmap.core.plan import ExcursionPlan, TileWork, by_tile
from possmap.core.pyramid import COLUMNS, Floats, Ints
from possmap.core.settings import EvidenceSettings
from possmap.core.views import CellArray, Masses, Readout

SQUARE = 32
"""Cells along a side of the squares among which the worst is looked for; divides TILE."""

FREE_COUNTS = 0.5
"""What agreeing on free space counts beside agreeing on a wall: most of a site is free."""

_ACROSS = TILE // SQUARE
_LAYERS = (Layer.WALLS, Layer.FREE)  # singular points contradict nobody
_MAX_ERROR, _WIDTH = COLUMNS.index("max_error"), COLUMNS.index("width")
_MOST_KEPT = 1 << 25
"""More is not kept of a tile [bytes]: to stamp it again takes hardly longer than to keep it."""


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


def compare(mine: Patch, others: Ints, within: Window) -> Contradiction:
    """Compare what a side says in one tile with what the others say in the same cells.

    others : their weights for a wall and against it, shape (2, rows, columns) of ``within``.
    """
    if not mine:
        return Contradiction()
    window = extent_of(mine)
    own = np.stack([spread(mine, layer, window) for layer in _LAYERS])
    theirs = others[(slice(None), *window.slices_in(within))]
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


class TileSides:
    """Excursions in one tile: stamped when asked for, and kept as far as there is room.

    Attributes
    ----------
    window
        The cells asked for that any of them may touch.
    numbers
        Of the excursions, ascending.
    """

    def __init__(
        self, works: Mapping[int, TileWork], within: Window, settings: EvidenceSettings
    ) -> None:
        self._works, self._settings = works, settings
        segments = np.concatenate([work.segments for work in works.values()])
        self.window = _touched(segments, settings.resolution).intersection(within)
        self.numbers = list(works)
        self._kept: dict[int, Patch] = {}
        self._room = _MOST_KEPT

    def said(self, number: int) -> Patch:
        """Return the weights of what an excursion says: each layer only where it says something.

        Of free space too: what a denial weighs under Dempster's rule, however the grid combines.
        """
        if number in self._kept:
            return self._kept[number]
        work = self._works[number]
        crops = {layer: self._stamped(work, layer) for layer in _LAYERS if layer in work.pieces}
        found = {layer: crop for layer, crop in crops.items() if crop.cells.any()}
        size = sum(crop.cells.nbytes for crop in found.values())
        if size <= self._room:
            self._room -= size
            self._kept[number] = found
        return found

    def together(self, numbers: Sequence[int]) -> Ints:
        """Return the weights that some excursions say together, shape (2, rows, columns)."""
        whole = np.zeros((len(_LAYERS), *self.window.shape), dtype=np.int64)
        for number in numbers:
            for layer, (window, cells) in self.said(number).items():
                whole[_LAYERS.index(layer)][window.slices_in(self.window)] += cells
        return whole

    def compared(self, robots: Sequence[str]) -> Iterator[tuple[int, Contradiction]]:
        """Yield each excursion, held against what the other robots say here.

        robots : of all excursions, by number.
        """
        teams: dict[str, list[int]] = {}
        for number in self.numbers:
            teams.setdefault(robots[number], []).append(number)
        everybody = self.together(self.numbers)
        for numbers in teams.values():
            others = everybody - self.together(numbers)
            for number in numbers:
                yield number, compare(self.said(number), others, self.window)

    def _stamped(self, work: TileWork, layer: Layer) -> Crop:
        segments = work.segments[work.pieces[layer][:, 0]]
        window = _touched(segments, self._settings.resolution).intersection(self.window)
        cells = np.zeros(window.shape, dtype=np.int64)
        if window.cells:
            stamp_layer(cells, window, work, layer, self._settings)
        if layer is Layer.FREE and self._settings.free_fusion == "minimum":
            cells = denial_table(1.0)[cells]
        return Crop(window, cells)


def _touched(segments: Floats, resolution: float) -> Window:
    """Return a window of all cells that segments may touch, and some more."""
    half = np.minimum(segments[:, 4:8], segments[:, _MAX_ERROR, None])
    reach = np.maximum(half[:, :2], half[:, 2:])
    width = segments[:, _WIDTH, None]
    # A swath reaches across and along, in any direction (core/swath.py).
    swath = 2 * reach.sum(axis=1, keepdims=True) + np.maximum(width, resolution)
    reach = np.where(width > 0, swath, reach)
    ends = segments[:, [0, 1]], segments[:, [2, 3]]
    column0, row0 = np.floor((np.minimum(*ends) - reach).min(axis=0) / resolution).tolist()
    column1, row1 = np.ceil((np.maximum(*ends) + reach).max(axis=0) / resolution).tolist()
    # The cell of a centre, half a cell more, and what rounding does far from the origin.
    return Window(int(row0) - 2, int(row1) + 3, int(column0) - 2, int(column1) + 3)


def sides_by_tile(
    plans: Sequence[ExcursionPlan], settings: EvidenceSettings, within: Window | None
) -> tuple[int, Iterator[TileSides]]:
    """Return how many tiles excursions touch, and what they say there, by place.

    Parameters
    ----------
    plans
        Of each excursion; its place among them is its number.
    within
        Tiles and cells beyond are left out.
    """
    tiles: dict[TileKey, dict[int, TileWork]] = {}
    for number, plan in enumerate(plans):
        for work in by_tile([plan])[1]:
            tiles.setdefault(work.key, {})[number] = work
    windows = {
        key: tile_window(key) if within is None else tile_window(key).intersection(within)
        for key in sorted(tiles)
    }
    shown = {key: cells for key, cells in windows.items() if cells.cells}
    return len(shown), (TileSides(tiles[key], cells, settings) for key, cells in shown.items())
