"""``possmap forget``: evidence taken out of a grid as if it had never come (docs/trust.md)."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

from possmap.budget import Budget
from possmap.errors import GridError, did_you_mean, printable
from possmap.fusing.withdraw import Loss, withdraw
from possmap.grid.arrivals import replayed
from possmap.grid.database import check_file
from possmap.grid.forgotten import SHORT, Forgotten
from possmap.grid.grid import Grid
from possmap.grid.ledger import Ledger
from possmap.grid.opening import EMPTY
from possmap.progress import Progress, quiet
from possmap.release import version

MOST_NAMED = 20
"""Of what a message lists; more of it would be no line that anybody reads."""

MOST_GUESSED = 5000
"""Names among which the nearest to one is looked for: each may take a millisecond."""

_SHA256 = re.compile("[0-9a-f]{8,64}")
"""What may be the beginning of a hash."""


@dataclass(frozen=True, slots=True)
class Target:
    """What to forget: a robot, or one excursion of it, or what a file brought.

    brought_by : how the file's SHA-256 begins, or its name in the ledger, or how that ends, or a
        file of the same bytes.
    """

    robot: str | None = None
    excursion: str | None = None
    brought_by: str | None = None

    def __post_init__(self) -> None:
        if (self.robot is None) == (self.brought_by is None):
            raise ValueError("expected either a robot or a file")
        if self.excursion is not None and self.robot is None:
            raise ValueError("expected the robot of the excursion")


@dataclass(frozen=True, slots=True)
class Gone:
    """What an excursion lost.

    lost, kept : records that went, and that stay, since others brought them too.
    vanished : whether the grid knows nothing of it any more.
    """

    robot: str
    excursion: str
    lost: int
    kept: int
    vanished: bool


@dataclass(frozen=True, slots=True)
class ForgetSummary:
    """What was forgotten.

    what : the note that the grid keeps of it, unless only ``once``.
    is_new : whether it was not forgotten before.
    once : whether it may come again.
    excursions : what each lost.
    tiles : how many changed.
    digest : of the grid without it.
    """

    grid: Path
    what: Forgotten
    is_new: bool
    once: bool
    excursions: tuple[Gone, ...]
    tiles: int
    digest: str

    @property
    def records(self) -> int:
        """How many were taken out."""
        return sum(one.lost for one in self.excursions)


def forget(
    path: Path,
    target: Target,
    *,
    once: bool = False,
    budget: Budget | None = None,
    progress: Progress = quiet,
) -> ForgetSummary:
    """Take evidence out of a grid, in one transaction, and remember not to let it in again.

    Parameters
    ----------
    once
        Do not remember: it may come again.

    Raises
    ------
    GridError
        If the file cannot be used, or knows nothing of the target, or several files of its name.
    """
    budget = budget or Budget()
    with _changing(path, budget) as grid:
        ledger, forgotten = grid.ledger, grid.ledger.forgotten.all()
        files = [*_files(forgotten), *((name, sha256) for name, sha256, _ in ledger.came.sources())]
        what = _named(path, target, files, "brought nothing to this grid")
        known = _same(forgotten, what)
        grid.upgrade()  # first of all: format 1 has no index of what brought an excursion
        losses = list(_losses(ledger, what))
        if known is None and not losses:
            raise _unknown(path, what, [entry.name for entry in ledger.entries()], forgotten)
        tiles = withdraw(grid, losses, budget, progress)
        gone = tuple(
            Gone(*loss.entry.name, loss.lost, loss.kept, not loss.left)
            for loss in losses
            if loss.lost or not loss.left
        )
        noted = known
        if noted is None:
            noted = replace(
                what,
                excursions=len(gone),
                records=sum(one.lost for one in gone),
                forgotten_at=datetime.now(UTC).isoformat(timespec="seconds"),
                version=version(),
            )
            if not once:
                ledger.forgotten.add(noted)
        return ForgetSummary(path, noted, known is None, once, gone, tiles, grid.digest())


def recall(path: Path, target: Target) -> Forgotten:
    """Let in again what was forgotten. Nothing comes back by itself: logs must be fused again.

    Raises
    ------
    GridError
        If the file cannot be used, or the target is not forgotten.
    """
    with _changing(path, Budget()) as grid:
        forgotten = grid.ledger.forgotten.all()
        what = _named(path, target, _files(forgotten), "is not forgotten")
        known = _same(forgotten, what)
        if known is None:
            titles = _listed([one.title for one in forgotten]) or "nothing"
            raise GridError(
                f"{printable(str(path))}: {what.title} is not forgotten; forgotten: {titles}"
            )
        grid.ledger.forgotten.remove(known)
        return known


@contextmanager
def _changing(path: Path, budget: Budget) -> Iterator[Grid]:
    """Open a grid that exists, and change it in one transaction."""
    check_file(path, write=False)
    with Grid(path, write=True, budget=budget) as grid:
        if grid.is_new:
            raise GridError(f"{printable(str(path))}: {EMPTY}")
        with grid.transaction():
            yield grid


def _files(forgotten: Sequence[Forgotten]) -> list[tuple[str, str]]:
    return [(one.source or "", one.sha256) for one in forgotten if one.sha256 is not None]


def _named(
    path: Path, target: Target, files: Iterable[tuple[str, str]], otherwise: str
) -> Forgotten:
    """Return the target as it will be noted.

    files : names and hashes among which to look for a file; otherwise : what is said of others.
    """
    source = sha256 = None
    if target.brought_by is not None:
        source, sha256 = _file(path, target.brought_by, dict.fromkeys(files), otherwise)
    return Forgotten(target.robot, target.excursion, source, sha256, 0, 0, "", "")


def _file(
    path: Path, given: str, files: Iterable[tuple[str, str]], otherwise: str
) -> tuple[str, str]:
    """Return name and hash of the one file that is meant."""
    files = list(files)
    found = (
        # Hashes first: anybody may name his file like the hash of another.
        [one for one in files if _SHA256.fullmatch(given) and one[1].startswith(given)]
        or [one for one in files if one[0] == given]
        or [one for one in files if one[0].endswith(f"/{given}")]
        or _of_same_bytes(files, Path(given))
    )
    alike = {sha256: name for name, sha256 in found}
    place, shown = printable(str(path)), printable(given)
    if not alike:
        guess = _guess(given, (name for name, _ in files))
        raise GridError(f"{place}: a file {shown} {otherwise}{printable(guess)}")
    if len(alike) > 1:
        which = _listed([f"{sha256[:SHORT]} ({printable(alike[sha256])})" for sha256 in alike])
        raise GridError(
            f"{place}: {len(alike)} files are named {shown}, expected one, "
            f"or how its SHA-256 begins: {which}"
        )
    return found[0]


def _of_same_bytes(files: Iterable[tuple[str, str]], path: Path) -> list[tuple[str, str]]:
    """Return files whose bytes are those of one that is at hand, whatever their names."""
    try:
        if not path.is_file():
            return []
        with path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return []
    return [one for one in files if one[1] == sha256]


def _same(forgotten: Iterable[Forgotten], what: Forgotten) -> Forgotten | None:
    for one in forgotten:
        if (one.robot, one.excursion, one.sha256) == (what.robot, what.excursion, what.sha256):
            return one
    return None


def _losses(ledger: Ledger, what: Forgotten) -> Iterator[Loss]:
    """Yield what each excursion loses."""
    if what.sha256 is None:
        for entry in ledger.entries():
            if what.bars(entry.name, ""):
                yield Loss(entry)
        return
    for identity in ledger.came.brought_by(what.sha256):
        known = ledger.entry_of(identity)
        if known is not None:
            others = (
                event
                for event in ledger.came.events(known.name)
                if event.what.origin.sha256 != what.sha256
            )
            yield Loss(known, tuple(replayed(others)))


def _unknown(
    path: Path, what: Forgotten, names: Sequence[tuple[str, str]], forgotten: Sequence[Forgotten]
) -> GridError:
    """Return the error that says that there is nothing to forget."""
    place, robot = printable(str(path)), what.robot or ""
    of_robot = [excursion for one, excursion in names if one == robot]
    if what.excursion is None or of_robot:
        missing = what.title
    else:
        missing = replace(what, excursion=None).title
    for one in forgotten:
        if one.robot == what.robot and (what.excursion is None or one.excursion is None):
            since = printable(one.forgotten_at)
            return GridError(f"{place}: knows no {missing}; {one.title} is forgotten since {since}")
    if what.excursion is not None and of_robot:
        guess = _guess(what.excursion, of_robot)
    else:
        guess = _guess(robot, (one for one, _ in names))
    return GridError(f"{place}: knows no {missing}{printable(guess)}")


def _guess(word: str, known: Iterable[str]) -> str:
    return did_you_mean(word, islice(dict.fromkeys(known), MOST_GUESSED))


def _listed(words: Sequence[str]) -> str:
    more = len(words) - MOST_NAMED
    return ", ".join(words[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
