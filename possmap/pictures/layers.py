"""The layers that a picture can show: each a value in every cell, and a rule for shrinking it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core import views
from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, Weights, necessity_of, possibility_of
from possmap.core.lattice import Window
from possmap.core.pyramid import Values
from possmap.core.views import CellArray
from possmap.pictures.raster import Raster, Reduction, reduced

Indices: TypeAlias = NDArray[np.uint8]
"""One palette index per block, shape (rows, columns), the first row the highest y."""

LEVELS = 255
"""Values become 0 … 254, so that 255 is left for what is unknown."""
UNKNOWN_INDEX = 255


class Cells(Protocol):
    """Where the numbers of a grid come from: a file, or a film's memory."""

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window; what is not known is 0."""


class Part:
    """The numbers of some cells, each read once, when first asked for; shape (rows, columns)."""

    def __init__(self, cells: Cells, window: Window) -> None:
        self.window = window
        self._cells = cells

    @cached_property
    def weights(self) -> Weights:
        """Weights of walls."""
        return self._cells.read_window(Layer.WALLS, self.window).astype(np.int64, copy=False)

    @cached_property
    def denials(self) -> Values:
        """Denials of walls."""
        return self._cells.read_window(Layer.FREE, self.window).astype(np.uint16, copy=False)

    @cached_property
    def point_weights(self) -> Weights:
        """Weights of singular points."""
        return self._cells.read_window(Layer.POINTS, self.window).astype(np.int64, copy=False)

    @cached_property
    def necessity(self) -> CellArray:
        """N."""
        return necessity_of(self.weights)

    @cached_property
    def possibility(self) -> CellArray:
        """Π."""
        return possibility_of(self.denials)

    @cached_property
    def points(self) -> CellArray:
        """The necessity of a singular point."""
        return necessity_of(self.point_weights)

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """The cells of which anything is known."""
        found: NDArray[np.bool_] = (
            (self.weights != 0) | (self.denials != 0) | (self.point_weights != 0)
        )
        return found


@dataclass(frozen=True, slots=True)
class PictureLayer:
    """A value to draw.

    title : for people.
    value : of the cells of a part, given the base rate.
    by : how a block of cells becomes one value, so that what matters survives.
    low, high : what the ends of the scale mean.
    """

    title: str
    value: Callable[[Part, float], CellArray]
    by: Reduction
    low: str
    high: str


LAYERS: Mapping[str, PictureLayer] = MappingProxyType(
    {
        "necessity": PictureLayer(
            "necessity N of a wall", lambda part, _: part.necessity, "max", "no sign", "certain"
        ),
        "possibility": PictureLayer(
            "possibility of a wall", lambda part, _: part.possibility, "min", "free", "possible"
        ),
        "ignorance": PictureLayer(
            "ignorance: possibility - N",
            lambda part, _: views.ignorance(part.necessity, part.possibility),
            "min",
            "settled",
            "unknown",
        ),
        "conflict": PictureLayer(
            "conflict K",
            lambda part, _: views.conflict(part.necessity, part.possibility),
            "max",
            "none",
            "total",
        ),
        "probability": PictureLayer(
            "probability of a wall",
            lambda part, base: views.probability(part.necessity, part.possibility, base),
            "max",
            "free",
            "wall",
        ),
        "points": PictureLayer(
            "necessity of a singular point", lambda part, _: part.points, "max", "none", "certain"
        ),
    }
)
"""The layers whose scale is 0 to 1, by name."""


def drawn(layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float) -> Indices:
    """Return a layer's palette indices: 0 … 254 for values 0 … 1, 255 where nothing is known."""
    found = np.full(raster.blocks, UNKNOWN_INDEX, dtype=np.uint8)
    for value, known, where in _parts(layer, cells, raster, base_rate):
        index = np.rint((LEVELS - 1) * value).astype(np.uint8)
        found[where] = np.where(known, index, UNKNOWN_INDEX)
    return found[::-1]


def drawn_gray(layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float) -> Indices:
    """Return a layer as round(255·v), without a tone for what is unknown: numbers to read back."""
    found = np.zeros(raster.blocks, dtype=np.uint8)
    for part, where in raster.parts():
        value = layer.value(Part(cells, part), base_rate)
        found[where] = np.rint(255 * reduced(value, raster.shrink, layer.by).astype(np.float64))
    return found[::-1]


def _parts(
    layer: PictureLayer, cells: Cells, raster: Raster, base_rate: float
) -> Iterator[tuple[CellArray, NDArray[np.bool_], tuple[slice, slice]]]:
    """Yield value, known and place of each part that holds anything."""
    for window, where in raster.parts():
        part = Part(cells, window)
        known = part.known
        if not known.any():
            continue
        value = layer.value(part, base_rate)
        if raster.shrink > 1:
            # What is unknown must not hide what is known beside it.
            value = np.where(known, value, -np.inf if layer.by == "max" else np.inf)
        blocks = reduced(value, raster.shrink, layer.by).astype(np.float64)
        is_known = reduced(known, raster.shrink, "max").astype(np.bool_)
        yield np.where(is_known, blocks, 0.0), is_known, where
