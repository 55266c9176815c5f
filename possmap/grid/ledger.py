"""The ledger: every excursion, every record, and which file brought it (METHOD §3, Ledger)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

from possmap.core.evidence import Geometry
from possmap.core.lattice import TileKey
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.records import PartialMap
from possmap.errors import brief
from possmap.grid.arrivals import Arrival, Arrivals, Name, Part
from possmap.grid.bounds import LARGEST
from possmap.grid.checks import (
    check_counts,
    check_places,
    check_types,
    exactly,
    model_in_force,
    own_model,
    whole,
)
from possmap.grid.database import Database
from possmap.grid.forgotten import ForgottenList
from possmap.grid.rows import GEOMETRY, RECORD_COLUMNS, ExcursionRows, record_of_row

__all__ = ["Arrival", "Entry", "Ledger", "Part"]


@dataclass(frozen=True, slots=True)
class Entry:
    """An excursion of the ledger, without its records.

    model : in force since its first fuse.
    """

    identity: int
    robot: str
    excursion: str
    model: ErrorModel
    records: int

    @property
    def name(self) -> tuple[str, str]:
        """Robot and excursion."""
        return self.robot, self.excursion


class Ledger:
    """The excursions of one grid file.

    Attributes
    ----------
    came
        Which file brought which records.
    forgotten
        What was taken out, and is not let in.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.came = Arrivals(database)
        self.forgotten = ForgottenList(database)

    def entry(self, name: tuple[str, str]) -> Entry | None:
        """Return an excursion by robot and name, or None if it is not known."""
        for entry in self._entries("WHERE robot = ? AND name = ?", name):
            return entry
        return None

    def entries(self) -> Iterator[Entry]:
        """Yield the excursions in the order in which they were first fused."""
        return self._entries("ORDER BY id", ())

    def count(self) -> int:
        """Return how many excursions there are."""
        # Not count(*), which is one step of SQLite's machine, however long it takes.
        return int((self._database.one("SELECT count(id) FROM excursion") or (0,))[0])

    def identities(self) -> list[int]:
        """Return the ids of all excursions, in the same order."""
        return [
            identity for (identity,) in self._database.all("SELECT id FROM excursion ORDER BY id")
        ]

    def entry_of(self, identity: int) -> Entry | None:
        """Return an excursion by its id, or None if it is not known."""
        for entry in self._entries("WHERE id = ?", (identity,)):
            return entry
        return None

    def _entries(self, clause: str, values: Sequence[object]) -> Iterator[Entry]:
        sql = f"SELECT id, robot, name, model, records FROM excursion {clause}"
        for identity, robot, name, model, records in self._database.all(sql, values):
            with self._database.sound(_title(robot, name)):
                check_types((robot, str), (name, str))
                check_counts(records)
                entry = Entry(identity, robot, name, model_in_force(model), records)
            yield entry

    def version(self, entry: Entry, most: int | None = None) -> PartialMap:
        """Return all that is known of an excursion, as logged; or its first ``most`` records."""
        count = entry.records if most is None else min(most, entry.records)
        some = f" AND number < {count}" if count < entry.records else ""
        row = self._database.one(
            "SELECT own_model, extra FROM excursion WHERE id = ?", (entry.identity,), LARGEST
        )
        own, extra = row or ("{}", "")
        columns = ", ".join(f'"{column}"' for column in RECORD_COLUMNS)
        rows = self._database.all(
            f"SELECT {columns}, number, kind FROM record WHERE excursion = ?{some} ORDER BY number",
            (entry.identity,),
            LARGEST,
        )
        with self._database.sound(_title(entry.robot, entry.excursion)):
            if len(rows) != count:
                raise ValueError(f"{len(rows)} records, expected {count}")
            if list(map(itemgetter(-2), rows)) != list(range(count)):
                raise ValueError("its records are not numbered one by one")
            records = tuple(map(record_of_row, map(itemgetter(-1), rows), rows))
            extra = exactly(extra, str)
            return PartialMap(entry.robot, entry.excursion, own_model(own), records, extra)

    def geometry(self, entry: Entry) -> dict[int, Geometry]:
        """Return where an excursion's records lie on the map, by number."""
        return dict(self._geometry(entry))

    def _geometry(
        self, entry: Entry, where: str = "", values: Sequence[object] = ()
    ) -> Iterator[tuple[int, Geometry]]:
        sql = (
            f"SELECT number, {', '.join(GEOMETRY)} FROM record"
            f" WHERE excursion = ?{where} AND map_x IS NOT NULL ORDER BY excursion, number"
        )
        for number, *places, heading in self._database.all(sql, (entry.identity, *values)):
            with self._database.sound(f"the place of record {number}"):
                if not 0 <= whole(number) < entry.records:
                    raise ValueError(f"the excursion has {entry.records} records")
                check_places(places)
                if heading is not None:
                    check_places((heading,))
                x, y, half_x, half_y, x2, y2, half_x2, half_y2 = places
                rect, rect2 = _rectangle(half_x, half_y), _rectangle(half_x2, half_y2)
            yield number, Geometry(x, y, rect, x2, y2, rect2, heading)

    def places(
        self, kind: str, window_m: tuple[float, float, float, float] | None = None
    ) -> Iterator[tuple[Entry, int, Geometry]]:
        """Yield where the records of one kind lie on the map, excursion by excursion.

        window_m : only those within x0, y0, x1, y1 [m].
        """
        within = "" if window_m is None else " AND map_x BETWEEN ? AND ? AND map_y BETWEEN ? AND ?"
        x0, y0, x1, y1 = window_m or (0, 0, 0, 0)
        values = () if window_m is None else (x0, x1, y0, y1)
        for entry in list(self.entries()):
            found = self._geometry(entry, " AND kind = ?" + within, (kind, *values))
            for number, geometry in found:
                yield entry, number, geometry

    def numbers_in(self, key: TileKey, entry: Entry) -> set[int]:
        """Return the numbers of an excursion's records that touch a tile."""
        found = self._database.all(
            "SELECT number FROM touched WHERE tile_row = ? AND tile_column = ? AND excursion = ?"
            " AND number BETWEEN 0 AND ?",  # of a forged list no more than there are records
            (*key, entry.identity, entry.records - 1),
        )
        return {number for (number,) in found}

    def known_in(self, key: TileKey) -> list[int]:
        """Return the ids of the excursions that touch a tile, sorted."""
        found = self._database.all(
            "SELECT DISTINCT excursion FROM touched WHERE tile_row = ? AND tile_column = ?"
            " ORDER BY excursion",
            key,
        )
        with self._database.sound(f"what touches tile {key.row}, {key.column}"):
            return [whole(identity) for (identity,) in found]

    def arrivals(self, name: Name | None = None) -> Iterator[Arrival]:
        """Yield what brought each part, in the order of arrival; of one excursion, or of all."""
        return self.came.parts(name)

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every excursion, in canonical order."""
        for (digest,) in self._database.all("SELECT hash FROM excursion ORDER BY robot, name"):
            if not isinstance(digest, bytes):
                raise self._database.damaged("the hash of an excursion")
            yield digest

    def add(self, rows: ExcursionRows) -> None:
        """Write down a new excursion, or the later part of a known one."""
        found = self._database.returning(
            "INSERT INTO excursion (robot, name, own_model, model, records, hash, extra)"
            " VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (robot, name) DO UPDATE SET"
            " records = excluded.records, hash = excluded.hash, extra = excluded.extra"
            " RETURNING id",
            rows.head,
        )
        identity = (int(found[0]) if found else 0,)
        for statement, records in rows.records.items():
            self._database.many(statement, [identity + row for row in records])
        self._database.many(
            "INSERT OR IGNORE INTO touched VALUES (?, ?, ?, ?)",
            [(row, column, *identity, number) for row, column, number in rows.touched],
        )

    def remove(self, entry: Entry, keys: Iterable[TileKey]) -> None:
        """Drop an excursion and all that belongs to it, but for the files that it came by.

        keys : the tiles that its records touch.
        """
        self.came.replace(entry.name, ())
        self._bare(entry, keys)
        self._database.execute("DELETE FROM excursion WHERE id = ?", (entry.identity,))

    def rewrite(self, entry: Entry, keys: Iterable[TileKey], rows: ExcursionRows) -> None:
        """Replace the records of an excursion by fewer of them.

        keys : the tiles that its records touched so far; rows : all that it is to be.
        """
        self._bare(entry, keys)
        self.add(rows)

    def _bare(self, entry: Entry, keys: Iterable[TileKey]) -> None:
        self._database.execute("DELETE FROM record WHERE excursion = ?", (entry.identity,))
        self._database.many(
            "DELETE FROM touched WHERE tile_row = ? AND tile_column = ? AND excursion = ?",
            [(*key, entry.identity) for key in keys],
        )


def _title(robot: object, excursion: object) -> str:
    return f"excursion {brief(str(excursion))} of robot {brief(str(robot))}"


def _rectangle(half_x: float, half_y: float) -> ErrorRectangle:
    """Return a stored rectangle; ValueError if it cannot have been written so."""
    if not (half_x >= 0 and half_y >= 0):  # phrased so that NaN is refused too
        raise ValueError(f"half-widths must be >= 0 m, found {half_x}, {half_y}")
    return ErrorRectangle(half_x, half_y)
