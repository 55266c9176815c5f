"""``possmap fuse``: logs into a grid, each record once, whole logs only."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Literal, TypeAlias

from possmap.budget import Budget
from possmap.core.lattice import TileKey
from possmap.core.model import FRAME
from possmap.core.plan import TileWork, by_tile
from possmap.core.settings import EvidenceSettings
from possmap.errors import LogError, SettingsError, TileError, WorkerError, printable
from possmap.fusing import reading
from possmap.fusing.advice import refuse_refined, word
from possmap.fusing.executors import SERIAL, Hands, hands
from possmap.fusing.joining import Joining
from possmap.fusing.layout import LaidOut, StoredTile, Version, lay_out, stamp
from possmap.fusing.reach import Reach
from possmap.fusing.reading import How, Read
from possmap.fusing.withdraw import Loss, withdraw
from possmap.grid.arrivals import Arrival
from possmap.grid.grid import Grid
from possmap.grid.opening import check_file
from possmap.grid.tiles import MOST_COUNTED, Undecided
from possmap.progress import Progress, quiet
from possmap.release import version
from possmap.settings.request import Request, in_force
from possmap.settings.setting_table import ROBOT, GivenSettings
from possmap.settings.settings import Settings

log = logging.getLogger(__name__)

DEFAULT_MIB = 4096
"""Enough for the largest log that the limits let in."""

READ_AT_ONCE = 2**18
"""Bytes of logs that are worth sending to a worker."""

Status: TypeAlias = Literal["fused", "known", "refused"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one log.

    error : why it was refused.
    note : what the user should know of a log that was not.
    """

    path: str
    status: Status
    records_new: int = 0
    records_known: int = 0
    error: str | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True)
class FuseSummary:
    """What a run of ``fuse`` did, or with ``dry_run`` would have done.

    reach : of the excursions that grew, by robot and excursion: how much they can say.
    undecided : of the tiles that they touched, the cells known and contested; None of too many.
    seconds : by the clock on the wall.
    """

    grid: Path
    logs: tuple[Outcome, ...]
    reach: dict[tuple[str, str], Reach]
    undecided: Undecided | None
    seconds: float

    @property
    def records_new(self) -> int:
        """Records that the grid did not hold before."""
        return sum(log.records_new for log in self.logs)

    @property
    def records_known(self) -> int:
        """Records that it held already."""
        return sum(log.records_known for log in self.logs)

    def count(self, status: Status) -> int:
        """Return how many logs ended so."""
        return sum(log.status == status for log in self.logs)


