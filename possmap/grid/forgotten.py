"""What was taken out of a grid, and is not let in until somebody says so (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

from possmap.errors import brief
from possmap.grid.database import Database

SHORT = 12
"""Digits of a SHA-256 that a message shows; enough to tell any two files apart."""


@dataclass(frozen=True, slots=True)
class Forgotten:
    """A robot, or one excursion of it, or what a file brought.

    Attributes
    ----------
    robot, excursion
        None, None: a file; no excursion: all of the robot's.
    source, sha256
        The file's name, and its hash, by which it is known again; None: a robot.
    excursions, records
        Of how many excursions something was taken out, and how many records in all.
    forgotten_at, version
        When (UTC, ISO 8601), and by which possmap.
    """

    robot: str | None = None
    excursion: str | None = None
    source: str | None = None
    sha256: str | None = None
    excursions: int = 0
    records: int = 0
    forgotten_at: str = ""
    version: str = ""

    @property
    def key(self) -> tuple[str | None, ...]:
        """What tells one from another."""
        return self.robot, self.excursion, self.sha256

    @property
    def title(self) -> str:
        """What was forgotten, for messages."""
        if self.robot is None:
            return f"what {brief(self.source or '')} brought"
        if self.excursion is None:
            return f"robot {brief(self.robot)}"
        return f"excursion {brief(self.excursion)} of robot {brief(self.robot)}"


class Bans:
    """Looks up what keeps something out, however much was forgotten."""

    def __init__(self, forgotten: Sequence[Forgotten]) -> None:
        self._robots = {(one.robot, one.excursion): one for one in reversed(forgotten)}
        self._files = {one.sha256: one for one in reversed(forgotten) if one.robot is None}

    def on(self, name: tuple[str, str], sha256: str) -> Forgotten | None:
        """Return what keeps out what a file of that hash says of that robot and excursion."""
        robot, excursion = name
        return (
            self._robots.get((robot, None))
            or self._robots.get((robot, excursion))
            or self._files.get(sha256)
        )


_COLUMNS = "robot, excursion, source, sha256, excursions, records, forgotten_at, version"


class ForgottenList:
    """What was forgotten in one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def all(self) -> tuple[Forgotten, ...]:
        """Return all that is forgotten, the first first."""
        rows = self._database.all(f"SELECT {_COLUMNS} FROM forgotten ORDER BY id")
        return tuple(Forgotten(*row) for row in rows)

    def add(self, one: Forgotten) -> None:
        """Remember something."""
        marks = ", ".join("?" * len(astuple(one)))
        self._database.execute(f"INSERT INTO forgotten ({_COLUMNS}) VALUES ({marks})", astuple(one))

    def remove(self, one: Forgotten) -> None:
        """Let it in again."""
        self._database.execute(
            "DELETE FROM forgotten WHERE robot IS ? AND excursion IS ? AND sha256 IS ?", one.key
        )
