"""A layer of a tile as bytes: cropped, compressed, with a hash that needs no cell to be read."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers, blank
from possmap.core.lattice import TileKey, Window
from possmap.errors import TileError

_COMPRESSION = 3
"""zlib's level: beyond it files shrink by a few per cent, and writing takes twice as long."""


class EncodedTile(NamedTuple):
    """A layer of a tile as it is stored.

    bounds : the rows and columns of the tile that hold all that is not 0.
    """

    bounds: Window
    digest: bytes
    data: bytes


def encode(layer: Layer, key: TileKey, array: LayerArray) -> EncodedTile:
    """Return the stored form of an array of shape (TILE, TILE) that is not all 0.

    Cells are cropped to their bounds and stored as the narrowest of 2, 4 or 8 bytes. The digest is
    over these plain bytes; before compression each row is turned into differences and each byte of
    the numbers into a plane of its own, which pyramids, being piecewise linear, reward.
    """
    rows, columns = np.flatnonzero(array.any(axis=1)), np.flatnonzero(array.any(axis=0))
    bounds = Window(int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1)
    largest = int(array.max())
    width = 2 if largest < 2**16 else 4 if largest < 2**32 else 8
    cropped = np.ascontiguousarray(
        array[bounds.row0 : bounds.row1, bounds.column0 : bounds.column1], dtype=f"<u{width}"
    )
    digest = digest_of(layer, key, bounds, cropped)
    differences = np.diff(cropped, axis=1, prepend=cropped.dtype.type(0))
    planes = differences.view(np.uint8).reshape(-1, width).T.tobytes()
    return EncodedTile(bounds, digest, bytes([width]) + zlib.compress(planes, _COMPRESSION))


def digest_of(
    layer: Layer, key: TileKey, bounds: Window, cells: NDArray[np.unsignedinteger]
) -> bytes:
    """Return the hash of a layer of a tile: of its place, its bounds and their cells.

    cells : of ``bounds``, little-endian, in the narrowest type that is stored.
    """
    name = struct.pack(
        "<BqqHHHHB",
        layer, *key, bounds.row0, bounds.row1, bounds.column0, bounds.column1,
        cells.dtype.itemsize,
    )  # fmt: skip
    return hashlib.sha256(name + cells.tobytes()).digest()


def decode(bounds: Window, data: bytes) -> LayerArray:
    """Return the cells of ``bounds``, as signed 64-bit integers.

    Raises
    ------
    ValueError
        If the bytes are not a tile's.
    """
    width = data[0] if data else 0  # no bytes at all, too, if their row is gone
    if width not in (2, 4, 8):
        raise ValueError(f"a cell of {width} bytes")
    size = bounds.cells * width
    inflated = zlib.decompressobj()
    try:
        planes = inflated.decompress(data[1:], size + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if len(planes) != size or not inflated.eof or inflated.unused_data:
        raise ValueError(f"its cells are not {size} bytes, compressed")
    dtype = np.dtype(f"u{width}")
    lowest, *higher = np.frombuffer(planes, dtype=np.uint8).reshape(width, -1)
    differences = lowest.astype(dtype)
    for place, plane in enumerate(higher, 1):
        differences |= plane.astype(dtype) << dtype.type(8 * place)
    cells: NDArray[np.unsignedinteger] = np.add.accumulate(
        differences.reshape(bounds.shape), axis=1, dtype=dtype
    )
    return cells.astype(np.int64)


def unpacked(key: TileKey, stored: Mapping[Layer, EncodedTile]) -> TileLayers:
    """Return the layers of a stored tile, each of shape (TILE, TILE).

    Raises
    ------
    TileError
        If it is damaged.
    """
    found: TileLayers = {}
    for layer, (bounds, _, data) in stored.items():
        whole = found[layer] = blank()
        try:
            cells = decode(bounds, data)
        except ValueError as error:
            raise TileError(f"tile {key.row}, {key.column}: {error}") from error
        whole[bounds.row0 : bounds.row1, bounds.column0 : bounds.column1] = cells
    return found
