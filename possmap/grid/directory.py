"""Which tiles a grid file holds, without a look at their cells."""

from __future__ import annotations

from collections.abc import Iterator

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, TileKey, Window
from possmap.grid.database import Database


class Directory:
    """The tiles of one grid file, by their places."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def rows(self, window: Window | None = None, layer: Layer | None = None) -> list[int]:
        """Return the rows of tiles that hold anything, of a window or of all; sorted.

        layer : only those that hold something of it.
        """
        if window is None:
            return [
                row for (row,) in self._database.all("SELECT DISTINCT row FROM tile ORDER BY 1")
            ]
        if not window.cells:
            return []
        layers = tuple(Layer) if layer is None else (layer,)
        span = window.row0 // TILE, (window.row1 - 1) // TILE
        # By layer, for so the index is ordered.
        sql = "SELECT DISTINCT row FROM tile WHERE layer = ? AND row BETWEEN ? AND ?"
        return sorted(
            {row for one in layers for (row,) in self._database.all(sql, (int(one), *span))}
        )

    def columns(self, row: int, window: Window) -> list[int]:
        """Return the columns of a row's tiles of a window that hold anything; sorted."""
        found = self._database.all(
            'SELECT DISTINCT "column" FROM tile'
            ' WHERE layer IN (0, 1, 2) AND row = ? AND "column" BETWEEN ? AND ? ORDER BY 1',
            (row, window.column0 // TILE, (window.column1 - 1) // TILE),
        )
        return [column for (column,) in found]

    def keys(self) -> Iterator[TileKey]:
        """Yield the tiles that hold anything, or are said to be touched by a record; sorted."""
        for row, column in self._database.all(
            'SELECT row, "column" FROM tile UNION SELECT tile_row, tile_column FROM touched'
            " ORDER BY 1, 2"
        ):
            yield TileKey(row, column)

    def count(self) -> int:
        """Return how many tiles hold anything."""
        sql = 'SELECT count(*) FROM (SELECT DISTINCT row, "column" FROM tile)'
        return int((self._database.one(sql) or (0,))[0])

    def bounds(self) -> Window | None:
        """Return the smallest window that holds all evidence, or None if there is none."""
        found = self._database.one(
            f"SELECT min(row * {TILE} + row0), max(row * {TILE} + row1),"
            f' min("column" * {TILE} + column0), max("column" * {TILE} + column1) FROM tile'
        )
        return None if found is None or found[0] is None else Window(*found)

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every stored layer of a tile, in canonical order."""
        for (digest,) in self._database.all('SELECT hash FROM tile ORDER BY layer, row, "column"'):
            yield digest

    def hashes_of(self, key: TileKey) -> dict[int, bytes]:
        """Return the stored hash of each layer of a tile."""
        sql = 'SELECT layer, hash FROM tile WHERE layer IN (0, 1, 2) AND row = ? AND "column" = ?'
        return dict(self._database.all(sql, key))

    def hashes_of_row(self, row: int, window: Window) -> dict[int, tuple[tuple[int, bytes], ...]]:
        """Return layers and their hashes for each column of a row of tiles within a window."""
        found: dict[int, tuple[tuple[int, bytes], ...]] = {}
        for column, layer, digest in self._database.all(
            'SELECT "column", layer, hash FROM tile'
            ' WHERE layer IN (0, 1, 2) AND row = ? AND "column" BETWEEN ? AND ? ORDER BY layer',
            (row, window.column0 // TILE, (window.column1 - 1) // TILE),
        ):
            found[column] = (*found.get(column, ()), (layer, digest))
        return found
