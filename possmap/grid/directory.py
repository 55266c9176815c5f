"""Which tiles a grid file holds: found by the table's index, without looking at every tile.

The index is ordered by layer, row and column. From one row SQLite steps to the next by one search,
so that what is asked of rows costs as much as there are rows, and not as much as there are tiles.
"""

from __future__ import annotations

from collections.abc import Iterator

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, Window
from possmap.grid.checks import tile_place, whole
from possmap.grid.database import Database

_ROWS = """
    WITH RECURSIVE held (row) AS (
        SELECT min(row) FROM tile WHERE layer = ?1 AND row >= ?2 AND row <= ?3
        UNION ALL
        SELECT (SELECT min(row) FROM tile WHERE layer = ?1 AND row > held.row AND row <= ?3)
        FROM held WHERE held.row IS NOT NULL
    )
    SELECT row FROM held WHERE row IS NOT NULL
"""
_ANY = (float("-inf"), b"\xff" * 8)
"""From and to which a row lies, also one that is no number: SQLite has texts and bytes behind
numbers, and what is damaged must be found, not left out."""
_LAYERS = tuple(int(layer) for layer in Layer)
_ENDS = {
    "first": ("min", f'"column" * {TILE} + column0'),
    "last": ("max", f'"column" * {TILE} + column1'),
}


class Directory:
    """The tiles of one grid file, by their places."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def rows(self, window: Window | None = None) -> list[int]:
        """Return the rows of tiles that hold anything, of a window or of all; sorted."""
        if window is None:
            return self._rows(_LAYERS, _ANY)
        if not window.cells:
            return []
        return self._rows(_LAYERS, (window.row0 // TILE, (window.row1 - 1) // TILE))

    def rows_of(self, layer: Layer, window: Window) -> list[int]:
        """Return the rows of tiles of a window that hold anything of one layer; sorted."""
        if not window.cells:
            return []
        return self._rows((int(layer),), (window.row0 // TILE, (window.row1 - 1) // TILE))

    def _rows(self, layers: tuple[int, ...], span: tuple[object, object]) -> list[int]:
        found = {row for layer in layers for (row,) in self._database.all(_ROWS, (layer, *span))}
        with self._database.sound("the place of a tile"):
            return sorted(map(tile_place, found))

    def columns(self, row: int, window: Window) -> list[int]:
        """Return the columns of a row's tiles of a window that hold anything; sorted."""
        found = self._database.all(
            'SELECT DISTINCT "column" FROM tile'
            ' WHERE layer IN (0, 1, 2) AND row = ? AND "column" BETWEEN ? AND ? ORDER BY 1',
            (row, window.column0 // TILE, (window.column1 - 1) // TILE),
        )
        with self._database.sound(f"the place of a tile in row {row}"):
            return [tile_place(column) for (column,) in found]

    def count(self) -> int:
        """Return how many tiles hold anything."""
        return sum(self._count(row) for row in self.rows())

    def _count(self, row: int) -> int:
        found = self._database.one(
            'SELECT count(DISTINCT "column") FROM tile WHERE layer IN (0, 1, 2) AND row = ?', (row,)
        )
        return int(found[0]) if found else 0

    def bounds(self) -> Window | None:
        """Return the smallest window that holds all evidence, or None if there is none."""
        rows = self.rows()
        if not rows:
            return None
        ends = [self._of_row(row) for row in (rows[0], rows[-1])]
        first, last = (self._column_end(rows, which) for which in ("first", "last"))
        found = Window(ends[0][0], ends[1][1], first, last)
        if not found.cells:
            raise self._database.damaged("the bounds of a tile: nothing between them")
        return found

    def _of_row(self, row: int) -> tuple[int, int]:
        """Return the first row of cells of a row of tiles, and the one behind the last."""
        found = self._database.one(
            f"SELECT min(row * {TILE} + row0), max(row * {TILE} + row1) FROM tile"
            " WHERE layer IN (0, 1, 2) AND row = ?",
            (row,),
        )
        first, last = found or (0, 0)
        return self._cell(row, first), self._cell(row, last)

    def _cell(self, tile: int, cell: object) -> int:
        """Return a row or a column of cells that is a tile's first, or the one behind its last."""
        with self._database.sound("the bounds of a tile"):
            if not tile * TILE <= whole(cell) <= (tile + 1) * TILE:
                raise ValueError("bounds outside the tile")
            return whole(cell)

    def _column_end(self, rows: list[int], which: str) -> int:
        """Return the first column of cells that holds anything, or the one behind the last."""
        choose, cell = _ENDS[which]
        best = min if choose == "min" else max
        at = {
            (layer, row): column
            for row in rows
            for layer in _LAYERS
            for (column,) in self._database.all(
                f'SELECT {choose}("column") FROM tile WHERE layer = ? AND row = ?', (layer, row)
            )
            if column is not None
        }
        with self._database.sound("the place of a tile"):
            tiles = best(map(tile_place, at.values()))
        cells = (
            self._cell(tiles, cell_of)
            for place, column in at.items()
            if column == tiles
            for (cell_of,) in self._database.all(
                f'SELECT {cell} FROM tile WHERE layer = ? AND row = ? AND "column" = ?',
                (*place, column),
            )
        )
        return best(cells)

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every stored layer of a tile, in canonical order."""
        # A row of tiles at a time: a large map has millions of them.
        for layer in _LAYERS:
            for row in self._rows((layer,), _ANY):
                for (digest,) in self._database.all(
                    'SELECT hash FROM tile WHERE layer = ? AND row = ? ORDER BY "column"',
                    (layer, row),
                ):
                    if not isinstance(digest, bytes):
                        raise self._database.damaged(f"the hash of a tile in row {row}")
                    yield digest

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
            if type(column) is not int:
                raise self._database.damaged(f"the place of a tile in row {row}")
            found[column] = (*found.get(column, ()), (layer, digest))
        return found
