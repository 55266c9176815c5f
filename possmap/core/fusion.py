"""Fusion: evidence added to tiles, in integers, so that order cannot matter (METHOD §3).

S(x, y) = x + y - xy is addition of weights w = -ln(1 - N), Shafer's weight of evidence; free space
is a maximum of denials 1 - Π. Both are commutative and associative on integers.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core import kernel
from possmap.core.clip import spared
from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, Window, tile_window
from possmap.core.plan import TileWork
from possmap.core.pyramid import FULL, Ints, Values, Weights
from possmap.core.segment_table import COLUMNS, segment_of
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import Piece, extent

UNIT = 2**18
"""Weight of evidence 1 as an integer."""

CERTAIN = 16 * UNIT
"""The weight of a value of 65535, which has no finite logarithm."""

LayerArray: TypeAlias = Weights | Values
TileLayers: TypeAlias = dict[Layer, LayerArray]
"""The layers of one tile that are not pure ignorance, each of shape (TILE, TILE)."""


_MAX_ERROR = COLUMNS.index("max_error")


def _weight_table() -> Weights:
    with np.errstate(divide="ignore"):
        weights = -np.log(1 - np.arange(FULL + 1) / FULL) * UNIT
    weights[FULL] = CERTAIN
    table: Weights = np.rint(weights).astype(np.int64)
    table.flags.writeable = False
    return table


WEIGHT = _weight_table()
"""Weight of each 16-bit value: round(-ln(1 - q/65535)·2¹⁸), and 16·2¹⁸ at 65535 (METHOD §3)."""


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
        array = layers[layer].copy() if layer in layers else blank(layer)
        stamp_layer(array, window, work, layer, settings.resolution)
        if array.any():
            changed[layer] = array
    return changed


def stamp_layer(
    array: LayerArray, window: Window, work: TileWork, layer: Layer, resolution: float
) -> None:
    """Add to an array of the cells of ``window`` what the work says of one layer there."""
    pieces = work.pieces[layer]
    if layer is Layer.FREE:
        _deny(array.astype(np.uint16, copy=False), window, work, pieces, resolution)
    else:
        weights = array.astype(np.int64, copy=False)
        kernel.reinforce(weights, window, work.segments, pieces, resolution, WEIGHT)


def merged(one: TileLayers, other: TileLayers) -> TileLayers:
    """Return what two partial tiles say together: weights add up, of denials the larger counts."""
    found = dict(one)
    for layer, array in other.items():
        if layer not in found:
            found[layer] = array
        elif layer is Layer.FREE:
            found[layer] = np.maximum(found[layer], array)
        else:
            found[layer] = found[layer] + array
    return found


def blank(layer: Layer) -> LayerArray:
    """Return a tile of pure ignorance: nothing denied, no weight."""
    if layer is Layer.FREE:
        return np.zeros((TILE, TILE), dtype=np.uint16)
    return np.zeros((TILE, TILE), dtype=np.int64)


def _deny(array: Values, window: Window, work: TileWork, pieces: Ints, resolution: float) -> None:
    """Raise a tile's denials to those of free paths, which end at the lines that clip them."""
    apart = work.apart(pieces)
    kernel.raise_block(
        array, window, work.segments, np.ascontiguousarray(pieces[~apart]), resolution
    )
    for number, first, last, *_, clip in pieces[apart].tolist():
        row = work.segments[number]
        piece = Piece(segment_of(row), first, last)
        region = extent(piece, resolution).intersection(window)
        values = np.zeros(region.shape, dtype=np.uint16)
        kernel.stamp(values, region, piece, resolution, float(row[_MAX_ERROR]))
        if clip >= 0:
            values[spared(region, work.clips[clip], resolution)] = 0
        target = array[region.slices_in(window)]
        np.maximum(target, values, out=target)


def necessity_of(weights: Weights) -> NDArray[np.float64]:
    """Return N = 1 - exp(-w / 2¹⁸) of integer weights (METHOD §3)."""
    # Most cells of a map hold no wall, and the exponential is what takes the time.
    necessity = np.zeros(weights.shape)
    some = weights != 0
    if some.any():
        necessity[some] = -np.expm1(weights[some] / -UNIT)
    return necessity


def possibility_of(denials: Values) -> NDArray[np.float64]:
    """Return Π = 1 - q/65535 of 16-bit denials (METHOD §3)."""
    possibility: NDArray[np.float64] = 1 - denials / FULL
    return possibility
