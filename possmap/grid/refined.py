"""The tracks that a refined grid keeps, beside the ledger that they were made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from possmap.core.refined import RefinedPose, RefinedTrack
from possmap.errors import GridError
from possmap.grid.database import Database

_FIELDS = len(RefinedPose._fields)


class Making(NamedTuple):
    """How a refined grid was made.

    made_of : digest of the grid that it was made of.
    robots : whose tracks were to be moved, sorted; none: all.
    """

    made_of: str
    robots: tuple[str, ...] = ()


class RefinedTracks:
    """What ``possmap refine`` adds to one grid file; nothing in any other."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def making(self) -> Making | None:
        """Return how the grid was refined; None: it was not."""
        if not self._database.is_refined():
            return None
        made_of, robots = self._database.one("SELECT made_of, robots FROM refinement") or ("", "")
        try:
            return Making(made_of, tuple(json.loads(robots)))
        except (ValueError, TypeError, RecursionError) as error:
            raise self._database.damaged(f"how it was refined: {error}") from error

    def prepare(self, making: Making) -> None:
        """Say that a new grid is refined, inside the transaction that makes it."""
        self._database.create_refined()
        values = making.made_of, json.dumps(making.robots)
        self._database.execute("INSERT INTO refinement VALUES (?, ?)", values)

    def add(self, name: tuple[str, str], track: RefinedTrack) -> None:
        """Keep the track of an excursion that the ledger knows."""
        self._database.execute(
            "INSERT INTO refined SELECT id, ? FROM excursion WHERE robot = ? AND name = ?",
            (as_bytes(track), *name),
        )

    def track(self, identity: int) -> RefinedTrack | None:
        """Return the track of an excursion by its id in the ledger; None: it was not moved.

        Raises
        ------
        GridError
            If it is none.
        """
        if not self._database.is_refined():
            return None
        row = self._database.one("SELECT track FROM refined WHERE excursion = ?", (identity,))
        if row is None:
            return None
        try:
            rows = np.frombuffer(row[0], "<f8").reshape(-1, _FIELDS)
        except ValueError as error:
            raise self._damaged(identity) from error
        if not (np.isfinite(rows).all() and (rows[:, 2:4] >= 0).all() and len(rows)):
            raise self._damaged(identity)
        return [RefinedPose(*values) for values in rows.tolist()]

    def _damaged(self, identity: int) -> GridError:
        return self._database.damaged(f"excursion number {identity}: its refined track")

    def parts(self) -> Iterable[bytes]:
        """Yield what of them belongs to a grid's digest, in canonical order; nothing if none."""
        making = self.making()
        if making is None:
            return
        yield b"\nrefined of " + json.dumps(making).encode()
        for robot, name, track in self._database.all(
            "SELECT robot, name, track FROM refined JOIN excursion ON id = excursion"
            " ORDER BY robot, name"
        ):
            yield f"\n{robot} {name}\n".encode() + hashlib.sha256(track).digest()


def as_bytes(track: RefinedTrack) -> bytes:
    """Return a track as a grid keeps it."""
    return np.array(track, dtype="<f8").tobytes()
