"""``possmap repair``: a new grid file from the ledger of one that is damaged (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from possmap.app.crew import local
from possmap.app.judge import Known
from possmap.app.progress import Progress, quiet
from possmap.app.workers import gathered
from possmap.errors import GridError, printable
from possmap.files.atomic import check_output, name_beside
from possmap.files.budget import Budget
from possmap.files.gridfile.arrivals import Event
from possmap.files.gridfile.database import journal_of
from possmap.files.gridfile.grid import Grid
from possmap.files.gridfile.ledger import Entry
from possmap.files.logs import Parcel


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was saved.

    excursions, records, tiles : what the new file holds.
    lost : why an excursion could not be saved, one line each.
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
    if journal_of(target).exists():  # it would be rolled back into the new file
        raise GridError(
            f"{printable(str(journal_of(output)))}: belongs to a writer that was interrupted, or "
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
        for left in (beside, journal_of(beside)):
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
        with local(1) as crew:
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
        for identity in identities:
            faults = list(self._old.soundness.excursion(identity))
            entry = None if faults else self._old.ledger.entry_of(identity)
            if entry is None:
                self.lost += faults
                continue
            self.excursions += 1
            self.records += entry.records
            yield entry, Parcel(self._old.ledger.version(entry))

    def _arrivals_into(self, new: Grid, names: set[tuple[str, str]]) -> None:
        """Copy what came by which file, in its order, and what was forgotten."""

        def source(event: Event) -> tuple[int, str, str]:
            return event.source, event.fused_at, event.version

        events = (one for one in self._old.ledger.came.events() if one.name in names)
        for (_, fused_at, version), some in groupby(events, key=source):
            new.ledger.came.add([(one.name, one.what) for one in some], fused_at, version)
        for forgotten in self._old.ledger.forgotten.all():
            new.ledger.forgotten.add(forgotten)
