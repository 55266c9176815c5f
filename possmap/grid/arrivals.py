"""Which file held which records, in the order of arrival (METHOD §3, Ledger).

A file always holds an excursion from its first record on. So one number says what it held, and
what it brought that was new follows from those before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from possmap.grid.database import Database, Row
from possmap.logs.delivery import Origin

Name: TypeAlias = tuple[str, str]
"""Robot and excursion."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """That a file held the beginning of an excursion, perhaps all of it.

    name : robot and excursion.
    records : how many it held, from the first.
    carrier : robot and excursion of the log that carried them; None for the robot's own.
    source : the file's number in the ledger, which grows from one to the next.
    fused_at : when it came: UTC, ISO 8601.
    version : of the possmap that fused it.
    """

    name: Name
    records: int
    origin: Origin
    carrier: Name | None = None
    source: int = 0
    fused_at: str = ""
    version: str = ""


def with_news(arrivals: Iterable[Arrival]) -> Iterator[tuple[Arrival, int | None]]:
    """Yield arrivals, each with the number of the first record that it brought; None: nothing new.

    arrivals : in order, from the first; of any excursions.
    """
    known: dict[Name, int] = {}
    for one in arrivals:
        before = known.get(one.name)
        if before is None or one.records > before:
            known[one.name] = one.records
            yield one, before or 0
        else:
            yield one, None


_SELECT = (
    "SELECT excursion.robot, excursion.name, arrival.records, carrier_robot, carrier_excursion,"
    " source.id, source.name, sha256, size, fused_at, version FROM arrival"
    " JOIN excursion ON excursion.id = arrival.excursion JOIN source ON source.id = arrival.source"
)


class Arrivals:
    """What came into one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def all(self) -> Iterator[Arrival]:
        """Yield all that came, in the order of arrival."""
        return map(_arrival, self._database.all(f"{_SELECT} ORDER BY arrival.id"))

    def of(self, name: Name) -> list[Arrival]:
        """Return what came of one excursion, in the order of arrival."""
        sql = f"{_SELECT} WHERE excursion.robot = ? AND excursion.name = ? ORDER BY arrival.id"
        return list(map(_arrival, self._database.all(sql, name)))

    def times(self) -> dict[int, str]:
        """Return when each excursion first came, by its id, in that order: UTC, ISO 8601."""
        return dict(
            self._database.all(
                "SELECT arrival.excursion, source.fused_at FROM arrival"
                " JOIN source ON source.id = arrival.source"
                " WHERE arrival.id IN (SELECT min(id) FROM arrival GROUP BY excursion)"
                " ORDER BY arrival.id"
            )
        )

    def held(self, name: Name) -> dict[str, int]:
        """Return how many records of an excursion files are known to have held, by SHA-256."""
        return dict(
            self._database.all(
                "SELECT sha256, max(arrival.records) FROM arrival"
                " JOIN excursion ON excursion.id = arrival.excursion"
                " JOIN source ON source.id = arrival.source"
                " WHERE excursion.robot = ? AND excursion.name = ? GROUP BY sha256",
                name,
            )
        )

    def sources(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, SHA-256 and time of all files that anything came by, the first ones first."""
        yield from self._database.all("SELECT name, sha256, fused_at FROM source ORDER BY id")

    def brought_by(self, sha256: str) -> list[int]:
        """Return the ids of the excursions of which a file of these bytes held anything, sorted."""
        found = self._database.all(
            "SELECT DISTINCT excursion FROM arrival JOIN source ON source.id = arrival.source"
            " WHERE sha256 = ? ORDER BY excursion",
            (sha256,),
        )
        return [identity for (identity,) in found]

    def add(self, arrivals: Iterable[Arrival], fused_at: str, version: str) -> None:
        """Note what came of excursions already added, in the order of arrival.

        Of bytes that are known to have held as much of an excursion nothing is noted again.

        arrivals : their own numbers and times do not count.
        """
        sources: dict[Origin, int] = {}
        held: dict[Name, dict[str, int]] = {}
        for one in arrivals:
            origin, name = one.origin, one.name
            if name not in held:
                held[name] = self.held(name)
            if held[name].get(origin.sha256, -1) >= one.records:
                continue
            held[name][origin.sha256] = one.records
            if origin not in sources:
                sources[origin] = self._database.execute(
                    "INSERT INTO source (name, sha256, size, fused_at, version)"
                    " VALUES (?, ?, ?, ?, ?)",
                    (origin.name, origin.sha256, origin.size, fused_at, version),
                )
            self._database.execute(
                "INSERT INTO arrival (excursion, source, records, carrier_robot, carrier_excursion)"
                " SELECT id, ?, ?, ?, ? FROM excursion WHERE robot = ? AND name = ?",
                (sources[origin], one.records, *(one.carrier or (None, None)), *name),
            )

    def drop(self, name: Name, gone: Sequence[Arrival]) -> None:
        """Forget that some of what came of an excursion came, and files by which nothing came."""
        self._database.many(
            "DELETE FROM arrival WHERE source = ? AND excursion ="
            " (SELECT id FROM excursion WHERE robot = ? AND name = ?)",
            [(source, *name) for source in {one.source for one in gone}],
        )
        self._database.many(
            "DELETE FROM source WHERE id = ?1"
            " AND NOT EXISTS (SELECT 1 FROM arrival WHERE source = ?1)",
            [(source,) for source in {one.source for one in gone}],
        )


def _arrival(row: Row) -> Arrival:
    robot, excursion, records, by_robot, by_excursion, source, name, sha256, size, *rest = row
    carrier = None if by_robot is None else (by_robot, by_excursion)
    origin = Origin(name, sha256, size)
    return Arrival((robot, excursion), records, origin, carrier, source, *rest)
