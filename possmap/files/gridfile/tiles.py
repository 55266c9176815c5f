"""Tiles in the grid file: sparse, compressed, each with its hash and its bounds."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers, blank
from possmap.core.lattice import TILE, TileKey, Window, joined, tile_window
from possmap.files.gridfile.database import Database

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
    name = struct.pack(
        "<BqqHHHHB",
        layer, *key, bounds.row0, bounds.row1, bounds.column0, bounds.column1, width,
    )  # fmt: skip
    digest = hashlib.sha256(name + cropped.tobytes()).digest()
    differences = np.diff(cropped, axis=1, prepend=cropped.dtype.type(0))
    planes = differences.view(np.uint8).reshape(-1, width).T.tobytes()
    return EncodedTile(bounds, digest, bytes([width]) + zlib.compress(planes, _COMPRESSION))


def decode(layer: Layer, bounds: Window, data: bytes) -> LayerArray:
    """Return the cells of ``bounds``, as numbers of the layer's own type.

    Raises
    ------
    ValueError
        If the bytes are not a tile's.
    """
    width = data[0] if data else 0
    if width not in (2, 4, 8):
        raise ValueError(f"a cell of {width} bytes")
    size = bounds.cells * width
    inflated = zlib.decompressobj()
    planes = inflated.decompress(data[1:], size + 1)
    if len(planes) != size:
        raise ValueError(f"{len(planes)} bytes of cells, expected {size}")
    dtype = np.dtype(f"u{width}")
    differences = np.zeros(bounds.cells, dtype=dtype)
    for place, plane in enumerate(np.frombuffer(planes, dtype=np.uint8).reshape(width, -1)):
        differences |= plane.astype(dtype) << dtype.type(8 * place)
    cells: NDArray[np.unsignedinteger] = np.cumsum(
        differences.reshape(bounds.shape), axis=1, dtype=dtype
    )
    if layer is Layer.FREE:
        return cells.astype(np.uint16, copy=False)
    return cells.astype(np.int64)


class TileStore:
    """The tiles of one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def read(self, key: TileKey) -> TileLayers:
        """Return the layers of one tile that are not pure ignorance, each of shape (TILE, TILE)."""
        layers: TileLayers = {}
        for layer, cells, bounds in self._stored(
            'row = ? AND "column" = ? AND layer IN (0, 1, 2)', key
        ):
            whole = layers[layer] = blank(layer)
            whole[bounds.slices_in(tile_window(key))] = cells
        return layers

    def write(self, key: TileKey, layers: TileLayers) -> None:
        """Replace layers of one tile."""
        for layer, array in layers.items():
            one = encode(layer, key, array)
            self._database.execute(
                'INSERT INTO tile (layer, row, "column", row0, row1, column0, column1, hash)'
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
                ' ON CONFLICT (layer, row, "column") DO UPDATE SET row0 = excluded.row0,'
                " row1 = excluded.row1, column0 = excluded.column0, column1 = excluded.column1,"
                " hash = excluded.hash",
                (
                    layer, *key, one.bounds.row0, one.bounds.row1,
                    one.bounds.column0, one.bounds.column1, one.digest,
                ),
            )  # fmt: skip
            self._database.execute(
                "INSERT OR REPLACE INTO cells (tile, data) SELECT id, ? FROM tile"
                ' WHERE layer = ? AND row = ? AND "column" = ?',
                (one.data, layer, *key),
            )

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window, shape (rows, columns); what no tile holds is 0."""
        dtype = blank(layer).dtype
        whole: LayerArray = np.zeros(window.shape, dtype=dtype)
        if window.cells:
            span = (
                layer, window.row0 // TILE, (window.row1 - 1) // TILE,
                window.column0 // TILE, (window.column1 - 1) // TILE,
            )  # fmt: skip
            where = 'layer = ? AND row BETWEEN ? AND ? AND "column" BETWEEN ? AND ?'
            for _, cells, bounds in self._stored(where, span):
                shared = bounds.intersection(window)
                if shared.cells:
                    whole[shared.slices_in(window)] = cells[shared.slices_in(bounds)]
        return whole

    def areas(self, window: Window) -> Iterator[Window]:
        """Yield the parts of a window whose tiles hold anything, a few tiles at a time."""
        for row in self.rows(window):
            columns = self._database.all(
                'SELECT DISTINCT "column" FROM tile'
                ' WHERE layer IN (0, 1, 2) AND row = ? AND "column" BETWEEN ? AND ? ORDER BY 1',
                (row, window.column0 // TILE, (window.column1 - 1) // TILE),
            )
            yield from joined((TileKey(row, column) for (column,) in columns), window)

    def bounds(self) -> Window | None:
        """Return the smallest window that holds all evidence, or None if there is none."""
        row = self._database.one(
            f"SELECT min(row * {TILE} + row0), max(row * {TILE} + row1),"
            f' min("column" * {TILE} + column0), max("column" * {TILE} + column1) FROM tile'
        )
        return None if row is None or row[0] is None else Window(*row)

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every stored layer of a tile, in canonical order."""
        # A row of tiles at a time: a large map has millions of them.
        rows = self._database.all("SELECT DISTINCT layer, row FROM tile ORDER BY layer, row")
        for of_row in rows:
            for (digest,) in self._database.all(
                'SELECT hash FROM tile WHERE layer = ? AND row = ? ORDER BY "column"', of_row
            ):
                if not isinstance(digest, bytes):
                    raise self._database.damaged(f"the hash of a tile in row {of_row[1]}")
                yield digest

    def rows(self, window: Window) -> list[int]:
        """Return the rows of tiles within a window that hold anything."""
        if not window.cells:
            return []
        span = (window.row0 // TILE, (window.row1 - 1) // TILE)
        found = self._database.all(
            "SELECT DISTINCT row FROM tile WHERE row BETWEEN ? AND ? ORDER BY row", span
        )
        return [row for (row,) in found]

    def hashes_of_row(self, row: int, window: Window) -> dict[int, tuple[tuple[int, bytes], ...]]:
        """Return layers and their hashes for each column of a row of tiles within a window."""
        found: dict[int, tuple[tuple[int, bytes], ...]] = {}
        for column, layer, digest in self._database.all(
            'SELECT "column", layer, hash FROM tile'
            ' WHERE layer IN (0, 1, 2) AND row = ? AND "column" BETWEEN ? AND ? ORDER BY layer',
            (row, window.column0 // TILE, (window.column1 - 1) // TILE),
        ):
            if not isinstance(digest, bytes):
                raise self._database.damaged(f"the hash of a tile in row {row}")
            found[column] = (*found.get(column, ()), (layer, digest))
        return found

    def count(self) -> int:
        """Return how many tiles hold anything."""
        row = self._database.one('SELECT count(*) FROM (SELECT DISTINCT row, "column" FROM tile)')
        return int(row[0]) if row else 0

    def _stored(
        self, where: str, values: tuple[int, ...]
    ) -> Iterator[tuple[Layer, LayerArray, Window]]:
        """Yield layer, cells and their window on the lattice of each stored layer of a tile."""
        for layer, row, column, row0, row1, column0, column1, data in self._database.all(
            'SELECT layer, row, "column", row0, row1, column0, column1, data'
            f" FROM tile LEFT JOIN cells ON cells.tile = tile.id WHERE {where}",
            values,
        ):
            try:
                if not (0 <= row0 < row1 <= TILE and 0 <= column0 < column1 <= TILE):
                    raise ValueError("bounds outside the tile")
                cells = decode(Layer(layer), Window(row0, row1, column0, column1), data)
            except (ValueError, TypeError, zlib.error) as error:
                raise self._database.damaged(f"tile {row}, {column}: {error}") from error
            bounds = Window(
                row * TILE + row0, row * TILE + row1,
                column * TILE + column0, column * TILE + column1,
            )  # fmt: skip
            yield Layer(layer), cells, bounds
