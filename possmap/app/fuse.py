"""``possmap fuse``: logs into a grid, each record once, whole logs only."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, TypeAlias

from possmap.app import inputs
from possmap.app.judge import Judge
from possmap.app.progress import Progress, quiet
from possmap.app.settings import Request, in_force
from possmap.app.workers import Stamper, stamper
from possmap.core.fusion import Plan, add_to_plan
from possmap.errors import GridError, LogError, printable
from possmap.files.gridfile.database import check_file
from possmap.files.gridfile.grid import Grid
from possmap.files.logs.delivery import LogFile
from possmap.files.settings import Settings
from possmap.release import version

log = logging.getLogger(__name__)

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


@dataclass(frozen=True, slots=True)
class _Read:
    """A log file as read, or why it could not be."""

    path: str
    log: LogFile | None
    error: str | None = None


def fuse(
    logs: Sequence[str],
    grid: Path,
    request: Request | None = None,
    *,
    strict: bool = False,
    dry_run: bool = False,
    allow_truncated: bool = False,
    jobs: int = 1,
    progress: Progress = quiet,
) -> FuseSummary:
    """Fuse logs into a grid file, creating it if need be.

    Parameters
    ----------
    logs
        Files, folders, ``-`` for JSON Lines on stdin, or other grids, whose ledgers are fused.
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
        Processes that stamp tiles.

    Raises
    ------
    SettingsError
        If a given setting is wrong, or differs from the grid's.
    GridError
        If the grid cannot be used. Whole logs fused before that stay.
    """
    start = time.perf_counter()
    given = (request or Request()).given()
    stored = None
    if _holds_anything(grid):
        # For writing, though nothing is: what an interrupted run left may hold nothing yet.
        with Grid(grid, write=True) as known:
            stored = None if known.is_new else known.stored_settings()
    settings = in_force(given, stored, grid)
    names = progress(list(inputs.expand(logs)), "log")
    reading = (_read(name, settings, allow_truncated) for name in names)
    if dry_run:
        outcomes = _rehearse(reading, grid, settings, strict)
    else:
        outcomes = []
        # With --strict all is one transaction, so that the last log can still undo the first.
        most = None if strict else settings.limits.transaction_records
        with stamper(jobs) as stamp:
            for batch in _batches(reading, most):
                outcomes += _commit(batch, grid, settings, strict, stamp, progress)
    return FuseSummary(grid, tuple(outcomes), time.perf_counter() - start)


def _holds_anything(grid: Path) -> bool:
    return check_file(grid, write=True)


def _read(name: str, settings: Settings, allow_truncated: bool) -> _Read:
    try:
        return _Read(name, inputs.read(name, settings.limits, allow_truncated))
    except (LogError, GridError) as error:
        return _Read(name, None, str(error))


def _batches(reading: Iterable[_Read], most: int | None) -> Iterator[list[_Read]]:
    """Gather files until they hold ``most`` records: what is in memory, and in one transaction."""
    batch: list[_Read] = []
    records = 0
    for one in reading:
        batch.append(one)
        if one.log is not None:
            records += sum(len(delivery.version.records) for delivery in one.log.deliveries)
        if most is not None and records >= most:
            yield batch
            batch, records = [], 0
    if batch:
        yield batch


def _rehearse(
    reading: Iterable[_Read], path: Path, settings: Settings, strict: bool
) -> list[Outcome]:
    """Judge everything and write nothing."""
    if not _holds_anything(path):
        return _judge(Judge(settings), reading, strict)
    with Grid(path, write=True) as grid:
        ledger = None if grid.is_new else grid.ledger
        return _judge(Judge(settings, ledger), reading, strict)


def _commit(
    batch: list[_Read],
    path: Path,
    settings: Settings,
    strict: bool,
    stamp: Stamper,
    progress: Progress,
) -> list[Outcome]:
    """Judge a batch and write what is new in it, in one transaction."""
    judge = Judge(settings)
    if not _holds_anything(path):
        outcomes = _judge(judge, batch, strict)
        if not judge.accepted:
            return outcomes  # no grid is made for nothing
    with Grid(path, write=True) as grid, grid.transaction():
        if not grid.is_new:
            # Inside the transaction, so that nobody else can add an excursion in between.
            judge = Judge(settings, grid.ledger)
            outcomes = _judge(judge, batch, strict)
        if any(outcome.status != "refused" for outcome in outcomes):
            grid.prepare(settings.evidence, settings.robots)
        if judge.accepted:
            _write(grid, judge, stamp, progress)
    return outcomes


def _judge(judge: Judge, batch: Iterable[_Read], strict: bool) -> list[Outcome]:
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


def _outcome(judge: Judge, one: _Read) -> Outcome:
    if one.log is None:
        return Outcome(one.path, "refused", error=one.error)
    try:
        verdict = judge.take(one.log)
    except LogError as error:
        return Outcome(one.path, "refused", error=str(error))
    cut = one.log.cut_short
    return Outcome(
        one.path,
        "fused" if verdict.is_new else "known",
        verdict.records_new,
        verdict.records_known,
        note=f"{cut}: the last line is cut short and was left out" if cut else None,
    )


def _write(grid: Grid, judge: Judge, stamp: Stamper, progress: Progress) -> None:
    """Stamp what is new, a tile at a time, and write it down in the ledger."""
    settings = judge.settings.evidence
    plan: Plan = {}
    touched = {
        name: add_to_plan(plan, judge.laid_out[name], number, known.in_grid, settings)
        for number, (name, known) in enumerate(judge.accepted.items())
    }
    tasks = (
        (key, plan.pop(key), grid.tiles.read(key), settings)
        for key in progress(sorted(plan), "tile")
    )
    tiles = len(plan)
    for key, changed in stamp(tasks):
        grid.tiles.write(key, changed)
    log.info("%d excursions stamped into %d tiles", len(judge.accepted), tiles)
    for name, known in judge.accepted.items():
        geometry = judge.laid_out[name].geometry
        grid.ledger.add(known.version, known.model, known.in_grid, geometry, touched[name])
    now = datetime.now(UTC).isoformat(timespec="seconds")
    grid.ledger.add_arrivals(judge.arrived, now, version())
