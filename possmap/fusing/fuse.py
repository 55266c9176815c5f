"""``possmap fuse``: logs into a grid, each record once, whole logs only."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, TypeAlias

from possmap.budget import Budget
from possmap.errors import LogError, WorkerError, printable
from possmap.fusing import crew, inputs
from possmap.fusing.crew import Crew
from possmap.fusing.judge import Judge
from possmap.fusing.stages import Read, ReadTask
from possmap.grid.grid import Grid
from possmap.grid.opening import check_file
from possmap.progress import Progress, quiet
from possmap.release import version
from possmap.settings.request import Request, in_force
from possmap.settings.settings import Settings

log = logging.getLogger(__name__)

DEFAULT_MIB = 4096
"""Enough for the largest log that the limits let in."""

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

    seconds : by the clock on the wall.
    """

    grid: Path
    logs: tuple[Outcome, ...]
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
    budget = budget or Budget(DEFAULT_MIB)
    given = (request or Request()).given()
    stored = None
    if _holds_anything(grid):
        # For writing, though nothing is: what an interrupted run left may hold nothing yet.
        with Grid(grid, write=True) as known:
            stored = None if known.is_new else known.stored_settings()
    settings = in_force(given, stored, grid)
    names = progress(list(inputs.expand(logs)), "log")
    outcomes: list[Outcome] = []
    with _enough_memory(), _crew(jobs, dask, budget) as hands:
        foresee = settings if hands.foresees and not dry_run else None
        how = ReadTask((), settings.limits, allow_truncated, budget, foresee)
        reading = hands.read(names, how)
        if dry_run:
            outcomes += _rehearse(reading, grid, settings, strict)
        else:
            # With --strict all is one transaction, so that the last log can still undo the first.
            most = min(settings.limits.transaction_records, budget.batch_records)
            for batch in _batches(reading, None if strict else most, budget):
                outcomes += _commit(batch, grid, settings, strict, hands, budget, progress)
    return FuseSummary(grid, tuple(outcomes), time.perf_counter() - start)


def _holds_anything(grid: Path) -> bool:
    return check_file(grid, write=True)


def _crew(jobs: int, dask: str | None, budget: Budget) -> AbstractContextManager[Crew]:
    if dask is None:
        return crew.local(jobs, budget)
    from possmap.fusing.cluster.crew import cluster  # needs what few have

    return cluster(dask)


@contextmanager
def _enough_memory() -> Iterator[None]:
    try:
        yield
    except MemoryError as error:
        raise WorkerError(
            "there is not enough memory; the grid holds whole logs only, and the same command "
            "completes the job where there is more"
        ) from error


def _batches(reading: Iterable[Read], most: int | None, budget: Budget) -> Iterator[list[Read]]:
    """Gather files until they hold ``most`` records: what is in memory, and in one transaction."""
    batch: list[Read] = []
    records = 0
    for one in reading:
        batch.append(one)
        if one.log is not None:
            # A ledger's versions of one excursion share its records.
            wholes = {id(one.parcel.whole): one.parcel.whole for one in one.log.deliveries}
            records += sum(whole.count for whole in wholes.values())
        if most is None:
            budget.check_together(records)
        elif records >= most:
            yield batch
            batch, records = [], 0
    if batch:
        yield batch


def _rehearse(
    reading: Iterable[Read], path: Path, settings: Settings, strict: bool
) -> list[Outcome]:
    """Judge everything and write nothing."""
    if not _holds_anything(path):
        return _judge(Judge(settings, None, path, strict), reading, strict)
    with Grid(path, write=True) as grid:
        ledger = None if grid.is_new else grid.ledger
        return _judge(Judge(settings, ledger, path, strict), reading, strict)


def _commit(
    batch: list[Read],
    path: Path,
    settings: Settings,
    strict: bool,
    hands: Crew,
    budget: Budget,
    progress: Progress,
) -> list[Outcome]:
    """Judge a batch and write what is new in it, in one transaction."""
    judge = Judge(settings, None, path, strict)
    outcomes: list[Outcome] | None = None
    if not _holds_anything(path):
        outcomes = _judge(judge, batch, strict)
        if not judge.accepted:
            return outcomes  # no grid is made for nothing
    with Grid(path, write=True, budget=budget) as grid, grid.transaction():
        if not grid.is_new:
            # Inside the transaction, so that nobody else can add an excursion in between.
            judge, outcomes = Judge(settings, grid.ledger, path, strict), None
        if outcomes is None:  # or what there was turned out to be the rest of a killed first run
            outcomes = _judge(judge, batch, strict)
        if any(outcome.status != "refused" for outcome in outcomes):
            grid.prepare(settings.evidence, settings.robots)
        if judge.arrived:
            _write(grid, judge, hands, progress)
    return outcomes


def _judge(judge: Judge, batch: Iterable[Read], strict: bool) -> list[Outcome]:
    """Judge logs in the order given; with ``strict`` the first refused one undoes the others."""
    outcomes: list[Outcome] = []
    batch = iter(batch)
    for one in batch:
        outcomes.append(_outcome(judge, one))
        log.info("%s: %s", outcomes[-1].path, outcomes[-1].status)
        if strict and outcomes[-1].status == "refused":
            judge.forget()
            undone = f"not kept, since {printable(one.path)} was refused (--strict)"
            others = [*(before.path for before in outcomes[:-1]), *(after.path for after in batch)]
            unkept = [
                Outcome(path, "refused", error=f"{printable(path)}: {undone}") for path in others
            ]
            before = len(outcomes) - 1
            return [*unkept[:before], outcomes[-1], *unkept[before:]]
    return outcomes


def _outcome(judge: Judge, one: Read) -> Outcome:
    if one.log is None:
        return Outcome(one.path, "refused", error=one.error)
    try:
        verdict = judge.take(one.log, one.foreseen)
    except LogError as error:
        return Outcome(one.path, "refused", error=str(error))
    cut = one.log.cut_short
    notes = [f"{cut}: the last line is cut short and was left out"] if cut else []
    notes += [verdict.note] if verdict.note else []
    return Outcome(
        one.path,
        "fused" if verdict.is_new else "known",
        verdict.records_new,
        verdict.records_known,
        note="; ".join(notes) or None,
    )


def _write(grid: Grid, judge: Judge, hands: Crew, progress: Progress) -> None:
    """Write what is new down in the ledger, and stamp it, a tile at a time."""
    accepted = list(judge.accepted.values())
    if accepted:  # else all that came was known, and only who brought it is new
        batch = hands.batch(accepted, judge.settings.evidence, grid.tiles)
        for rows in batch.rows():
            grid.ledger.add(rows)
        count, tiles = batch.tiles()
        for key, layers in progress(tiles, "tile", count):
            grid.tiles.put(key, layers)
        log.info("%d excursions stamped into %d tiles", len(accepted), count)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    grid.ledger.came.add(judge.arrived, now, version())
