"""Tiles in the grid file: sparse, compressed, each with its hash and its bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers
from possmap.core.lattice import TILE, TileKey, Window, joined
from possmap.core.patches import Crop, Patch, cropped
from possmap.core.patches import joined as joined_patches
from possmap.core.settings import FreeFusion
from possmap.core.views import Readout
from possmap.errors import GridError, TileError
from possmap.grid.database import Database
from possmap.grid.directory import Directory
from possmap.grid.encoding import EncodedTile, decode, encode, unpacked

_AT_ONCE = 32
"""Tiles whose bytes are read together."""

MOST_COUNTED = 256
"""Tiles of which cells are counted unasked: it takes a millisecond or two each."""

_LAYERS = "0, 1, 2"


class Undecided(NamedTuple):
    """How many cells are known at all, and how many of these are contested above ½ (METHOD §4)."""

    known: int
    contested: int

    @property
    def share(self) -> float:
        """Of the known cells, how many are contested."""
        return self.contested / self.known if self.known else 0.0


class TileStore:
    """The tiles of one grid file.

    Attributes
    ----------
    directory
        Which tiles there are.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.directory = Directory(database)

    @property
    def free_fusion(self) -> FreeFusion:
        """What the numbers of the layer FREE mean (METHOD §3)."""
        row = self._database.one("SELECT value FROM setting WHERE name = 'free_fusion'")
        return "dempster" if row == ('"dempster"',) else "minimum"

    def read(self, key: TileKey) -> TileLayers:
        """Return the layers of one tile that are not pure ignorance, each of shape (TILE, TILE)."""
        stored = self.packed(key)
        try:
            return unpacked(key, stored)
        except TileError as error:
            raise self._database.damaged(str(error)) from error

    def patch(self, key: TileKey) -> Patch:
        """Return what one tile holds of each layer; empty if it is pure ignorance."""
        return {layer: crop for _, layer, crop in self._stored(_LAYERS, key.row, key.column)}

    def packed(self, key: TileKey) -> dict[Layer, EncodedTile]:
        """Return the layers of one tile as they are stored, for somebody else to unpack."""
        stored = self._database.all(
            "SELECT layer, row0, row1, column0, column1, hash, data"
            " FROM tile LEFT JOIN cells ON cells.tile = tile.id"
            f' WHERE layer IN ({_LAYERS}) AND row = ? AND "column" = ?',
            tuple(key),
        )
        if any(data is None for *_, data in stored):
            raise self._database.damaged(f"tile {key.row}, {key.column}: no cells")
        return {
            Layer(layer): EncodedTile(Window(*bounds), digest, data)
            for layer, *bounds, digest, data in stored
        }

    def damaged(self, what: str) -> GridError:
        """Return the error that says what in a packed tile is not as it was written."""
        return self._database.damaged(what)

    def write(self, key: TileKey, layers: TileLayers) -> None:
        """Replace layers of one tile."""
        self.put(key, {layer: encode(layer, key, array) for layer, array in layers.items()})

    def put(self, key: TileKey, layers: Mapping[Layer, EncodedTile]) -> None:
        """Replace layers of one tile by what ``encode`` made of them, here or elsewhere."""
        for layer, one in layers.items():
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

    def drop(self, key: TileKey, layers: Iterable[Layer]) -> None:
        """Make layers of one tile pure ignorance."""
        for layer in layers:
            place = (layer, *key)
            where = 'WHERE layer = ? AND row = ? AND "column" = ?'
            self._database.execute(
                f"DELETE FROM cells WHERE tile = (SELECT id FROM tile {where})", place
            )
            self._database.execute(f"DELETE FROM tile {where}", place)

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window, shape (rows, columns); what no tile holds is 0."""
        whole: LayerArray = np.zeros(window.shape, dtype=np.int64)
        for crop in self.crops(layer, window):
            whole[crop.window.slices_in(window)] = crop.cells
        return whole

    def crops(self, layer: Layer, window: Window) -> Iterator[Crop]:
        """Yield what tiles hold of one layer of a window, one by one."""
        for row in self.directory.rows(window, layer):
            for span in self._spans(row, window):
                for _, _, crop in self._stored(str(int(layer)), row, *span):
                    yield from cropped({layer: crop}, window).values()

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what the tiles of a window hold, neighbours with few cells together, row by row."""
        for row in self.directory.rows(window):
            yield from joined_patches(self.row(row, window))

    def row(self, row: int, window: Window) -> Iterator[tuple[int, Patch]]:
        """Yield the columns of a row's tiles of a window, and what each holds there."""
        for span in self._spans(row, window):
            stored = self._stored(_LAYERS, row, *span)
            for column, crops in groupby(stored, key=itemgetter(0)):
                patch = cropped({layer: crop for _, layer, crop in crops}, window)
                if patch:
                    yield column, patch

    def _spans(self, row: int, window: Window) -> Iterator[tuple[int, int]]:
        """Yield first and last column of a few of a row's tiles, then of the next few."""
        columns = self.directory.columns(row, window)
        for start in range(0, len(columns), _AT_ONCE):
            yield columns[start], columns[min(start + _AT_ONCE, len(columns)) - 1]

    def areas(self, window: Window) -> Iterator[Window]:
        """Yield the parts of a window whose tiles hold anything, a few tiles at a time."""
        for row in self.directory.rows(window):
            columns = self.directory.columns(row, window)
            yield from joined((TileKey(row, column) for column in columns), window)

    def undecided(self, keys: Iterable[TileKey]) -> Undecided:
        """Count the cells of some tiles that are contested."""
        free_fusion, known, contested = self.free_fusion, 0, 0
        for key in keys:
            patch = self.patch(key)
            layers = [patch[layer] for layer in (Layer.WALLS, Layer.FREE) if layer in patch]
            known += sum(int(np.count_nonzero(one.cells)) for one in layers)
            if len(layers) == 2:
                both = layers[0].window.intersection(layers[1].window)
                w, v = (one.cells[both.slices_in(one.window)] for one in layers)
                at = (w > 0) & (v > 0)  # elsewhere one side says nothing
                known -= int(np.count_nonzero(at))
                cells = Readout.of(w[at], v[at], free_fusion)
                contested += int(np.count_nonzero(cells.contested > 0.5))
        return Undecided(known, contested)

    def _stored(
        self, layers: str, row: int, first: int, last: int | None = None
    ) -> Iterator[tuple[int, Layer, Crop]]:
        """Yield column, layer and cells of what is stored of a row's tiles first … last."""
        for layer, column, *inner, data in self._database.all(
            'SELECT layer, "column", row0, row1, column0, column1, data'
            " FROM tile LEFT JOIN cells ON cells.tile = tile.id"
            f' WHERE layer IN ({layers}) AND row = ? AND "column" BETWEEN ? AND ?'
            ' ORDER BY "column"',
            (row, first, first if last is None else last),
        ):
            row0, row1, column0, column1 = inner
            try:
                cells = decode(Window(*inner), data)
            except ValueError as error:
                raise self._database.damaged(f"tile {row}, {column}: {error}") from error
            bounds = Window(
                row * TILE + row0, row * TILE + row1,
                column * TILE + column0, column * TILE + column1,
            )  # fmt: skip
            yield column, Layer(layer), Crop(bounds, cells)
