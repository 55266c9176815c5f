"""The layers that a picture can show, each shrunk so that what matters survives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, necessity_of
from possmap.core.lattice import Window
from possmap.core.patches import Crop, Patch, extent_of, spread
from possmap.core.settings import FreeFusion
from possmap.core.views import NOTHING, CellArray, Readout
from possmap.pictures.raster import Raster

Indices: TypeAlias = NDArray[np.uint8]
"""One palette index per block, shape (rows, columns), the first row the highest y."""

LEVELS = 255
"""Values become 0 … 254, so that 255 is left for what is unknown."""
UNKNOWN_INDEX = 255


class Cells(Protocol):
    """Where the numbers of a grid come from: a file, or a film's memory."""

    @property
    def free_fusion(self) -> FreeFusion:
        """What the numbers of the layer FREE mean."""

    def areas(self, window: Window) -> Iterator[Window]:
        """Yield windows, small enough for memory, that together hold all that is known."""

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window; what is not known is 0."""


@runtime_checkable
class Patchwork(Protocol):
    """Cells that can be had without what lies between them, which is most of a large map."""

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what is known of a window, a few tiles at a time."""


def patches(cells: Cells, window: Window) -> Iterator[Patch]:
    """Yield what is known of a window, in pieces small enough for memory."""
    if isinstance(cells, Patchwork):
        yield from cells.patches(window)
    else:
        for area in cells.areas(window):
            yield {layer: Crop(area, cells.read_window(layer, area)) for layer in Layer}


@dataclass(frozen=True, slots=True)
class PictureLayer:
    """A value to draw.

    title : for people.
    value : of known cells, given what they say and N of singular points, and the base rate.
    by_largest : whether a block of cells shows its largest value, or its smallest.
    low, high : what the ends of the scale mean.
    """

    title: str
    value: Callable[[Readout, CellArray, float], CellArray]
    by_largest: bool
    low: str
    high: str


LAYERS: Mapping[str, PictureLayer] = MappingProxyType(
    {
        "necessity": PictureLayer(
            "necessity of a wall (N)",
            lambda cells, points, base: cells.necessity,
            True,
            "no sign",
            "certain",
        ),
        "possibility": PictureLayer(
            "possibility of a wall",
            lambda cells, points, base: cells.possibility,
            False,
            "free",
            "possible",
        ),
        "ignorance": PictureLayer(
            "ignorance: m(anything)",
            lambda cells, points, base: cells.ignorance,
            False,
            "settled",
            "unknown",
        ),
        "conflict": PictureLayer(
            "conflict K", lambda cells, points, base: cells.conflict, True, "none", "total"
        ),
        "probability": PictureLayer(
            "probability of a wall",
            lambda cells, points, base: cells.probability(base),
            True,
            "free",
            "wall",
        ),
        "points": PictureLayer(
            "necessity of a singular point",
            lambda cells, points, base: points,
            True,
            "none",
            "certain",
        ),
    }
)
"""The layers whose scale is 0 to 1, by name."""


def drawn(layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float) -> Indices:
    """Return a layer's palette indices: 0 … 254 for values 0 … 1, 255 where nothing is known."""
    table = _level_of_rank(layer, LEVELS, UNKNOWN_INDEX)
    return by_bands(raster, lambda band: table[_ranks(layer, cells, band, base_rate, LEVELS)])


def drawn_gray(layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float) -> Indices:
    """Return a layer as round(255·v), without a tone for what is unknown: numbers to read back."""
    unknown = int(np.rint(255 * layer.value(NOTHING, np.zeros(1), base_rate))[0])
    table = _level_of_rank(layer, 256, unknown)
    return by_bands(raster, lambda band: table[_ranks(layer, cells, band, base_rate, 256)])


def by_bands(raster: Raster, draw: Callable[[Raster], Indices]) -> Indices:
    """Return a picture drawn in bands of rows, so that what is in work is small beside it.

    draw : returns the indices of a band, the first row the lowest y, which the picture turns round.
    """
    whole: Indices = np.empty(raster.blocks, dtype=np.uint8)
    upright = whole[::-1]
    for first, band in raster.bands():
        upright[first : first + band.blocks[0]] = draw(band)
    return whole


def _level_of_rank(layer: PictureLayer, levels: int, unknown: int) -> Indices:
    """Return the level that each rank stands for; the first rank is what is unknown."""
    level = np.arange(levels, dtype=np.uint8)
    table: Indices = np.concatenate(
        [np.array([unknown], dtype=np.uint8), level if layer.by_largest else level[::-1]]
    )
    return table


def _ranks(
    layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float, levels: int
) -> NDArray[np.unsignedinteger]:
    """Return what a block shows as a number that only grows the more it matters.

    0 is unknown; then come ``levels`` values, upwards or, where the smallest counts, downwards. So
    a block's rank is the largest of its cells', and what is unknown hides nothing.
    """
    dtype = np.uint8 if levels < 256 else np.uint16
    found: NDArray[np.unsignedinteger] = np.zeros(raster.blocks, dtype=dtype)
    for patch in patches(cells, raster.window):
        window = extent_of(patch)
        weights, denials, points = (spread(patch, layer, window) for layer in Layer)
        known = (weights != 0) | (denials != 0) | (points != 0)
        value = layer.value(
            Readout.of(weights[known], denials[known], cells.free_fusion),
            necessity_of(points[known]),
            base_rate,
        )
        level = np.rint((levels - 1) * value).astype(np.int16)
        rank = np.zeros(window.shape, dtype=dtype)
        rank[known] = level + 1 if layer.by_largest else levels - level
        blocks = raster.blocks_of(window)
        target = found[blocks.where]
        np.maximum(target, blocks.largest(rank), out=target)
    return found
