"""``possmap repair``: a new grid file from the ledger of one that is damaged (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from possmap.atomic import check_output, name_beside
from possmap.budget import Budget
from possmap.errors import GridError, printable
from possmap.fusing.crew import local
from possmap.fusing.judge import Known
from possmap.fusing.workers import gathered
from possmap.grid.arrivals import Event
from possmap.grid.claims import forgotten_faults
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.soundness import title
from possmap.logs import Parcel
from possmap.progress import Progress, quiet

BESIDE = ("-journal", "-wal", "-shm")
"""What the names of the files end with that SQLite may keep beside a database."""


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was saved.

    excursions, records, tiles : what the new file holds.
    lost : why an excursion could not be saved, or is in doubt, one line each.
    digest : of the new file.
    same : whether the damaged file has, or had, the same digest.
    """

    grid: Path
    excursions: int
    records: int
    tiles: int
    lost: tuple[str, ...]
    digest: str
    same: bool


def repair(
    path: Path,
    output: Path,
    *,
    overwrite: bool = False,
    budget: Budget | None = None,
    progress: Progress = quiet,
) -> Repaired:
    """Write a new grid with every sound excursion of a ledger, and the tiles that they make.

    Parameters
    ----------
    path
        The damaged file; it is not changed.
    output
        The new one; it appears when it is whole.

    Raises
    ------
    GridError
        If the file cannot be opened, or neither its settings nor its ledger can be read.
    OutputError
        If ``output`` exists and ``overwrite`` is off, or cannot be written.
    """
    check_output(output, overwrite)
    target = output.resolve()
    if target == path.resolve():
        raise GridError(f"{printable(str(path))}: would replace itself, expected another -o")
    for end in BESIDE:  # SQLite would take its pages into the new file
        if target.with_name(target.name + end).exists():
            left = output.with_name(output.name + end)
            raise GridError(
                f"{printable(str(left))}: belongs to a writer that was interrupted, or "
                "still writes; remove it if the grid that it belonged to may go"
            )
    beside = name_beside(target)
    try:
        with Grid(path, budget=budget) as old, old.snapshot():
            saved = _Saved(old)
            with Grid(beside, write=True, budget=budget) as new:
                saved.into(new, budget or Budget(), progress)
                made = Repaired(
                    output, saved.excursions, saved.records, new.tiles.directory.count(),
                    tuple(saved.lost), new.digest(), _had(old, new.digest()),
                )  # fmt: skip
        beside.replace(target)
        return made
    except BaseException:
        for left in (beside, *(beside.with_name(beside.name + end) for end in BESIDE)):
            left.unlink(missing_ok=True)
        raise


def _had(old: Grid, digest: str) -> bool:
    try:
        return old.digest() == digest
    except GridError:
        return False


class _Saved:
    """Goes through a damaged ledger, and counts what could be saved."""

    def __init__(self, old: Grid) -> None:
        self._old = old
        self.excursions = self.records = 0
        self.lost: list[str] = []

    def into(self, new: Grid, budget: Budget, progress: Progress) -> None:
        """Write what is sound into a new grid, a few excursions in each transaction."""
        settings = self._old.settings
        identities = progress(self._old.ledger.identities(), "excursion")
        batches = gathered(
            self._sound(identities), lambda one: one[0].records, budget.batch_records
        )
        with new.transaction():
            new.prepare(settings, self._old.robots)
        names: set[tuple[str, str]] = set()
        with local(1, budget) as crew:
            for batch in batches:
                names |= {entry.name for entry, _ in batch}
                known = [Known(parcel, entry.model, 0) for entry, parcel in batch]
                with new.transaction():
                    work = crew.batch(known, settings, new.tiles)
                    for rows in work.rows():
                        new.ledger.add(rows)
                    for key, layers in work.tiles()[1]:
                        new.tiles.put(key, layers)
        with new.transaction():
            self._arrivals_into(new, names)

    def _sound(self, identities: Iterable[int]) -> Iterator[tuple[Entry, Parcel]]:
        """Yield the excursions in which nothing is wrong, and note what is with the others."""
        soundness = self._old.soundness
        claims = soundness.claims
        settings, robots = self._old.settings, self._old.robots
        for identity in identities:
            faults = list(soundness.excursion(identity))
            entry = None if faults else self._old.ledger.entry_of(identity)
            if entry is not None:
                own = claims.own_model(entry, settings)
                faults += [f"{title(entry)}: {fault}" for fault in own]
            self.lost += faults
            if entry is None or faults:
                continue
            doubts = claims.model(entry, settings, robots)
            self.lost += [f"{title(entry)}: in doubt: {doubt}" for doubt in doubts]
            self.excursions += 1
            self.records += entry.records
            yield entry, Parcel(self._old.ledger.version(entry))

    def _events(self, names: set[tuple[str, str]]) -> list[Event]:
        """Return all that came of what was saved, in its order."""
        came = self._old.ledger.came
        try:
            return [one for one in came.events() if one.name in names]
        except GridError:  # of an excursion that is lost: ask for the others one by one
            found = [one for name in sorted(names) for one in came.events(name)]
            return sorted(found, key=lambda one: one.source)

    def _arrivals_into(self, new: Grid, names: set[tuple[str, str]]) -> None:
        """Copy what came by which file, in its order, and what was forgotten."""

        def source(event: Event) -> tuple[int, str, str]:
            return event.source, event.fused_at, event.version

        for (_, fused_at, version), some in groupby(self._events(names), key=source):
            new.ledger.came.add([(one.name, one.what) for one in some], fused_at, version)
        seen: set[tuple[str | None, ...]] = set()
        for forgotten in self._old.ledger.forgotten.all():
            faults = list(forgotten_faults(forgotten))
            self.lost += faults
            key = forgotten.robot, forgotten.excursion, forgotten.sha256
            if not faults and key not in seen:
                new.ledger.forgotten.add(forgotten)
            seen.add(key)
