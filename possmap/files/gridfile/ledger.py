"""The ledger: every excursion, every record, and which file brought it (METHOD §3, Ledger)."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from operator import attrgetter

from possmap.core.evidence import Geometry
from possmap.core.fusion import Touched
from possmap.core.lattice import TileKey
from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.records import KIND_OF, KINDS, PartialMap, Pose, Record
from possmap.files.gridfile.database import Database
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


def _columns(kind: type[Record]) -> list[tuple[str, str]]:
    """Return attribute and column of each field of a kind of record."""
    return [(f.name, f.name.removesuffix("_deg")) for f in fields(kind)]


_GEOMETRY = (
    "map_x", "map_y", "half_x", "half_y",
    "map_x2", "map_y2", "half_x2", "half_y2", "map_heading",
)  # fmt: skip
_FLAGS = frozenset({"followed", "hit"})
_MAY_BE_ABSENT = frozenset({"t", "upto"})
_TYPES: dict[str, type] = {
    "seq": int, "followed": int, "hit": int, "upto": int,
    "corner": str, "peer": str, "peer_excursion": str, "extra": str,
}  # fmt: skip
_READ_COLUMNS = sorted({column for kind in KINDS.values() for _, column in _columns(kind)})


def excursion_hash(excursion: PartialMap, model: ErrorModel) -> bytes:
    """Return SHA-256 of an excursion's names, model in force and records, in a canonical form.

    Doubles are hashed as 8 bytes, big-endian, and absent values by a mark of their own: the same
    log gives the same hash from every encoding.
    """
    digest = hashlib.sha256()

    def add(value: object) -> None:
        if isinstance(value, str):
            data = value.encode()
            digest.update(b"s" + struct.pack(">I", len(data)) + data)
        elif isinstance(value, float):
            digest.update(b"d" + struct.pack(">d", value))
        elif value is None:
            digest.update(b"-")
        else:
            digest.update(b"i" + struct.pack(">q", value))

    add(excursion.robot)
    add(excursion.excursion)
    for name in PARAMETERS:
        add(float(getattr(model, name)))
    for record in excursion.records:
        add(KIND_OF[type(record)])
        for value in _CONTENT[type(record)](record):
            add(value)
    return digest.digest()


_CONTENT = {
    kind: attrgetter(*(name for name, _ in _columns(kind) if name != "extra"))
    for kind in KINDS.values()
}


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
                _check_types((robot, str), (name, str), (model, str), (records, int))
                entry = Entry(identity, robot, name, ErrorModel(**json.loads(model)), records)
            yield entry

    def version(self, entry: Entry) -> PartialMap:
        """Return all that is known of an excursion, as logged."""
        row = self._database.one(
            "SELECT own_model, extra FROM excursion WHERE id = ?", (entry.identity,)
        )
        own_model, extra = row or ("{}", "")
        columns = ", ".join(f'"{column}"' for column in _READ_COLUMNS)
        rows = self._database.all(
            f"SELECT kind, {columns} FROM record WHERE excursion = ? ORDER BY number",
            (entry.identity,),
        )
        with self._sound(f"excursion {entry.excursion} of robot {entry.robot}"):
            if len(rows) != entry.records:
                raise ValueError(f"{len(rows)} records, expected {entry.records}")
            records = tuple(
                _record(kind, dict(zip(_READ_COLUMNS, values, strict=True)))
                for kind, *values in rows
            )
            model = tuple(sorted(json.loads(own_model).items()))
            return PartialMap(entry.robot, entry.excursion, model, records, extra)

    def geometry(self, entry: Entry) -> dict[int, Geometry]:
        """Return where an excursion's records lie on the map, by number."""
        return dict(self._geometry("excursion = ?", (entry.identity,)))

    def _geometry(self, where: str, values: Sequence[object]) -> Iterator[tuple[int, Geometry]]:
        sql = (
            f"SELECT number, {', '.join(_GEOMETRY)} FROM record"
            f" WHERE {where} AND map_x IS NOT NULL ORDER BY excursion, number"
        )
        for number, x, y, half_x, half_y, x2, y2, half_x2, half_y2, heading in self._database.all(
            sql, values
        ):
            with self._sound(f"the place of record {number}"):
                for value in (x, y, half_x, half_y, x2, y2, half_x2, half_y2):
                    _check_types((value, float))
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
                _check_types((first, int), (count, int), (origin[0], str), (at, str))
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

    def add_source(self, origin: Origin, fused_at: str, version: str) -> int:
        """Note a file that brings something new, and return its id."""
        return self._database.execute(
            "INSERT INTO source (name, sha256, size, fused_at, version) VALUES (?, ?, ?, ?, ?)",
            (origin.name, origin.sha256, origin.size, fused_at, version),
        )

    def add(
        self,
        version: PartialMap,
        model: ErrorModel,
        known_records: int,
        geometry: Mapping[int, Geometry],
        parts: Sequence[tuple[Part, int]],
        touched: Touched,
    ) -> None:
        """Write down a new excursion, or the later part of a known one.

        Parameters
        ----------
        known_records
            How many records the ledger holds already.
        parts
            What brought the others, each with the id of its source.
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
            columns = ["excursion", "number", "kind", *(c for _, c in _columns(kind)), *_GEOMETRY]
            marks = ", ".join("?" * len(columns))
            content = attrgetter(*(name for name, _ in _columns(kind)))
            names = ", ".join(f'"{column}"' for column in columns)
            self._database.many(
                f"INSERT OR REPLACE INTO record ({names}) VALUES ({marks})",
                (
                    (
                        identity,
                        number,
                        KIND_OF[kind],
                        *content(record),
                        *_laid_out(geometry, number),
                    )
                    for number, record in enumerate(version.records[first:], first)
                    if type(record) is kind
                ),
            )
        self._database.many(
            "INSERT INTO part (excursion, first, count, source, carrier_robot, carrier_excursion)"
            " VALUES (?, ?, ?, ?, ?, ?)",
            (
                (identity, part.first, part.count, source, *(part.carrier or (None, None)))
                for part, source in parts
            ),
        )
        self._database.many(
            "INSERT OR IGNORE INTO touched VALUES (?, ?, ?, ?)",
            ((*key, identity, number) for key, number in sorted(touched)),
        )


def _laid_out(geometry: Mapping[int, Geometry], number: int) -> tuple[float | None, ...]:
    at = geometry.get(number)
    if at is None:
        return (None,) * len(_GEOMETRY)
    return (
        at.x, at.y, at.rect.half_x, at.rect.half_y,
        at.x2, at.y2, at.rect2.half_x, at.rect2.half_y, at.heading_deg,
    )  # fmt: skip


def _record(kind: str, row: Mapping[str, object]) -> Record:
    """Return a record of its row; ValueError or TypeError if it cannot have been written so."""
    make: Callable[..., Record] = KINDS[kind]
    values: dict[str, object] = {}
    for name, column in _columns(KINDS[kind]):
        value = row[column]
        if value is None and column not in _MAY_BE_ABSENT:
            raise ValueError(f"{column} is missing")
        if value is not None and type(value) is not _TYPES.get(column, float):
            raise TypeError(f"{column} is no {_TYPES.get(column, float).__name__}")
        values[name] = bool(value) if column in _FLAGS else value
    return make(**values)


def _check_types(*values: tuple[object, type]) -> None:
    for value, expected in values:
        if type(value) is not expected:
            raise TypeError(f"found a {type(value).__name__}, expected a {expected.__name__}")