def fuse(
    logs: Sequence[str],
    grid: Path,
    request: Request | None = None,
    *,
    strict: bool = False,
    dry_run: bool = False,
    allow_truncated: bool = False,
    recursive: bool = False,
    jobs: int = 1,
    dask: str | None = None,
    budget: Budget | None = None,
    progress: Progress = quiet,
) -> FuseSummary:
    """Fuse logs into a grid file, creating it if need be.

    Parameters
    ----------
    logs
        Files, folders, URLs, ``-`` for JSON Lines on stdin, or other grids, whose ledgers are
        fused.
    grid
        The grid file.
    request
        Settings; those of a known grid hold unless given, and must not differ.
    strict
        The first refused log ends the run, and nothing of it is kept.
    dry_run
        Read and judge only; nothing is written.
    allow_truncated
        Use JSON Lines whose last line was cut short, without that line.
    recursive
        Take the logs of folders within folders, too.
    jobs
        Processes that read, lay out and stamp.
    dask
        The cluster that does so instead: ``tcp://host:port``, or ``local`` or ``local:N``.
    budget
        Memory that this process, and each of ``jobs``, may take.

    Raises
    ------
    SettingsError
        If a given setting is wrong, or differs from the grid's.
    GridError
        If the grid cannot be used. Whole logs fused before that stay.
    BudgetError
        If ``strict`` would hold more than fits.
    WorkerError
        If processes or the cluster fail, or memory does not suffice. Whole logs fused before that
        stay.
    MissingExtra
        For a cluster or a URL, if the extra ``cluster`` is not installed.
    """
    start = time.perf_counter()
    budget, given = budget or Budget(DEFAULT_MIB), (request or Request()).given()
    outcomes: list[Outcome] = []
    reach: dict[tuple[str, str], Reach] = {}
    touched: set[TileKey] = set()
    with _enough_memory(), ExitStack() as stack:
        # For writing, though nothing may be: what an interrupted run left may hold nothing yet.
        open_site = partial(Grid, grid, write=True, budget=budget)
        site = stack.enter_context(open_site()) if check_file(grid, write=True) else None
        known = None if site is None or site.is_new else site
        if known is not None:
            refuse_refined(known, "fuse further logs into")
            _check_places(given, known)
        settings = in_force(given, known.stored_settings() if known else None, grid)
        names = progress(list(reading.expand(logs, recursive)), "log")
        workers = stack.enter_context(hands(jobs, dask, budget))
        reads = _read(names, How(settings, allow_truncated, budget, workers.folder), workers)
        rehearsal = Joining(settings, known.ledger if known else None, grid, strict)
        # A transaction holds some logs; with --strict all, so that the last can undo the first.
        most = min(settings.limits.transaction_records, budget.batch_records)
        for batch in _batches(reads, None if strict else most, budget):
            if dry_run or site is None:
                joining, done = rehearsal, _joined(rehearsal, batch, workers)
            if not dry_run and (site is not None or rehearsal.laid_out):
                site = site or stack.enter_context(open_site())  # no grid is made for nothing
                rehearsal.undo()
                with site.transaction():
                    # Looked up inside, so that nobody else can add or place anything in between.
                    if not site.is_new:
                        _check_places(given, site)
                    joining, done = _added(batch, site, settings, strict, workers, progress)
            for outcome in done:
                log.info("%s: %s", outcome.path, outcome.status)
            outcomes += done
            reach |= {name: one.reach for name, one in joining.laid_out.items()}
            touched.update(key for one in joining.laid_out.values() for key in one.plan.tiles)
            joining.let_go()
        undecided = None
        if site is not None and touched and not dry_run and len(touched) <= MOST_COUNTED:
            undecided = site.tiles.undecided(touched)
    return FuseSummary(grid, tuple(outcomes), reach, undecided, time.perf_counter() - start)


def _check_places(given: GivenSettings, site: Grid) -> None:
    """Refuse to place a robot elsewhere than where what is known of it was placed."""
    for name, (value, origin) in given.items():
        robot, _, parameter = name.removeprefix(ROBOT).rpartition(".")
        if not name.startswith(ROBOT) or parameter not in FRAME:
            continue
        entry = site.ledger.first_of(robot)
        was = value if entry is None else getattr(entry.model, parameter)
        if value != was:
            path = str(site.path)
            raise SettingsError(
                f"{origin}: {name}, found {value:g}, but in {printable(path)} robot {robot} was "
                f"placed with {was:g}; to lay its logs anew: possmap fuse {word(path)} "
                "-g NEW.possmap with this --place, and those of other robots"
            )


@contextmanager
def _enough_memory() -> Iterator[None]:
    try:
        yield
    except MemoryError as error:
        raise WorkerError(
            "there is not enough memory; the grid holds whole logs only, and the same command "
            "completes the job where there is more"
        ) from error


def _read(names: Iterable[str], how: How, workers: Hands) -> Iterator[Read]:
    """Read logs in the order given; others than this process lay out at once what is in them."""
    # Stdin is nobody's but this process's, and a grid may lie where no worker sees it.
    for is_here, some in groupby(names, key=lambda name: name == "-" or reading.is_grid(name)):
        own = is_here or not workers.are_others
        tasks = ((chunk, how, not own) for chunk in _chunks(some))
        for reads in (SERIAL if own else workers).map(reading.read_logs, tasks, _read_bytes):
            yield from reads


def _chunks(names: Iterable[str]) -> Iterator[list[str]]:
    """Gather names of files that are worth sending to a worker together."""
    chunk: list[str] = []
    size = 0
    for name in names:
        its_size = reading.text_of(name)
        if chunk and size + its_size > READ_AT_ONCE:
            yield chunk
            chunk, size = [], 0
        chunk.append(name)
        size += its_size
    if chunk:
        yield chunk


def _read_bytes(names: Sequence[str], *_: object) -> int:
    return 6 * sum(map(reading.text_of, names))  # measured, as read and laid out


def _batches(reads: Iterable[Read], most: int | None, budget: Budget) -> Iterator[list[Read]]:
    """Gather files until they hold ``most`` records: what is in memory, and in one transaction."""
    batch: list[Read] = []
    records = 0
    for one in reads:
        batch.append(one)
        if one.log is not None:
            # A ledger's versions of one excursion share its records.
            wholes = {id(one.whole): one.whole for one in one.log.deliveries}
            records += sum(len(whole.records) for whole in wholes.values())
        if most is None:
            budget.check_together(records)
        elif records >= most:
            yield batch
            batch, records = [], 0
    if batch:
        yield batch


