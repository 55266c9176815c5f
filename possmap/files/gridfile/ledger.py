"""The ledger: every excursion, every record, and which file brought it (METHOD §3, Ledger)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from operator import attrgetter

from possmap.core.evidence import Geometry
from possmap.core.fusion import Touched
from possmap.core.lattice import TileKey
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.records import KIND_OF, KINDS, PartialMap, Pose
from possmap.files.gridfile.database import Database
from possmap.files.gridfile.rows import (
    GEOMETRY,
    RECORD_COLUMNS,
    check_types,
    columns_of,
    excursion_hash,
    geometry_row,
    record_of_row,
)
from possmap.files.logs.delivery import Origin


@dataclass(frozen=True, slots=True)
class Part:
    """Some records of an excursion, and what brought them.

    first, count : the records' numbers.
    carrier : robot and excursion of the log that carried them; None for the robot's own.
    """

    first: int
    count: int
    origin: Origin
    carrier: tuple[str, str] | None

    def holds(self, number: int) -> bool:
        """Whether it brought the record of that number."""
        return self.first <= number < self.first + self.count


@dataclass(frozen=True, slots=True)
class Arrival:
    """A part as the ledger remembers it.

    fused_at : UTC, ISO 8601.
    version : of the possmap that fused it.
    """

    robot: str
    excursion: str
    part: Part
    fused_at: str
    version: str


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
    """The excursions of one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def entry(self, name: tuple[str, str]) -> Entry | None:
        """Return an excursion by robot and name, or None if it is not known."""
        for entry in self._entries("WHERE robot = ? AND name = ?", name):
            return entry
        return None

    def entries(self) -> Iterator[Entry]:
        """Yield the excursions in the order in which they were first fused."""
        return self._entries("ORDER BY id", ())

    def _entries(self, clause: str, values: Sequence[object]) -> Iterator[Entry]:
        sql = f"SELECT id, robot, name, model, records FROM excursion {clause}"
        for identity, robot, name, model, records in self._database.all(sql, values):
            with self._sound(f"excursion {name} of robot {robot}"):
                check_types((robot, str), (name, str), (model, str), (records, int))
                entry = Entry(identity, robot, name, ErrorModel(**json.loads(model)), records)
            yield entry

    def version(self, entry: Entry) -> PartialMap:
        """Return all that is known of an excursion, as logged."""
        row = self._database.one(
            "SELECT own_model, extra FROM excursion WHERE id = ?", (entry.identity,)
        )
        own_model, extra = row or ("{}", "")
        columns = ", ".join(f'"{column}"' for column in RECORD_COLUMNS)
        rows = self._database.all(
            f"SELECT kind, {columns} FROM record WHERE excursion = ? ORDER BY number",
            (entry.identity,),
        )
        with self._sound(f"excursion {entry.excursion} of robot {entry.robot}"):
            if len(rows) != entry.records:
                raise ValueError(f"{len(rows)} records, expected {entry.records}")
            records = tuple(
                record_of_row(kind, dict(zip(RECORD_COLUMNS, values, strict=True)))
                for kind, *values in rows
            )
            model = tuple(sorted(json.loads(own_model).items()))
            return PartialMap(entry.robot, entry.excursion, model, records, extra)

    def geometry(self, entry: Entry) -> dict[int, Geometry]:
        """Return where an excursion's records lie on the map, by number."""
        return dict(self._geometry("excursion = ?", (entry.identity,)))

    def _geometry(self, where: str, values: Sequence[object]) -> Iterator[tuple[int, Geometry]]:
        sql = (
            f"SELECT number, {', '.join(GEOMETRY)} FROM record"
            f" WHERE {where} AND map_x IS NOT NULL ORDER BY excursion, number"
        )
        for number, x, y, half_x, half_y, x2, y2, half_x2, half_y2, heading in self._database.all(
            sql, values
        ):
            with self._sound(f"the place of record {number}"):
                for value in (x, y, half_x, half_y, x2, y2, half_x2, half_y2):
                    check_types((value, float))
                rect, rect2 = ErrorRectangle(half_x, half_y), ErrorRectangle(half_x2, half_y2)
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
            for number, geometry in self._geometry(
                "excursion = ? AND kind = ?" + within, (entry.identity, kind, *values)
            ):
                yield entry, number, geometry

    def touching(self, key: TileKey) -> dict[int, set[int]]:
        """Return the records that touch a tile: excursion's id -> numbers."""
        found: dict[int, set[int]] = {}
        for identity, number in self._database.all(
            "SELECT excursion, number FROM touched WHERE tile_row = ? AND tile_column = ?", key
        ):
            found.setdefault(identity, set()).add(number)
        return found

    def arrivals(self, name: tuple[str, str] | None = None) -> Iterator[Arrival]:
        """Yield what brought each part, in the order of arrival; of one excursion, or of all."""
        where = "" if name is None else "WHERE excursion.robot = ? AND excursion.name = ?"
        for row in self._database.all(
            "SELECT robot, excursion.name, first, count, carrier_robot, carrier_excursion,"
            " source.name, sha256, size, fused_at, version FROM part"
            " JOIN excursion ON excursion.id = part.excursion"
            f" JOIN source ON source.id = part.source {where} ORDER BY part.id",
            name or (),
        ):
            robot, excursion, first, count, by_robot, by_excursion, *origin, at, version = row
            carrier = None if by_robot is None else (by_robot, by_excursion)
            with self._sound(f"the arrivals of excursion {excursion} of robot {robot}"):
                check_types((first, int), (count, int), (origin[0], str), (at, str))
            part = Part(first, count, Origin(*origin), carrier)
            yield Arrival(robot, excursion, part, at, version)

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every excursion, in canonical order."""
        for (digest,) in self._database.all("SELECT hash FROM excursion ORDER BY robot, name"):
            if not isinstance(digest, bytes):
                raise self._database.damaged("the hash of an excursion")
            yield digest

    @contextmanager
    def _sound(self, what: str) -> Iterator[None]:
        """Turn what cannot have been written so into the error that says it is damaged."""
        try:
            yield
        except (ValueError, TypeError, KeyError) as error:
            raise self._database.damaged(f"{what}: {error}") from error

    def add_arrivals(
        self, parts: Sequence[tuple[tuple[str, str], Part]], fused_at: str, version: str
    ) -> None:
        """Note what brought the records of excursions already added, in the order of arrival.

        parts : robot and excursion, and the part; fused_at, version: as an arrival's.
        """
        sources: dict[Origin, int] = {}
        for (robot, excursion), part in parts:
            origin = part.origin
            if origin not in sources:
                sources[origin] = self._database.execute(
                    "INSERT INTO source (name, sha256, size, fused_at, version)"
                    " VALUES (?, ?, ?, ?, ?)",
                    (origin.name, origin.sha256, origin.size, fused_at, version),
                )
            carrier = part.carrier or (None, None)
            self._database.execute(
                "INSERT INTO part"
                " (excursion, first, count, source, carrier_robot, carrier_excursion)"
                " SELECT id, ?, ?, ?, ?, ? FROM excursion WHERE robot = ? AND name = ?",
                (part.first, part.count, sources[origin], *carrier, robot, excursion),
            )

    def add(
        self,
        version: PartialMap,
        model: ErrorModel,
        known_records: int,
        geometry: Mapping[int, Geometry],
        touched: Touched,
    ) -> None:
        """Write down a new excursion, or the later part of a known one.

        Parameters
        ----------
        known_records
            How many records the ledger holds already.
        touched
            Tiles and the numbers of the new records that touch them.
        """
        row = self._database.one(
            "INSERT INTO excursion (robot, name, own_model, model, records, hash, extra)"
            " VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (robot, name) DO UPDATE SET"
            " records = excluded.records, hash = excluded.hash, extra = excluded.extra"
            " RETURNING id",
            (
                version.robot, version.excursion, json.dumps(dict(version.model)),
                json.dumps(asdict(model)), len(version.records),
                excursion_hash(version, model), version.extra,
            ),
        )  # fmt: skip
        identity = int(row[0]) if row else 0
        # Records that waited for a pose lie on the map now: they are written again.
        first = known_records
        while first and not isinstance(version.records[first - 1], Pose):
            first -= 1
        for kind in KINDS.values():
            columns = ["excursion", "number", "kind", *(c for _, c in columns_of(kind)), *GEOMETRY]
            marks = ", ".join("?" * len(columns))
            content = attrgetter(*(name for name, _ in columns_of(kind)))
            names = ", ".join(f'"{column}"' for column in columns)
            self._database.many(
                f"INSERT OR REPLACE INTO record ({names}) VALUES ({marks})",
                (
                    (
                        identity,
                        number,
                        KIND_OF[kind],
                        *content(record),
                        *geometry_row(geometry, number),
                    )
                    for number, record in enumerate(version.records[first:], first)
                    if type(record) is kind
                ),
            )
        self._database.many(
            "INSERT OR IGNORE INTO touched VALUES (?, ?, ?, ?)",
            ((*key, identity, number) for key, number in sorted(touched)),
        )
