"""What in a grid file is not as possmap writes it: structure, hashes, ledger (docs/trust.md)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import groupby
from operator import itemgetter

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, TileKey
from possmap.core.plan import Touched
from possmap.errors import GridError, brief, printable
from possmap.grid.arrivals import Part
from possmap.grid.bounds import CELLS, LARGEST
from possmap.grid.checks import bounds_in_tile, tile_key, tile_place
from possmap.grid.claims import Claims, origin_faults
from possmap.grid.database import Database
from possmap.grid.deliveries import Deliveries
from possmap.grid.directory import Directory
from possmap.grid.encoding import decode, encode
from possmap.grid.forgotten import Bans
from possmap.grid.ledger import Entry, Ledger
from possmap.grid.rows import excursion_hash
from possmap.logs.delivery import path_text
from possmap.logs.fields import Fault
from possmap.logs.rechecking import rechecked

LAYER_WORDS = {Layer.WALLS: "walls", Layer.FREE: "free space", Layer.POINTS: "points"}

MOST_FROM_SQLITE = 20
"""Faults that SQLite is asked for; more of them say nothing new."""

_ANY_NESTING = 10_000
"""The limit on it belongs to the call that read the log, and may have been any."""


class Soundness:
    """Looks at one state of a grid file, and yields each fault as one line.

    Some of it is read once for all excursions: ask for another one when the file has changed.

    Attributes
    ----------
    claims
        What looks at all that no hash covers.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._directory, self._ledger = Directory(database), Ledger(database)
        self._deliveries = Deliveries(database, self._ledger.came)
        self.claims = Claims(database)

    def structure(self) -> Iterator[str]:
        """Yield what SQLite finds wrong with the file as a database.

        What tables it has is looked at whenever it is opened. After a fault nothing should be read
        on: a table whose pages are counted twice may seem to have any number of rows.
        """
        for (line,) in self._database.all(
            f"PRAGMA integrity_check({MOST_FROM_SQLITE})", longest=LARGEST
        ):
            if line != "ok":
                yield f"SQLite: {printable(str(line))[:200]}"

    def orphans(self) -> Iterator[str]:
        """Yield rows that belong to others that are not there."""
        strays = self._database.all("PRAGMA foreign_key_check")
        for table, row, other, _ in strays[:MOST_FROM_SQLITE]:
            yield f"row {row} of table {table} belongs to a row of {other} that is not there"

    def tiles(self) -> Iterator[str]:
        """Yield each tile whose cells are not what was written, one row after the other."""
        for row in self._directory.rows():
            for layer, column, *bounds, digest, data in self._database.all(
                'SELECT layer, "column", row0, row1, column0, column1, hash, CAST(data AS BLOB)'
                " FROM tile LEFT JOIN cells ON cells.tile = tile.id"
                " WHERE layer IN (0, 1, 2) AND row = ?"  # others are strays, and would need a scan
                ' ORDER BY layer, "column"',
                (row,),
                CELLS,
            ):
                with self._database.sound(f"the place of a tile in row {row}"):
                    key = tile_key(row, column)
                fault = _tile_fault(layer, key, bounds, digest, data)
                if fault:
                    words = LAYER_WORDS.get(layer, f"layer {layer!r:.20}")
                    yield f"tile {row}, {column}, {words}: {fault}"

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
        try:
            rechecked(version, _ANY_NESTING)
        except Fault as fault:
            yield ": ".join(filter(None, (path_text(fault.path), fault.problem)))
        yield from self._arrivals(entry)

    def _arrivals(self, entry: Entry) -> Iterator[str]:
        """Yield what is wrong with what is said to have brought an excursion."""
        events = list(self._deliveries.events(entry))
        expected = 0
        for part in (event.what for event in events if isinstance(event.what, Part)):
            if part.first != expected:
                break
            expected += part.count
        else:
            if expected == entry.records:
                expected = -1
        if expected >= 0:
            yield (
                f"nothing says what brought record {expected}"
                if expected < entry.records
                else "more is said to have come than its records"
            )
        for event in events:
            if event.what.end > entry.records:
                yield f"{brief(event.what.origin.name)} is said to have held more records"
            yield from origin_faults(event)
            ban = self._bans.on(entry.name, event.what.origin.sha256)
            if ban is not None:
                yield f"{ban.title} was forgotten, and is here"

    @cached_property
    def _bans(self) -> Bans:
        return Bans(self._ledger.forgotten.all())

    def keys_by_row(self) -> Iterator[list[TileKey]]:
        """Yield the tiles that hold anything, or that a record touches, sorted, row by row."""
        for row in self._rows():
            sql = (
                'SELECT "column" FROM tile WHERE layer IN (0, 1, 2) AND row = ?1'
                " UNION SELECT DISTINCT tile_column FROM touched WHERE tile_row = ?1 ORDER BY 1"
            )
            with self._database.sound(f"the place of a tile in row {row}"):
                found = [tile_key(row, column) for (column,) in self._database.all(sql, (row,))]
            yield found

    def _rows(self) -> list[int]:
        """Return the rows of those tiles; of touched ones by steps through the index."""
        touched = self._database.all(
            "WITH RECURSIVE held (row) AS (SELECT min(tile_row) FROM touched UNION ALL"
            " SELECT (SELECT min(tile_row) FROM touched WHERE tile_row > held.row)"
            " FROM held WHERE held.row IS NOT NULL)"
            " SELECT row FROM held WHERE row IS NOT NULL"
        )
        with self._database.sound("the tiles that records touch"):
            return sorted({*self._directory.rows(), *(tile_place(row) for (row,) in touched)})

    def digests(self, key: TileKey) -> dict[int, object]:
        """Return the stored hash of each layer of a tile."""
        sql = 'SELECT layer, hash FROM tile WHERE layer IN (0, 1, 2) AND row = ? AND "column" = ?'
        return dict(self._database.all(sql, key))

    def is_touched(self, entry: Entry, touched: Touched) -> bool:
        """Whether these are the tiles that the ledger says an excursion's records touch.

        touched : sorted. No more rows are read than decide it: a forged list may have any length.
        """
        # The table begins with the tile: to ask for all tiles of an excursion would scan it.
        if self._touches.get(entry.identity, 0) != len(touched):
            return False
        return all(
            self._ledger.numbers_in(TileKey(*place), entry) == {number for *_, number in of_tile}
            for place, of_tile in groupby(touched, key=itemgetter(0, 1))
        )

    @cached_property
    def _touches(self) -> dict[int, int]:
        """How many tiles each excursion's records touch, each record's counted by itself."""
        sql = (
            "SELECT excursion, count(*) FROM touched WHERE excursion IN (SELECT id FROM excursion)"
            " GROUP BY excursion"
        )
        return dict(self._database.all(sql))


def title(entry: Entry) -> str:
    """Return an excursion's name, as a line begins."""
    return f"excursion {brief(entry.excursion)} of robot {brief(entry.robot)}"


def _tile_fault(
    layer: int, key: TileKey, bounds: Sequence[object], digest: object, data: object
) -> str | None:
    if layer not in LAYER_WORDS:
        return "there is no such layer"
    try:
        window = bounds_in_tile(*bounds)
        if not isinstance(data, bytes):
            return "no cells"
        cells = decode(Layer(layer), window, data)
    except zlib.error:
        return "its cells cannot be unpacked"
    except (ValueError, TypeError) as error:
        return printable(str(error))
    whole = np.zeros((TILE, TILE), dtype=cells.dtype)
    whole[window.row0 : window.row1, window.column0 : window.column1] = cells
    if not cells.any() or (cells < 0).any():
        return "its hash is not that of its cells"
    if encode(Layer(layer), key, whole)[:2] != (window, digest):
        return "its hash is not that of its cells"
    return None
