"""What must hold of a grid after anything whatever went wrong."""

from __future__ import annotations

import shutil
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from crash.batches import Batch, journal, sources
from crash.child import Ended, run

from possmap.errors import PossmapError
from possmap.grid.database import Database
from possmap.grid.verify import verify


class Broken(AssertionError):
    """Something that was promised does not hold."""


class Lost(Broken):
    """A sound grid that lacks what was reported as fused."""


class Unnoticed(Broken):
    """A grid that ``possmap verify`` calls sound, and that is none of those that may be there."""


@dataclass
class Tally:
    """What was tried, and what came of it.

    counts : what was hit, by what.
    broken : one line for each time that something promised did not hold.
    """

    tried: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)

    @contextmanager
    def trying(self, what: str) -> Iterator[None]:
        """Count a trial, and note if it breaks a promise."""
        self.tried += 1
        with self.completing(what):
            yield

    @contextmanager
    def completing(self, what: str) -> Iterator[None]:
        """Note if what follows a trial breaks a promise."""
        try:
            yield
        except (AssertionError, PossmapError, sqlite3.Error, OSError) as error:
            self.broken.append(f"{what}: {type(error).__name__}: {error}")


def promise(holds: bool, what: str) -> None:
    """Raise Broken unless it holds."""
    if not holds:
        raise Broken(what)


def whole_logs(grid: Path, batch: Batch, least: int = 0) -> int:
    """Return how many whole logs a grid holds beyond those of before.

    It looks at a copy: whoever opens the grid itself restores it, and that is what the same
    command must be able to do.

    Parameters
    ----------
    least
        How many it must hold, since that was reported.

    Raises
    ------
    Broken
        If it holds anything else than the first few of the logs, each whole.
    """
    copy = batch.folder / "copy.possmap"
    for source, target in ((grid, copy), (journal(grid), journal(copy))):
        target.unlink(missing_ok=True)
        if source.exists():
            shutil.copy(source, target)
    claimed = _claimed(copy, batch)
    if len(claimed) < least:
        raise Lost(f"{least} logs were reported as fused, {len(claimed)} are there")
    return len(claimed)


def _claimed(grid: Path, batch: Batch) -> list[str]:
    if not grid.exists() or _is_blank(grid):
        promise(batch.base is None, "the known grid is gone")
        return []
    verdict = verify(grid, full=True)
    promise(verdict.is_sound, f"verify: {verdict.faults[:3]}")
    with closing(sqlite3.connect(grid)) as connection:
        found = connection.execute("PRAGMA integrity_check").fetchall()
    promise(found == [("ok",)], f"integrity_check: {found[:3]}")
    known = set() if batch.base is None else set(sources(batch.base))
    claimed = [name for name in sources(grid) if name not in known]
    if claimed != batch.order[: len(claimed)]:
        raise Unnoticed("the logs are not the first ones")
    if verdict.digest != batch.digest_of(claimed):
        raise Unnoticed("the digest is not that of its logs")
    return claimed


def _is_blank(grid: Path) -> bool:
    """Whether nothing was ever committed to it."""
    database = Database(grid, write=True)
    try:
        return database.is_new()
    finally:
        database.close()


def completes(grid: Path, batch: Batch, jobs: int = 1) -> Ended:
    """Give the same command again, and return how it ended.

    Raises
    ------
    Broken
        If that does not make the grid what it would be if nothing had gone wrong.
    """
    ended = run(batch.command(grid, jobs), grid)
    promise(ended.code == 0 and not ended.stderr, f"the same command again: {ended.stderr}")
    promise(whole_logs(grid, batch) == len(batch.order), "logs are missing in the end")
    with_all = batch.digest_of(batch.order)
    promise(with_all == batch.digest, "the digest in the end is not the undisturbed one")
    promise(not journal(grid).exists(), "a journal stays in the end")
    return ended
