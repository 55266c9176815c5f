"""Who does the work of ``fuse``: this process, some on this machine, or a cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import Protocol

from possmap.budget import Budget
from possmap.core.plan import ExcursionPlan, by_tile
from possmap.core.settings import EvidenceSettings
from possmap.errors import TileError
from possmap.fusing import inputs
from possmap.fusing.judge import Known
from possmap.fusing.stages import (
    Elsewhere,
    LayoutTask,
    Read,
    ReadTask,
    TileResult,
    TileTask,
    lay_out,
    read_logs,
    stamp_tile,
)
from possmap.fusing.workers import Spread, gathered, here, workers
from possmap.grid.rows import ExcursionRows
from possmap.grid.tiles import TileStore

READ_AT_ONCE = 2**18
"""Bytes of logs that a worker reads in one go."""

LAY_OUT_AT_ONCE = 2000
"""Records that a worker lays out in one go."""


class Batch(Protocol):
    """What one transaction adds: first all rows of the ledger are asked for, then all tiles."""

    def rows(self) -> Iterator[ExcursionRows]:
        """Yield what the ledger writes, excursion by excursion."""

    def tiles(self) -> tuple[int, Iterator[TileResult]]:
        """Return how many tiles change, and yield them as they are to be written."""


class Crew(Protocol):
    """Reads logs, and makes of what is accepted what the grid file holds."""

    @property
    def foresees(self) -> bool:
        """Whether it pays to lay out an excursion when it is read."""

    def read(self, names: Iterable[str], how: ReadTask) -> Iterator[Read]:
        """Read logs, and yield them in the order given."""

    def batch(
        self, accepted: Sequence[Known], settings: EvidenceSettings, tiles: TileStore
    ) -> Batch:
        """Begin with what a transaction adds.

        tiles : as they are before it.
        """


@contextmanager
def local(jobs: int, budget: Budget) -> Iterator[Crew]:
    """Start ``jobs`` processes; one means this process.

    budget : memory that this process, and each of them, may take.

    Raises
    ------
    WorkerError
        If a process ends before its work does.
    """
    with workers(jobs, budget.ahead) as spread:
        yield _Local(spread, foresees=jobs > 1)


def read_tasks(names: Iterable[str], how: ReadTask) -> Iterator[ReadTask]:
    """Cut the work of reading into tasks that are worth sending."""
    chunks = gathered(names, inputs.text_of, READ_AT_ONCE)
    return (how._replace(names=tuple(chunk)) for chunk in chunks)


def layout_tasks(
    accepted: Iterable[Known], settings: EvidenceSettings
) -> Iterator[list[LayoutTask]]:
    """Cut the work of laying out what was not when it was read."""
    tasks = (
        LayoutTask(one.parcel, one.model, one.in_grid, settings)
        for one in accepted
        if one.foreseen is None
    )
    return gathered(tasks, lambda task: task.parcel.count, LAY_OUT_AT_ONCE)


def _read_bytes(task: ReadTask) -> int:
    return 6 * sum(map(inputs.text_of, task.names))  # measured, as read and laid out


def _laid_out_bytes(tasks: list[LayoutTask]) -> int:
    return 500 * sum(task.parcel.count for task in tasks)


def _task_bytes(task: TileTask) -> int:
    """Return what is held until a tile is stamped, which is more than what comes back."""
    pieces = sum(rows.nbytes for rows in task.work.pieces.values())
    stored = sum(len(layer.data) for layer in task.stored.values())
    return task.work.segments.nbytes + pieces + 100 * len(task.work.clips) + stored


class _Local:
    def __init__(self, spread: Spread, foresees: bool) -> None:
        self._spread = spread
        self.foresees = foresees

    def read(self, names: Iterable[str], how: ReadTask) -> Iterator[Read]:
        # Stdin is nobody's but this process's.
        for is_stdin, some in groupby(names, key=lambda name: name == inputs.STDIN):
            spread = here if is_stdin else self._spread
            for reads in spread(read_logs, read_tasks(some, how), _read_bytes):
                yield from reads

    def batch(
        self, accepted: Sequence[Known], settings: EvidenceSettings, tiles: TileStore
    ) -> Batch:
        return _LocalBatch(self._spread, accepted, settings, tiles)


class _LocalBatch:
    def __init__(
        self,
        spread: Spread,
        accepted: Sequence[Known],
        settings: EvidenceSettings,
        tiles: TileStore,
    ) -> None:
        self._spread, self._accepted, self._settings = spread, accepted, settings
        self._tiles = tiles
        self._plans: list[ExcursionPlan] = []

    def rows(self) -> Iterator[ExcursionRows]:
        chunks = layout_tasks(self._accepted, self._settings)
        laid_out = (one for some in self._spread(lay_out, chunks, _laid_out_bytes) for one in some)
        for known in self._accepted:
            rows, plan = known.foreseen or next(laid_out)
            assert not isinstance(plan, Elsewhere), "local processes send what they make"
            self._plans.append(plan)
            yield rows

    def tiles(self) -> tuple[int, Iterator[TileResult]]:
        count, works = by_tile(self._plans)
        self._plans.clear()
        tasks = (TileTask(one, self._tiles.packed(one.key), self._settings) for one in works)
        return count, self._stamped(tasks)

    def _stamped(self, tasks: Iterable[TileTask]) -> Iterator[TileResult]:
        try:
            yield from self._spread(stamp_tile, tasks, _task_bytes)
        except TileError as error:
            raise self._tiles.damaged(str(error)) from error
