"""Fusion: evidence added to tiles, in integers, so that order cannot matter (METHOD §3).

S(x, y) = x + y - xy is addition of weights w = -ln(1 - N), Shafer's weight of evidence. Free space
is a maximum of denials 1 - Π (``free_fusion: minimum``), or a sum of weights too: those of the
strongest denial of each excursion (``dempster``). All are commutative and associative on integers.
"""

from __future__ import annotations

from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core import kernel
from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, Window, tile_window
from possmap.core.plan import TileWork
from possmap.core.pyramid import FULL, Floats, Values, Weights
from possmap.core.settings import EvidenceSettings, FreeFusion

UNIT = 2**18
"""Weight of evidence 1 as an integer."""

CERTAIN = 16 * UNIT
"""The weight of a value of 65535, which has no finite logarithm."""

LayerArray: TypeAlias = Weights
TileLayers: TypeAlias = dict[Layer, LayerArray]
"""The layers of one tile that are not pure ignorance, each of shape (TILE, TILE), 64 bits."""


@cache
def wall_table(certainty_power: float) -> Weights:
    """Return T: the weight of each 16-bit necessity of an excursion, shape (65536,)."""
    return _table((np.arange(FULL + 1) / FULL) ** certainty_power)


@cache
def denial_table(pass_weight: float) -> Weights:
    """Return T_f: the weight of each 16-bit denial of an excursion, shape (65536,)."""
    return _table(pass_weight * np.arange(FULL + 1) / FULL)


def _table(values: Floats) -> Weights:
    """Return round(-ln(1 - value)·2¹⁸), and 16·2¹⁸ of certainty (METHOD §3)."""
    with np.errstate(divide="ignore"):
        weights = -np.log(1 - values) * UNIT
    weights[values == 1] = CERTAIN
    table: Weights = np.rint(weights).astype(np.int64)
    table.flags.writeable = False
    return table


WEIGHT = wall_table(1.0)
"""The weights where nothing is discounted."""


def fuse_tile(work: TileWork, layers: TileLayers, settings: EvidenceSettings) -> TileLayers:
    """Return the layers of a tile that the work changes, as new arrays.

    Parameters
    ----------
    layers
        The tile's layers so far; left as they are. Of none, what comes back is a partial tile.
    """
    changed: TileLayers = {}
    window = tile_window(work.key)
    for layer in sorted(work.pieces):
        array = layers[layer].copy() if layer in layers else blank()
        stamp_layer(array, window, work, layer, settings)
        if array.any():
            changed[layer] = array
    return changed


def stamp_layer(
    array: LayerArray, window: Window, work: TileWork, layer: Layer, settings: EvidenceSettings
) -> None:
    """Add to an array of the cells of ``window`` what the work says of one layer there."""
    segments, pieces, resolution = work.segments, work.pieces[layer], settings.resolution
    if layer is Layer.FREE and settings.free_fusion == "minimum":
        denials = array.astype(np.uint16)
        kernel.raise_block(denials, window, segments, pieces, resolution, work.clips)
        array[:] = denials
        return
    if layer is Layer.FREE:
        table = denial_table(settings.pass_weight)
    else:
        table = wall_table(settings.certainty_power)
    kernel.reinforce(array, window, segments, pieces, resolution, table, work.clips)


def merged(one: TileLayers, other: TileLayers, free_fusion: FreeFusion) -> TileLayers:
    """Return what two partial tiles say together: weights add up, a larger denial counts."""
    found = dict(one)
    for layer, array in other.items():
        if layer not in found:
            found[layer] = array
        elif layer is Layer.FREE and free_fusion == "minimum":
            found[layer] = np.maximum(found[layer], array)
        else:
            found[layer] = found[layer] + array
    return found


def blank(_: Layer | None = None) -> LayerArray:
    """Return a layer of a tile of pure ignorance: nothing denied, no weight."""
    return np.zeros((TILE, TILE), dtype=np.int64)


def necessity_of(weights: Weights) -> NDArray[np.float64]:
    """Return N = 1 - exp(-w / 2¹⁸) of integer weights (METHOD §3)."""
    # Most cells of a map hold no wall, and the exponential is what takes the time.
    necessity = np.zeros(weights.shape)
    some = weights != 0
    if some.any():
        necessity[some] = -np.expm1(weights[some] / -UNIT)
    return necessity


def possibility_of(
    denials: LayerArray | Values, free_fusion: FreeFusion = "minimum"
) -> NDArray[np.float64]:
    """Return Π of the integers of the layer FREE: 1 - q/65535, or e^(-v / 2¹⁸) (METHOD §3)."""
    if free_fusion == "dempster":
        return np.exp(denials / -UNIT)
    possibility: NDArray[np.float64] = 1 - denials / FULL
    return possibility


def denial_weights(denials: LayerArray, free_fusion: FreeFusion) -> NDArray[np.float64]:
    """Return v = -ln Π of the integers of the layer FREE, 16 where q = 65535 (METHOD §4)."""
    if free_fusion == "dempster":
        return denials / UNIT
    weights = -np.log1p(np.minimum(denials, FULL - 1) / -FULL)
    weights[denials == FULL] = CERTAIN / UNIT
    return weights
