"""What in a grid file is not as possmap writes it: structure, hashes, ledger (docs/trust.md)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.plan import Touched
from possmap.errors import GridError, printable
from possmap.files.gridfile.database import Database
from possmap.files.gridfile.directory import Directory
from possmap.files.gridfile.encoding import decode, encode
from possmap.files.gridfile.ledger import Entry, Ledger
from possmap.files.gridfile.rows import excursion_hash

LAYER_WORDS = {Layer.WALLS: "walls", Layer.FREE: "free space", Layer.POINTS: "points"}

MOST_FROM_SQLITE = 20
"""Faults that SQLite is asked for; more of them say nothing new."""


class Soundness:
    """Looks at one grid file, and yields each fault as one line."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._directory, self._ledger = Directory(database), Ledger(database)

    def structure(self) -> Iterator[str]:
        """Yield what SQLite finds wrong with the file as a database.

        What tables it has is looked at whenever it is opened.
        """
        for (line,) in self._database.all(f"PRAGMA integrity_check({MOST_FROM_SQLITE})"):
            if line != "ok":
                yield f"SQLite: {printable(str(line))[:200]}"
        strays = self._database.all("PRAGMA foreign_key_check")
        for table, row, other, _ in strays[:MOST_FROM_SQLITE]:
            yield f"row {row} of table {table} belongs to a row of {other} that is not there"

    def tiles(self) -> Iterator[str]:
        """Yield each tile whose cells are not what was written, one row after the other."""
        for row in self._directory.rows():
            for layer, column, *bounds, digest, data in self._database.all(
                'SELECT layer, "column", row0, row1, column0, column1, hash, CAST(data AS BLOB)'
                " FROM tile LEFT JOIN cells ON cells.tile = tile.id WHERE row = ?"
                ' ORDER BY layer, "column"',
                (row,),
            ):
                fault = _tile_fault(layer, TileKey(row, column), bounds, digest, data)
                if fault:
                    yield f"tile {row}, {column}, {LAYER_WORDS.get(layer, layer)}: {fault}"

    def excursion(self, identity: int) -> Iterator[str]:
        """Yield what is wrong with one excursion of the ledger."""
        where = f"excursion number {identity}"
        try:
            entry = self._ledger.entry_of(identity)
            if entry is None:
                yield f"{where}: is not there"
                return
            where = title(entry)
            yield from (f"{where}: {fault}" for fault in self._excursion(entry))
        except GridError as error:
            yield f"{where}: {self._database.bare(error)}"

    def _excursion(self, entry: Entry) -> Iterator[str]:
        version = self._ledger.version(entry)
        stored = self._database.one("SELECT hash FROM excursion WHERE id = ?", (entry.identity,))
        if stored != (excursion_hash(version, entry.model),):
            yield "its hash is not that of its records"
        seqs = [record.seq for record in version.records]
        if seqs != sorted(set(seqs)):
            yield "its records are out of order"
        expected = 0
        for arrival in self._ledger.arrivals(entry.name):
            if arrival.part.first != expected:
                break
            expected += arrival.part.count
        if expected != entry.records:
            yield f"nothing says what brought record {expected}"
        forgotten = self._ledger.forgotten.all()
        for event in self._ledger.came.events(entry.name):
            if event.what.end > entry.records:
                yield f"{printable(event.what.origin.name)} is said to have held more records"
            for one in forgotten:
                if one.bars(entry.name, event.what.origin.sha256):
                    yield f"{one.title} was forgotten, and is here"

    def keys(self) -> list[TileKey]:
        """Return the tiles that hold anything, or that a record touches, sorted."""
        sql = 'SELECT row, "column" FROM tile UNION SELECT tile_row, tile_column FROM touched'
        return sorted(TileKey(*key) for key in self._database.all(sql))

    def digests(self, key: TileKey) -> dict[int, object]:
        """Return the stored hash of each layer of a tile."""
        sql = 'SELECT layer, hash FROM tile WHERE layer IN (0, 1, 2) AND row = ? AND "column" = ?'
        return dict(self._database.all(sql, key))

    def touched(self, entry: Entry) -> Touched:
        """Return which tiles the ledger says that an excursion's records touch, sorted."""
        sql = (
            "SELECT tile_row, tile_column, number FROM touched WHERE excursion = ?"
            " ORDER BY tile_row, tile_column, number"
        )
        return self._database.all(sql, (entry.identity,))


def title(entry: Entry) -> str:
    """Return an excursion's name, as a line begins."""
    return f"excursion {printable(entry.excursion)} of robot {printable(entry.robot)}"


def _tile_fault(
    layer: int, key: TileKey, bounds: list[int], digest: object, data: object
) -> str | None:
    try:
        row0, row1, column0, column1 = bounds
        if not (0 <= row0 < row1 <= TILE and 0 <= column0 < column1 <= TILE):
            raise ValueError("bounds outside the tile")
        if not isinstance(data, bytes):
            raise ValueError("no cells")
        window = Window(row0, row1, column0, column1)
        cells = decode(Layer(layer), window, data)
        whole = np.zeros((TILE, TILE), dtype=cells.dtype)
        whole[row0:row1, column0:column1] = cells
        if not cells.any() or encode(Layer(layer), key, whole)[:2] != (window, digest):
            return "its hash is not that of its cells"
    except (ValueError, TypeError, zlib.error) as error:
        return printable(str(error))
    return None
