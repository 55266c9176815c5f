"""Which excursions of a ledger are meant: by time of arrival, by name, by robot."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase

from possmap.errors import GridError, plural, printable
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry


@dataclass(frozen=True, slots=True)
class Selection:
    """Some excursions of a ledger; what is not given leaves nothing out.

    since, until : times between which an excursion first came, both included; a ledger keeps whole
        seconds.
    excursions : what the excursion's name must look like: ``*``, ``?`` and ``[abc]`` stand for any
        text, any letter and one of some.
    robots : names; none: all.
    last : of what the others leave, only so many that came last.
    """

    since: datetime | None = None
    until: datetime | None = None
    excursions: str | None = None
    robots: tuple[str, ...] = ()
    last: int | None = None

    def __bool__(self) -> bool:
        return self != Selection()

    @property
    def title(self) -> str:
        """What is selected, for messages."""
        said = [f"excursions like {printable(self.excursions)}" if self.excursions else "what came"]
        if self.robots:
            said.append(f"of {', '.join(map(printable, self.robots))}")
        if self.since is not None:
            said.append(f"since {_text(self.since)}")
        if self.until is not None:
            said.append(f"until {_text(self.until)}")
        if self.last is not None:
            said.append(f"(the last {self.last})")
        return " ".join(said)

    def entries(self, grid: Grid) -> list[Entry]:
        """Return the selected excursions, in the order in which they first came.

        Raises
        ------
        GridError
            If there is none.
        """
        times = grid.ledger.came.times()
        entries = {entry.identity: entry for entry in grid.ledger.entries()}
        found = [
            entries[identity]
            for identity, came in times.items()
            if identity in entries and self._is_meant(entries[identity], came)
        ]
        found = found if self.last is None else found[-self.last :]
        if not found:
            raise GridError(
                f"{grid.database.name}: {self.title}: none of its "
                f"{plural(len(entries), 'excursion')}; possmap info --excursions lists them"
            )
        return found

    def _is_meant(self, entry: Entry, came: str) -> bool:
        return (
            (not self.robots or entry.robot in self.robots)
            and (self.excursions is None or fnmatchcase(entry.excursion, self.excursions))
            and (self.since is None or came >= _text(self.since))
            and (self.until is None or came <= _text(self.until))
        )


def _text(time: datetime) -> str:
    """Return a time as a ledger writes it, so that texts compare as times do."""
    return time.astimezone(UTC).isoformat(timespec="seconds")
