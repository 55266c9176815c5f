"""``possmap forget``: evidence taken out of a grid as if it had never come (docs/trust.md)."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

from possmap.errors import GridError, did_you_mean, printable
from possmap.fusing.advice import refuse_refined
from possmap.fusing.withdraw import Loss, withdraw
from possmap.grid.forgotten import SHORT, Forgotten
from possmap.grid.grid import Grid
from possmap.grid.ledger import Ledger
from possmap.grid.opening import EMPTY, check_file
from possmap.grid.selection import Selection
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
    """What was forgotten, or with ``dry_run`` would have been.

    title : of it all.
    notes : those that the grid keeps, unless only ``once``: of a selection one for each excursion.
    is_new : whether it was not forgotten before.
    once : whether it may come again.
    excursions : what each lost.
    tiles : how many changed.
    digest : of the grid without it.
    """

    grid: Path
    title: str
    notes: tuple[Forgotten, ...]
    is_new: bool
    once: bool
    dry_run: bool
    excursions: tuple[Gone, ...]
    tiles: int
    digest: str

    @property
    def records(self) -> int:
        """How many were taken out."""
        return sum(one.lost for one in self.excursions)


def forget(
    path: Path,
    target: Target | Selection,
    *,
    once: bool = False,
    dry_run: bool = False,
    progress: Progress = quiet,
) -> ForgetSummary:
    """Take evidence out of a grid, in one transaction, and remember not to let it in again.

    Parameters
    ----------
    once
        Do not remember: it may come again.
    dry_run
        Say what would go, and change nothing.

    Raises
    ------
    GridError
        If the file cannot be used, or knows nothing of the target, or several files of its name.
    """
    with _changing(path, dry_run) as grid:
        ledger, forgotten = grid.ledger, grid.ledger.forgotten.all()
        if isinstance(target, Selection):
            losses = [Loss(entry) for entry in target.entries(grid)]
            wanted, title = [Forgotten(*one.entry.name) for one in losses], target.title
        else:
            files = [*_files(forgotten), *(source[:2] for source in ledger.came.sources())]
            what = _named(path, target, files, "brought nothing to this grid")
            losses, wanted, title = list(_losses(ledger, what)), [what], what.title
        known = {one.key: one for one in forgotten}
        is_new = any(one.key not in known for one in wanted)
        if is_new and not losses:
            names = [entry.name for entry in ledger.entries()]
            raise _unknown(path, wanted[0], names, forgotten)
        tiles = withdraw(grid, losses, progress)
        gone = [
            Gone(*loss.entry.name, loss.lost, loss.kept or 0, loss.kept is None)
            for loss in losses
            if loss.lost or loss.kept is None
        ]
        notes = [known.get(one.key) or _note(one, gone) for one in wanted]
        for one in notes:
            if one.key not in known and not once:
                ledger.forgotten.add(one)
        return ForgetSummary(
            path, title, tuple(notes), is_new, once, dry_run, tuple(gone), tiles, grid.digest()
        )


def _note(what: Forgotten, gone: Sequence[Gone]) -> Forgotten:
    mine = [
        one for one in gone if what.excursion in (None, one.excursion)
        and what.robot in (None, one.robot)
    ]  # fmt: skip
    return replace(
        what,
        excursions=len(mine),
        records=sum(one.lost for one in mine),
        forgotten_at=datetime.now(UTC).isoformat(timespec="seconds"),
        version=version(),
    )


def recall(path: Path, target: Target) -> Forgotten:
    """Let in again what was forgotten. Nothing comes back by itself: logs must be fused again.

    Raises
    ------
    GridError
        If the file cannot be used, or the target is not forgotten.
    """
    with _changing(path) as grid:
        forgotten = grid.ledger.forgotten.all()
        what = _named(path, target, _files(forgotten), "is not forgotten")
        known = {one.key: one for one in forgotten}.get(what.key)
        if known is None:
            titles = _listed([one.title for one in forgotten]) or "nothing"
            raise GridError(
                f"{printable(str(path))}: {what.title} is not forgotten; forgotten: {titles}"
            )
        grid.ledger.forgotten.remove(known)
        return known


class _Undone(Exception):
    """Ends a transaction of which nothing is to be kept."""


@contextmanager
def _changing(path: Path, undone: bool = False) -> Iterator[Grid]:
    """Open a grid that exists, and change it in one transaction; undone : or only seem to."""
    check_file(path, write=False)
    with Grid(path, write=True) as grid:
        if grid.is_new:
            raise GridError(f"{printable(str(path))}: {EMPTY}")
        refuse_refined(grid, "forget it in")
        with suppress(_Undone), grid.transaction():
            yield grid
            if undone:
                raise _Undone


def _files(forgotten: Sequence[Forgotten]) -> list[tuple[str, str]]:
    return [(one.source or "", one.sha256) for one in forgotten if one.sha256 is not None]


def _named(
    path: Path, target: Target, files: Iterable[tuple[str, str]], otherwise: str
) -> Forgotten:
    """Return the target as it will be noted.

    files : names and hashes among which to look for a file; otherwise : what is said of others.
    """
    if target.brought_by is None:
        return Forgotten(target.robot, target.excursion)
    source, sha256 = _file(path, target.brought_by, list(dict.fromkeys(files)), otherwise)
    return Forgotten(source=source, sha256=sha256)


def _file(
    path: Path, given: str, files: Sequence[tuple[str, str]], otherwise: str
) -> tuple[str, str]:
    """Return name and hash of the one file that is meant."""
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


def _losses(ledger: Ledger, what: Forgotten) -> Iterator[Loss]:
    """Yield what each excursion loses."""
    if what.sha256 is None:
        for entry in ledger.entries():
            if entry.robot == what.robot and what.excursion in (None, entry.excursion):
                yield Loss(entry)
        return
    for identity in ledger.came.brought_by(what.sha256):
        known = ledger.entry_of(identity)
        if known is not None:
            came = ledger.came.of(known.name)
            gone = tuple(one for one in came if one.origin.sha256 == what.sha256)
            left = [one.records for one in came if one not in gone]
            yield Loss(known, gone, max(left, default=None))


def _unknown(
    path: Path, what: Forgotten, names: Sequence[tuple[str, str]], forgotten: Sequence[Forgotten]
) -> GridError:
    """Return the error that says that there is nothing to forget."""
    place, robot = printable(str(path)), what.robot or ""
    of_robot = [excursion for one, excursion in names if one == robot]
    is_robot_known = what.excursion is None or of_robot
    missing = what.title if is_robot_known else replace(what, excursion=None).title
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