def _added(
    batch: list[Read],
    site: Grid,
    settings: Settings,
    strict: bool,
    workers: Hands,
    progress: Progress,
) -> tuple[Joining, list[Outcome]]:
    """Add what is new in a batch to the grid, inside a transaction."""
    joining = Joining(settings, None if site.is_new else site.ledger, site.path, strict)
    outcomes = _joined(joining, batch, workers)
    if any(outcome.status != "refused" for outcome in outcomes):
        site.prepare(settings.evidence, settings.robots)
    _write(joining, site, settings.evidence, workers, progress)
    return joining, outcomes


def _joined(joining: Joining, batch: list[Read], workers: Hands) -> list[Outcome]:
    """Join logs in the order given; with ``strict`` the first refused one undoes the others."""
    outcomes: list[Outcome] = []
    for one in batch:
        outcomes.append(_outcome(joining, one, workers))
        if joining.strict and outcomes[-1].status == "refused":
            joining.undo()
            undone = f"not kept, since {printable(one.path)} was refused (--strict)"
            return [
                outcomes[-1]
                if other is one
                else Outcome(other.path, "refused", error=f"{printable(other.path)}: {undone}")
                for other in batch
            ]
    return outcomes


def _outcome(joining: Joining, one: Read, workers: Hands) -> Outcome:
    if one.log is None:
        return Outcome(one.path, "refused", error=one.error)
    try:
        joined = joining.join(one.log, partial(_laid_out, one, joining.settings, workers))
    except LogError as error:
        return Outcome(one.path, "refused", error=str(error))
    cut = one.log.cut_short
    notes = [f"{cut}: the last line is cut short and was left out"] if cut else []
    notes += [joined.note] if joined.note else []
    return Outcome(
        one.path,
        "fused" if joined.is_new else "known",
        joined.records_new,
        joined.records_known,
        note="; ".join(notes) or None,
    )


def _laid_out(
    read: Read, settings: Settings, workers: Hands, versions: Sequence[Version]
) -> Iterator[LaidOut]:
    """Yield versions laid out: as they were when they were read or rehearsed, or now."""
    ready = [read.laid_out_of(one) for one in versions]
    missing = [one for one, done in zip(versions, ready, strict=True) if done is None]
    # Where many wait to be read, one would wait long; of a ledger there are many.
    several = workers if read.log is not None and read.log.is_ledger else SERIAL
    tasks = ((one, settings.evidence, settings.limits) for one in missing)
    made = several.map(lay_out, tasks, lambda one, *_: 1000 * len(one.map.records))
    for one, done in zip(versions, ready, strict=True):
        if done is None:
            done = next(made)
            read.laid_out.append((one, done))
        yield done


def _write(
    joining: Joining,
    grid: Grid,
    settings: EvidenceSettings,
    workers: Hands,
    progress: Progress,
) -> None:
    """Add what grew to the ledger, and stamp it, tile by tile."""
    grown = joining.laid_out.values()
    old = [grid.ledger.entry(name) for name, one in joining.laid_out.items() if one.restamps]
    withdraw(grid, [Loss(entry, kept=0) for entry in old if entry is not None], progress)
    for one in grown:
        grid.ledger.add(one.rows)
    count, works = by_tile([one.plan for one in grown])
    tasks = ((work, grid.tiles.packed(work.key), settings) for work in works)
    try:
        stamped = workers.map(stamp, tasks, _task_bytes)
        for key, layers in progress(stamped, "tile", count):
            grid.tiles.put(key, layers)
    except TileError as error:
        raise grid.tiles.damaged(str(error)) from error
    came = (Arrival(one.name, one.count, one.origin, one.carrier) for one in joining.came)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    grid.ledger.came.add(came, now, version())
    log.info("%d excursions stamped into %d tiles", len(grown), count)


def _task_bytes(work: TileWork, stored: StoredTile, *_: object) -> int:
    """Return what is held until a tile is stamped, which is more than what comes back."""
    pieces = sum(rows.nbytes for rows in work.pieces.values())
    packed = sum(len(layer.data) for layer in stored.values())
    return work.segments.nbytes + pieces + 100 * len(work.clips) + packed
