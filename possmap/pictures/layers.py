"""What a picture can show: each cell a number that only grows the more it matters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import necessity_of
from possmap.core.lattice import Window
from possmap.core.patches import Patch, extent_of, spread
from possmap.core.pyramid import Ints
from possmap.core.settings import FreeFusion
from possmap.core.views import VIEWS, CellArray, Readout
from possmap.pictures import palettes
from possmap.pictures.palettes import Indices, Table
from possmap.pictures.raster import Raster

Ranks: TypeAlias = NDArray[np.unsignedinteger]

LEVELS = 255
"""Values become 0 … 254, so that 255 is left for what is unknown."""
UNKNOWN_INDEX = 255

MAP = "map"
COVERAGE = "coverage"


class Cells(Protocol):
    """Where the numbers of a grid come from: a file, or what was laid out again in memory."""

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what is known of a window, a few tiles at a time."""


@dataclass(frozen=True, slots=True)
class PictureLayer:
    """A value to draw.

    title : for people.
    by_largest : whether a block of cells shows its largest value, or its smallest.
    low, high : what the ends of the scale mean.
    """

    title: str
    by_largest: bool
    low: str
    high: str


LAYERS: Mapping[str, PictureLayer] = MappingProxyType(
    {
        "belief": PictureLayer("belief in a wall (Bel)", True, "none", "certain"),
        "plausibility": PictureLayer("plausibility of a wall (Pl)", False, "free", "possible"),
        "contested": PictureLayer("contested", True, "one side", "undecided"),
        "ignorance": PictureLayer("ignorance: Pl - Bel", False, "settled", "unknown"),
        "pignistic": PictureLayer("pignistic probability", True, "free", "wall"),
        "probability": PictureLayer("probability of a wall", True, "free", "wall"),
        "necessity": PictureLayer("necessity of a wall (N)", True, "no sign", "certain"),
        "possibility": PictureLayer("possibility of a wall", False, "free", "possible"),
        "conflict": PictureLayer("conflict K", True, "none", "total"),
        "contradicted": PictureLayer("contradicted: N above possibility", True, "no", "yes"),
        "points": PictureLayer("necessity of a singular point", True, "none", "certain"),
    }
)
"""The layers whose scale is 0 to 1, by name."""

NAMES = (MAP, *LAYERS, COVERAGE)
"""What a picture can show."""


def indices(
    name: str, cells: Cells, raster: Raster, base_rate: float, free_fusion: FreeFusion
) -> Indices:
    """Return palette indices, the first row the highest y: of the map, or of a layer.

    Of a layer 0 … 254 stand for values 0 … 1, 255 for what is unknown.
    """
    if name == MAP:
        return _drawn(
            cells,
            raster,
            lambda walls, free, points: palettes.map_indices(
                Readout.of(walls, free, free_fusion).masses, necessity_of(points)
            ),
            np.arange(256, dtype=np.uint8),
        )
    return _values(name, cells, raster, base_rate, free_fusion, LEVELS, UNKNOWN_INDEX)


def gray(
    name: str, cells: Cells, raster: Raster, base_rate: float, free_fusion: FreeFusion
) -> Indices:
    """Return a layer as round(255·v), without a tone for what is unknown: numbers to read back."""
    nothing = np.zeros(1, dtype=np.int64)
    unknown = int(np.rint(255 * _value(name, nothing, nothing, nothing, base_rate, free_fusion))[0])
    return _values(name, cells, raster, base_rate, free_fusion, 256, unknown)


def _values(
    name: str,
    cells: Cells,
    raster: Raster,
    base_rate: float,
    free_fusion: FreeFusion,
    levels: int,
    unknown: int,
) -> Indices:
    by_largest = LAYERS[name].by_largest

    def rank(walls: Ints, free: Ints, points: Ints) -> NDArray[np.int16]:
        value = _value(name, walls, free, points, base_rate, free_fusion)
        level = np.rint((levels - 1) * value).astype(np.int16)
        return level + 1 if by_largest else levels - level

    level = np.arange(levels, dtype=np.uint8)
    known = level if by_largest else level[::-1]
    return _drawn(cells, raster, rank, np.array([unknown, *known], dtype=np.uint8))


def _drawn(
    cells: Cells,
    raster: Raster,
    rank: Callable[[Ints, Ints, Ints], NDArray[np.integer]],
    table: Indices,
) -> Indices:
    """Return what blocks show, in bands of rows, so that what is in work is small beside it.

    rank : of cells of which anything is known, by their weights: above 0, the larger, the more a
        cell matters. So a block's is the largest of its cells', and what is unknown, 0, hides
        nothing.
    table : what each rank is shown as.
    """
    whole: Indices = np.empty(raster.blocks, dtype=np.uint8)
    upright = whole[::-1]
    for first, band in raster.bands():
        found: Ranks = np.zeros(band.blocks, dtype=np.uint8 if len(table) <= 256 else np.uint16)
        for patch in cells.patches(band.window):
            window = extent_of(patch)
            stored = [spread(patch, layer, window) for layer in Layer]
            known = (stored[0] != 0) | (stored[1] != 0) | (stored[2] != 0)
            ranks = np.zeros(window.shape, dtype=found.dtype)
            ranks[known] = rank(*(layer[known] for layer in stored))
            band.raise_to(found, window, ranks)
        upright[first : first + len(found)] = table[found]
    return whole


def _value(
    name: str, walls: Ints, free: Ints, points: Ints, base_rate: float, free_fusion: FreeFusion
) -> CellArray:
    if name == "points":
        return necessity_of(points)
    cells = Readout.of(walls, free, free_fusion)
    if name == "contradicted":
        return cells.contradicted.astype(np.float64)
    return VIEWS[name](cells, base_rate)


def letters(name: str) -> str:
    """Return the 256 characters that a layer's indices stand for where there is no colour."""
    if name == MAP:
        return palettes.map_letters()
    tenths = "".join(str(min(9, index * 10 // LEVELS)) for index in range(LEVELS))
    return tenths + " "


def colours(name: str, palette: str) -> Table:
    """Return the 256 colours that a layer's indices stand for."""
    if name == MAP:
        return palettes.map_table(palette)
    at = np.rint(np.linspace(0, 255, LEVELS)).astype(int)
    values = palettes.table(palette)[at]
    return np.vstack([values, [palettes.unknown(palette)]]).astype(np.uint8)
