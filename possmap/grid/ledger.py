"""The ledger: every excursion, every record, and which file brought it (METHOD §3, Ledger)."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Geometry
from possmap.core.lattice import TileKey
from possmap.core.model import ErrorModel
from possmap.core.observations import Observations
from possmap.core.propagation import ErrorRectangle
from possmap.core.ranges import LARGEST
from possmap.core.records import PartialMap
from possmap.errors import brief
from possmap.grid.arrivals import Arrivals
from possmap.grid.database import Database, Row
from possmap.grid.forgotten import ForgottenList
from possmap.grid.refined import RefinedTracks
from possmap.grid.rows import GEOMETRY, HEAD, RECORD_COLUMNS, ExcursionRows, record_of_row

_PLACE = "excursion, number, map_x, map_y, half_x, half_y"


@dataclass(frozen=True, slots=True)
class Entry:
    """An excursion of the ledger, without its records.

    identity : its number in this file.
    model : in force since its first fuse.
    records : how many are known.
    beyond : how many of them say nothing, since the error there reaches ``max_error``.
    observations : what walls told of its heading (estimator ``walls``).
    """

    identity: int
    robot: str
    excursion: str
    model: ErrorModel
    records: int
    beyond: int
    observations: Observations

    @property
    def name(self) -> tuple[str, str]:
        """Robot and excursion."""
        return self.robot, self.excursion

    @property
    def title(self) -> str:
        """Its name, as a message begins."""
        return f"excursion {brief(self.excursion)} of robot {brief(self.robot)}"


class Ledger:
    """The excursions of one grid file.

    Attributes
    ----------
    came
        Which file brought which records.
    forgotten
        What was taken out, and is not let in.
    tracks
        Those that ``possmap refine`` moved.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.came = Arrivals(database)
        self.forgotten = ForgottenList(database)
        self.tracks = RefinedTracks(database)

    def entry(self, name: tuple[str, str]) -> Entry | None:
        """Return an excursion by robot and name, or None if it is not known."""
        return next(self._entries("WHERE robot = ? AND name = ?", name), None)

    def first_of(self, robot: str) -> Entry | None:
        """Return a robot's excursion that was fused first, or None if there is none."""
        return next(self._entries("WHERE robot = ? ORDER BY id LIMIT 1", (robot,)), None)

    def entry_of(self, identity: int) -> Entry | None:
        """Return an excursion by its id, or None if it is not known."""
        return next(self._entries("WHERE id = ?", (identity,)), None)

    def entries(self) -> Iterator[Entry]:
        """Yield the excursions in the order in which they were first fused."""
        return self._entries("ORDER BY id", ())

    def count(self) -> int:
        """Return how many excursions there are."""
        return int((self._database.one("SELECT count(*) FROM excursion") or (0,))[0])

    def identities(self) -> list[int]:
        """Return the ids of all excursions, in the same order."""
        return [
            identity for (identity,) in self._database.all("SELECT id FROM excursion ORDER BY id")
        ]

    def _entries(self, clause: str, values: Sequence[object]) -> Iterator[Entry]:
        for identity, robot, name, model, records, beyond, *told in self._database.all(
            f"SELECT id, robot, name, model, records, beyond, {', '.join(Observations._fields)}"
            f" FROM excursion {clause}",
            values,
        ):
            try:
                in_force = ErrorModel(**json.loads(model))
            except (ValueError, TypeError, RecursionError) as error:
                title = f"excursion {brief(name)} of robot {brief(robot)}"
                raise self._database.damaged(f"{title}: its model: {error}") from error
            yield Entry(identity, robot, name, in_force, records, beyond, Observations(*told))

    def version(self, entry: Entry, most: int | None = None) -> PartialMap:
        """Return all that is known of an excursion, as logged; or its first ``most`` records.

        Raises
        ------
        GridError
            If they are not numbered one by one, or are no records.
        """
        count = entry.records if most is None else min(most, entry.records)
        some = f" AND number < {count}" if count < entry.records else ""
        own, extra = self._database.one(
            "SELECT own_model, extra FROM excursion WHERE id = ?", (entry.identity,)
        ) or ("{}", "")
        columns = ", ".join(f'"{column}"' for column in RECORD_COLUMNS)
        rows = self._database.all(
            f"SELECT {columns}, number, kind FROM record WHERE excursion = ?{some} ORDER BY number",
            (entry.identity,),
        )
        try:
            if list(map(itemgetter(-2), rows)) != list(range(count)):
                raise ValueError(f"{len(rows)} records, expected {count}, numbered one by one")
            records = tuple(map(record_of_row, map(itemgetter(-1), rows), rows))
            model = tuple(sorted(json.loads(own).items()))
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError) as error:
            raise self._database.damaged(f"{entry.title}: {error}") from error
        return PartialMap(entry.robot, entry.excursion, model, records, extra)

    def geometry(self, entry: Entry) -> dict[int, Geometry]:
        """Return where an excursion's records lie on the map, by number."""
        found = {}
        for number, x, y, half_x, half_y, x2, y2, half_x2, half_y2, heading in self._database.all(
            f"SELECT number, {', '.join(GEOMETRY)} FROM record"
            " WHERE excursion = ? AND map_x IS NOT NULL ORDER BY number",
            (entry.identity,),
        ):
            rect, rect2 = ErrorRectangle(half_x, half_y), ErrorRectangle(half_x2, half_y2)
            found[number] = Geometry(x, y, rect, x2, y2, rect2, heading)
        return found

    def places(
        self, kind: str, window_m: tuple[float, float, float, float] | None = None
    ) -> NDArray[np.float64]:
        """Return where the records of one kind lie on the map, excursion by excursion.

        window_m : only those within x0, y0, x1, y1 [m].

        Returns
        -------
        NDArray
            Rows of excursion, number, x, y and half-widths along x and y [m].
        """
        within = "" if window_m is None else " AND map_x BETWEEN ? AND ? AND map_y BETWEEN ? AND ?"
        x0, y0, x1, y1 = window_m or (0, 0, 0, 0)
        values = (kind,) if window_m is None else (kind, x0, x1, y0, y1)
        return _places(
            self._database.all(
                f"SELECT {_PLACE} FROM record WHERE kind = ? AND map_x IS NOT NULL{within}"
                " ORDER BY excursion, number",
                values,
            )
        )

    def first_poses(self, window_m: tuple[float, float, float, float]) -> NDArray[np.float64]:
        """Return where excursions began within x0, y0, x1, y1 [m], in rows as of ``places``."""
        x0, y0, x1, y1 = window_m
        return _places(
            self._database.all(
                f"SELECT {_PLACE} FROM excursion JOIN record ON record.excursion = excursion.id"
                " AND number = (SELECT number FROM record WHERE excursion = excursion.id"
                " AND kind = 'pose' AND map_x IS NOT NULL ORDER BY number LIMIT 1)"
                " WHERE map_x BETWEEN ? AND ? AND map_y BETWEEN ? AND ? ORDER BY excursion",
                (x0, x1, y0, y1),
            )
        )

    def fixes(
        self, window_m: tuple[float, float, float, float] | None = None
    ) -> NDArray[np.float64]:
        """Return where somebody said that robots truly were, in rows as of ``places``."""
        x0, y0, x1, y1 = window_m or (-LARGEST, -LARGEST, LARGEST, LARGEST)
        return _places(
            self._database.all(
                "SELECT excursion, number, x, y, error_x, error_y FROM record WHERE kind = 'fix'"
                " AND x BETWEEN ? AND ? AND y BETWEEN ? AND ? ORDER BY excursion, number",
                (x0, x1, y0, y1),
            )
        )

    def numbers_in(self, key: TileKey, entry: Entry) -> set[int]:
        """Return the numbers of an excursion's records that touch a tile."""
        found = self._database.all(
            "SELECT number FROM touched WHERE tile_row = ? AND tile_column = ? AND excursion = ?",
            (*key, entry.identity),
        )
        return {number for (number,) in found}

    def touching(self, key: TileKey) -> dict[int, set[int]]:
        """Return the numbers of the records that touch a tile, by their excursions' ids."""
        found: dict[int, set[int]] = {}
        for identity, number in self._database.all(
            "SELECT excursion, number FROM touched WHERE tile_row = ? AND tile_column = ?"
            " ORDER BY excursion",
            key,
        ):
            found.setdefault(identity, set()).add(number)
        return found

    def known_in(self, key: TileKey) -> list[int]:
        """Return the ids of the excursions that touch a tile, sorted."""
        found = self._database.all(
            "SELECT DISTINCT excursion FROM touched WHERE tile_row = ? AND tile_column = ?"
            " ORDER BY excursion",
            key,
        )
        return [identity for (identity,) in found]

    def touched_by(self, identities: Collection[int]) -> dict[int, list[TileKey]]:
        """Return the tiles that the records of some excursions touch, by their ids; sorted."""
        found: dict[int, list[TileKey]] = {identity: [] for identity in identities}
        # The table begins with the tile: to ask for an excursion is to go through all of it.
        for identity, row, column in self._database.all(
            "SELECT DISTINCT excursion, tile_row, tile_column FROM touched WHERE excursion IN"
            " (SELECT value FROM json_each(?)) ORDER BY tile_row, tile_column",
            (json.dumps(sorted(identities)),),
        ):
            found[identity].append(TileKey(row, column))
        return found

    def hashes(self) -> Iterator[bytes]:
        """Yield the hash of every excursion, in canonical order."""
        for (digest,) in self._database.all("SELECT hash FROM excursion ORDER BY robot, name"):
            yield digest

    def add(self, rows: ExcursionRows) -> None:
        """Write down a new excursion, or the later part of a known one."""
        found = self._database.one(
            f"INSERT INTO excursion ({', '.join(HEAD)}) VALUES ({', '.join('?' * len(HEAD))})"
            " ON CONFLICT (robot, name) DO UPDATE SET"
            f" {', '.join(f'{column} = excluded.{column}' for column in HEAD[4:])} RETURNING id",
            rows.head,
        )
        identity = (int(found[0]) if found else 0,)
        for statement, records in rows.records.items():
            self._database.many(statement, [identity + row for row in records])
        self._database.many(
            "INSERT OR IGNORE INTO touched VALUES (?, ?, ?, ?)",
            [(row, column, *identity, number) for row, column, number in rows.touched],
        )

    def strike(self, entry: Entry, keys: Iterable[TileKey]) -> None:
        """Take an excursion's records out; what is left of it may then be added anew.

        keys : the tiles that they touch.
        """
        self._database.many(
            "DELETE FROM touched WHERE tile_row = ? AND tile_column = ? AND excursion = ?",
            [(*key, entry.identity) for key in keys],
        )
        self._database.execute("DELETE FROM record WHERE excursion = ?", (entry.identity,))

    def remove(self, entry: Entry, keys: Iterable[TileKey]) -> None:
        """Take an excursion out, and that anything came of it; keys : as of ``strike``."""
        self.came.drop(entry.name, self.came.of(entry.name))
        self.strike(entry, keys)
        self._database.execute("DELETE FROM excursion WHERE id = ?", (entry.identity,))


def _places(rows: list[Row]) -> NDArray[np.float64]:
    return np.array(rows, dtype=np.float64).reshape(-1, 6)
