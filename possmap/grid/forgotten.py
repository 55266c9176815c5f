"""What was taken out of a grid, and is not let in until somebody says so (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from possmap.errors import brief
from possmap.grid.checks import check_counts, check_types
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

    robot: str | None
    excursion: str | None
    source: str | None
    sha256: str | None
    excursions: int
    records: int
    forgotten_at: str
    version: str

    def bars(self, name: tuple[str, str], sha256: str) -> bool:
        """Whether it keeps out what a file of that hash says of that robot and excursion."""
        if self.robot is None:
            return sha256 == self.sha256
        return name[0] == self.robot and self.excursion in (None, name[1])

    @property
    def title(self) -> str:
        """What was forgotten, for messages."""
        if self.robot is None:
            return f"what {brief(self.source or '')} brought"
        if self.excursion is None:
            return f"robot {brief(self.robot)}"
        return f"excursion {brief(self.excursion)} of robot {brief(self.robot)}"


class Bans:
    """Looks up what keeps something out, however much was forgotten.

    forgotten : in order; of several that would do, the first is found.
    """

    def __init__(self, forgotten: Sequence[Forgotten]) -> None:
        self._forgotten = forgotten
        self._robots: dict[tuple[str, str | None], int] = {}
        self._files: dict[str, int] = {}
        for place, one in enumerate(forgotten):
            if one.robot is not None:
                self._robots.setdefault((one.robot, one.excursion), place)
            elif one.sha256 is not None:
                self._files.setdefault(one.sha256, place)

    def on(self, name: tuple[str, str], sha256: str) -> Forgotten | None:
        """Return what keeps out what a file of that hash says of that robot and excursion."""
        robot, excursion = name
        found = (
            self._robots.get((robot, None)),
            self._robots.get((robot, excursion)),
            self._files.get(sha256),
        )
        first = min((place for place in found if place is not None), default=None)
        return None if first is None else self._forgotten[first]


_COLUMNS = "robot, excursion, source, sha256, excursions, records, forgotten_at, version"


class ForgottenList:
    """What was forgotten in one grid file."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def all(self) -> tuple[Forgotten, ...]:
        """Return all that is forgotten, the first first; a file of format 1 forgot nothing."""
        if self._database.format < 2:
            return ()
        found = []
        for row in self._database.all(f"SELECT {_COLUMNS} FROM forgotten ORDER BY id"):
            with self._database.sound("what was forgotten"):
                one = Forgotten(*row)
                for value in (one.robot, one.excursion, one.source, one.sha256):
                    if value is not None:
                        check_types((value, str))
                check_types((one.forgotten_at, str), (one.version, str))
                check_counts(one.excursions, one.records)
                if (one.robot is None) == (one.sha256 is None):
                    raise ValueError("neither a robot nor a file, or both")
                if one.robot is None and one.excursion is not None:
                    raise ValueError("an excursion of no robot")
                if (one.source is None) != (one.sha256 is None):
                    raise ValueError("a file without its name, or the name of none")
            found.append(one)
        return tuple(found)

    def add(self, one: Forgotten) -> None:
        """Remember something."""
        self._database.execute(
            f"INSERT INTO forgotten ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (
                one.robot, one.excursion, one.source, one.sha256,
                one.excursions, one.records, one.forgotten_at, one.version,
            ),
        )  # fmt: skip

    def remove(self, one: Forgotten) -> None:
        """Let it in again."""
        self._database.execute(
            "DELETE FROM forgotten WHERE robot IS ? AND excursion IS ? AND sha256 IS ?",
            (one.robot, one.excursion, one.sha256),
        )
