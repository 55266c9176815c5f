"""The layers that a picture can show, each shrunk so that what matters survives."""

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
from possmap.pictures.raster import Raster

Indices: TypeAlias = NDArray[np.uint8]
"""One palette index per block, shape (rows, columns), the first row the highest y."""

LEVELS = 255
"""Values become 0 … 254, so that 255 is left for what is unknown."""
UNKNOWN_INDEX = 255


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


def drawn(
    name: str, cells: Cells, raster: Raster, base_rate: float, free_fusion: FreeFusion
) -> Indices:
    """Return a layer's palette indices: 0 … 254 for values 0 … 1, 255 where nothing is known."""
    table = _level_of_rank(name, LEVELS, UNKNOWN_INDEX)

    def band(part: Raster) -> Indices:
        found: Indices = table[_ranks(name, cells, part, base_rate, free_fusion, LEVELS)]
        return found

    return by_bands(raster, band)


def drawn_gray(
    name: str, cells: Cells, raster: Raster, base_rate: float, free_fusion: FreeFusion
) -> Indices:
    """Return a layer as round(255·v), without a tone for what is unknown: numbers to read back."""
    nothing = np.zeros(1, dtype=np.int64)
    unknown = _values(name, nothing, nothing, nothing, base_rate, free_fusion)
    table = _level_of_rank(name, 256, int(np.rint(255 * unknown)[0]))

    def band(part: Raster) -> Indices:
        found: Indices = table[_ranks(name, cells, part, base_rate, free_fusion, 256)]
        return found

    return by_bands(raster, band)


def by_bands(raster: Raster, draw: Callable[[Raster], Indices]) -> Indices:
    """Return a picture drawn in bands of rows, so that what is in work is small beside it.

    draw : returns the indices of a band, the first row the lowest y, which the picture turns round.
    """
    whole: Indices = np.empty(raster.blocks, dtype=np.uint8)
    upright = whole[::-1]
    for first, band in raster.bands():
        upright[first : first + band.blocks[0]] = draw(band)
    return whole


def _level_of_rank(name: str, levels: int, unknown: int) -> Indices:
    """Return the level that each rank stands for; the first rank is what is unknown."""
    level = np.arange(levels, dtype=np.uint8)
    table: Indices = np.concatenate(
        [np.array([unknown], dtype=np.uint8), level if LAYERS[name].by_largest else level[::-1]]
    )
    return table


def _ranks(
    name: str,
    cells: Cells,
    raster: Raster,
    base_rate: float,
    free_fusion: FreeFusion,
    levels: int,
) -> NDArray[np.unsignedinteger]:
    """Return what a block shows as a number that only grows the more it matters.

    0 is unknown; then come ``levels`` values, upwards or, where the smallest counts, downwards. So
    a block's rank is the largest of its cells', and what is unknown hides nothing.
    """
    dtype = np.uint8 if levels < 256 else np.uint16
    found: NDArray[np.unsignedinteger] = np.zeros(raster.blocks, dtype=dtype)
    for patch in cells.patches(raster.window):
        window = extent_of(patch)
        stored = [spread(patch, layer, window) for layer in Layer]
        known = (stored[0] != 0) | (stored[1] != 0) | (stored[2] != 0)
        walls, free, points = (layer[known] for layer in stored)
        value = _values(name, walls, free, points, base_rate, free_fusion)
        level = np.rint((levels - 1) * value).astype(np.int16)
        rank = np.zeros(window.shape, dtype=dtype)
        rank[known] = level + 1 if LAYERS[name].by_largest else levels - level
        raster.raise_to(found, window, rank)
    return found


def _values(
    name: str,
    walls: Ints,
    free: Ints,
    points: Ints,
    base_rate: float,
    free_fusion: FreeFusion,
) -> CellArray:
    if name == "points":
        return necessity_of(points)
    cells = Readout.of(walls, free, free_fusion)
    if name == "contradicted":
        return cells.contradicted.astype(np.float64)
    return VIEWS[name](cells, base_rate)
