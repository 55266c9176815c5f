"""Which file brought which records, in the order of arrival (METHOD §3, Ledger)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from possmap.errors import brief
from possmap.grid.checks import check_counts, check_types, whole
from possmap.grid.database import Database, Row
from possmap.logs.delivery import Origin

Name: TypeAlias = tuple[str, str]
"""Robot and excursion."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some records of an excursion, and what brought them.

    first, count : the records' numbers.
    carrier : robot and excursion of the log that carried them; None for the robot's own.
    """

    first: int
    count: int
    origin: Origin
    carrier: Name | None

    @property
    def end(self) -> int:
        """How many records the file held, from the first: a delivery always begins there."""
        return self.first + self.count

    def holds(self, number: int) -> bool:
        """Whether it brought the record of that number."""
        return self.first <= number < self.end


@dataclass(frozen=True, slots=True)
class Again:
    """A file that held records of an excursion which were all known when it came.

    end : how many it held, from the first; carrier : as of a part.
    """

    end: int
    origin: Origin
    carrier: Name | None


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


class Event(NamedTuple):
    """Anything that came, as the ledger remembers it.

    source : the file's number; of two, the one that came later has the larger.
    name : of the excursion; fused_at, version : as of an arrival.
    """

    source: int
    name: Name
    what: Part | Again
    fused_at: str
    version: str


_OF_FILES = (
    "carrier_robot, carrier_excursion, source.name, sha256, size, fused_at, version, excursion.id"
    " FROM {0}"
    " JOIN excursion ON excursion.id = {0}.excursion JOIN source ON source.id = {0}.source"
)
_PARTS = (
    "SELECT 0, part.source AS came, part.id AS place, excursion.robot, excursion.name,"
    f" first, count, {_OF_FILES.format('part')}"
)
_AGAIN = (
    "SELECT 1, again.source, 0, excursion.robot, excursion.name,"
    f" 0, count, {_OF_FILES.format('again')}"
)
_OF_ONE = " WHERE excursion.robot = ?1 AND excursion.name = ?2"
_OF_SOME = " WHERE {0}.excursion BETWEEN ?1 AND ?2"


class Arrivals:
    """What came into one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def parts(self, name: Name | None = None) -> Iterator[Arrival]:
        """Yield what brought something new, in the order of arrival; of one excursion, or all."""
        for event in self._events(name, (_PARTS,)):
            assert isinstance(event.what, Part)
            yield Arrival(*event.name, event.what, event.fused_at, event.version)

    def events(self, name: Name | None = None) -> Iterator[Event]:
        """Yield all that came, in the order of arrival; of one excursion, or of all."""
        # Before format 2 nothing was noted of a file without anything new.
        return self._events(name, (_PARTS, _AGAIN) if self._database.format > 1 else (_PARTS,))

    def _events(self, name: Name | None, tables: Sequence[str]) -> Iterator[Event]:
        where = "" if name is None else _OF_ONE
        sql = " UNION ALL ".join(table + where for table in tables) + " ORDER BY came, place"
        return self.parsed(self._database.all(sql, name or ()))

    def delivered(self, first: int, last: int) -> dict[object, list[Row]]:
        """Return what came of the excursions with ids from first to last: rows for ``parsed``.

        Of many it costs hardly more than of one: a file of format 1 has no index for it.
        """
        tables = (
            {"part": _PARTS, "again": _AGAIN} if self._database.format > 1 else {"part": _PARTS}
        )
        some = [table + _OF_SOME.format(name) for name, table in tables.items()]
        sql = " UNION ALL ".join(some) + " ORDER BY came, place"
        found: dict[object, list[Row]] = {}
        for row in self._database.all(sql, (first, last)):
            found.setdefault(row[-1], []).append(row)
        return found

    def parsed(self, rows: Iterable[Row]) -> Iterator[Event]:
        """Yield the events of which rows of this file tell.

        Raises
        ------
        GridError
            If one of them cannot have been written so.
        """
        for row in rows:
            is_again, source, _, robot, excursion, first, count, *rest = row
            by_robot, by_excursion, file, sha256, size, fused_at, version, _ = rest
            carrier = None if by_robot is None else (by_robot, by_excursion)
            whose = f"excursion {brief(str(excursion))} of robot {brief(str(robot))}"
            with self._database.sound(f"the arrivals of {whose}"):
                check_types((robot, str), (excursion, str), (file, str), (sha256, str))
                check_types((fused_at, str), (version, str))
                check_counts(first, count, size)
                if by_robot is not None or by_excursion is not None:
                    check_types((by_robot, str), (by_excursion, str))
                origin = Origin(file, sha256, size)
                what = (
                    Again(count, origin, carrier)
                    if is_again
                    else Part(first, count, origin, carrier)
                )
            yield Event(source, (robot, excursion), what, fused_at, version)

    @property
    def has_index(self) -> bool:
        """Whether what came of one excursion is found without a look at all that came."""
        return self._database.format > 1

    def held(self, name: Name) -> dict[str, int]:
        """Return how many records of an excursion files are known to have held, by SHA-256."""
        found: dict[str, int] = {}
        for event in self.events(name):
            sha256 = event.what.origin.sha256
            found[sha256] = max(event.what.end, found.get(sha256, 0))
        return found

    def sources(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, SHA-256 and time of all files that anything came by, the first ones first."""
        for name, sha256, fused_at in self._database.all(
            "SELECT name, sha256, fused_at FROM source ORDER BY id"
        ):
            with self._database.sound("a source"):
                check_types((name, str), (sha256, str), (fused_at, str))
            yield name, sha256, fused_at

    def brought_by(self, sha256: str) -> list[int]:
        """Return the ids of the excursions of which a file of these bytes held anything, sorted."""
        tables = ("part", "again") if self._database.format > 1 else ("part",)
        found = {
            identity
            for table in tables
            for (identity,) in self._database.all(
                f"SELECT excursion FROM {table} WHERE source IN"
                " (SELECT id FROM source WHERE sha256 = ?)",
                (sha256,),
            )
        }
        with self._database.sound("what a file brought"):
            return sorted(whole(identity) for identity in found)

    def add(self, came: Iterable[tuple[Name, Part | Again]], fused_at: str, version: str) -> None:
        """Note what came of excursions already added, in the order of arrival.

        came : robot and excursion, and what came of it; fused_at, version : as an arrival's.
        """
        sources: dict[Origin, int] = {}
        for name, what in came:
            origin = what.origin
            if origin not in sources:
                sources[origin] = self._database.execute(
                    "INSERT INTO source (name, sha256, size, fused_at, version)"
                    " VALUES (?, ?, ?, ?, ?)",
                    (origin.name, origin.sha256, origin.size, fused_at, version),
                )
            self._put(name, what, sources[origin])

    def replace(self, name: Name, events: Iterable[Event]) -> None:
        """Say anew what came of one excursion; files that nothing came by are not dropped here."""
        for table in ("part", "again"):
            self._database.execute(
                f"DELETE FROM {table} WHERE excursion ="
                " (SELECT id FROM excursion WHERE robot = ? AND name = ?)",
                name,
            )
        for event in events:
            self._put(name, event.what, event.source)

    def drop_sources(self) -> None:
        """Drop files that nothing came by any more."""
        self._database.execute(
            "DELETE FROM source WHERE id NOT IN"
            " (SELECT source FROM part UNION ALL SELECT source FROM again)"
        )

    def _put(self, name: Name, what: Part | Again, source: int) -> None:
        carrier = what.carrier or (None, None)
        if isinstance(what, Part):
            self._database.execute(
                "INSERT INTO part"
                " (excursion, first, count, source, carrier_robot, carrier_excursion)"
                " SELECT id, ?, ?, ?, ?, ? FROM excursion WHERE robot = ? AND name = ?",
                (what.first, what.count, source, *carrier, *name),
            )
        else:
            self._database.execute(
                "INSERT INTO again (excursion, source, count, carrier_robot, carrier_excursion)"
                " SELECT id, ?, ?, ?, ? FROM excursion WHERE robot = ? AND name = ?",
                (source, what.end, *carrier, *name),
            )


def replayed(events: Iterable[Event]) -> list[Event]:
    """Return events of one excursion as they would have been noted, had nothing else come.

    Each file held the records from the first on, so what one brought later proves what it held
    before: the first to hold a record is now what brought it.
    """
    found: dict[int, Event] = {}  # by a number that grows: the order in which they were noted
    again: dict[int, int] = {}  # by source, the number of what came once more by it
    longest: dict[int, int] = {}  # by source, how many records it is noted to have held
    known: int | None = None
    for number, event in enumerate(events):
        what, source = event.what, event.source
        if known is None or what.end > known:
            first = known or 0
            noted: Part | Again = Part(first, what.end - first, what.origin, what.carrier)
            known = what.end
        elif what.end > longest.get(source, -1):
            noted = Again(what.end, what.origin, what.carrier)
        else:
            continue
        if source in again:
            del found[again.pop(source)]
        if isinstance(noted, Again):
            again[source] = number
        found[number] = event._replace(what=noted)
        longest[source] = what.end
    return list(found.values())
