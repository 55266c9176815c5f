"""Stamping tiles in several processes: the same integers, in less time (``--jobs``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

from possmap.core.fusion import Job, TileLayers, fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.settings import EvidenceSettings
from possmap.errors import WorkerError

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

TileTask: TypeAlias = tuple[TileKey, list[Job], TileLayers, EvidenceSettings]
"""A tile, what to stamp into it, what it holds, and the settings of its grid."""

Stamper: TypeAlias = Callable[[Iterable[TileTask]], Iterator[tuple[TileKey, TileLayers]]]
"""Fuses tiles and yields each with its changed layers, in the order given."""

IN_FLIGHT = 4
"""Tiles per worker that are waiting or done and not yet fetched: what bounds memory."""


@contextmanager
def stamper(jobs: int) -> Iterator[Stamper]:
    """Open a stamper of ``jobs`` processes; one means this process."""
    if jobs == 1:
        yield lambda tasks: map(_fused, tasks)
        return
    # Slow to import, and one process needs none of it.
    import multiprocessing
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

    # Not forked: a child must not inherit the connection to the grid.
    spawned = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(jobs, spawned, initializer=_end_with_parent) as pool:
            yield lambda tasks: _in_order(pool, tasks, jobs * IN_FLIGHT)
    except BrokenExecutor as error:
        raise WorkerError(
            "a process of --jobs ended early, perhaps for want of memory; the grid holds whole "
            "logs only, and the same command completes the job"
        ) from error


def _fused(task: TileTask) -> tuple[TileKey, TileLayers]:
    return task[0], fuse_tile(*task)


def _in_order(
    pool: Executor, tasks: Iterable[TileTask], most: int
) -> Iterator[tuple[TileKey, TileLayers]]:
    waiting: deque[Future[tuple[TileKey, TileLayers]]] = deque()
    for task in tasks:
        waiting.append(pool.submit(_fused, task))
        if len(waiting) >= most:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def _end_with_parent() -> None:
    """Let a worker end when the process that started it is gone, killed or not."""
    from threading import Thread

    Thread(target=_wait_and_end, daemon=True).start()


def _wait_and_end() -> None:
    import os
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
