"""Work spread over several processes: the same results in the same order (``--jobs``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from possmap.errors import WorkerError

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

Task = TypeVar("Task")
Result = TypeVar("Result")
Sized = TypeVar("Sized")

IN_FLIGHT = 3
"""Tasks per worker that are waiting or done and not yet fetched: what bounds memory."""


class Spread(Protocol):
    """Does tasks somewhere, and yields their results in the order of the tasks."""

    def __call__(
        self, function: Callable[[Task], Result], tasks: Iterable[Task], /
    ) -> Iterator[Result]:
        """Yield what ``function`` makes of each task."""


@contextmanager
def workers(jobs: int) -> Iterator[Spread]:
    """Start ``jobs`` processes to spread work over; one means this process.

    Raises
    ------
    WorkerError
        If a process ends before its work does.
    """
    if jobs == 1:
        yield map
        return
    # Slow to import, and one process needs none of it.
    import multiprocessing
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

    # Not forked: a child must not inherit the connection to the grid.
    spawned = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(jobs, spawned, initializer=_begin) as pool:
            yield lambda function, tasks: _in_order(pool, function, tasks, jobs * IN_FLIGHT)
    except BrokenExecutor as error:
        raise WorkerError(
            "a process of --jobs ended early, perhaps for want of memory; the grid holds whole "
            "logs only, and the same command completes the job"
        ) from error


def _in_order(
    pool: Executor, function: Callable[[Task], Result], tasks: Iterable[Task], most: int
) -> Iterator[Result]:
    waiting: deque[Future[Result]] = deque()
    for task in tasks:
        waiting.append(pool.submit(function, task))
        if len(waiting) >= most:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def gathered(
    items: Iterable[Sized], size_of: Callable[[Sized], int], least: int
) -> Iterator[list[Sized]]:
    """Gather items until their sizes make up ``least``: tasks large enough to be worth sending."""
    some: list[Sized] = []
    size = 0
    for item in items:
        some.append(item)
        size += size_of(item)
        if size >= least:
            yield some
            some, size = [], 0
    if some:
        yield some


def collect_seldom() -> None:
    """Let the garbage collector look seldom: records are many, and none of them is in a cycle.

    For a process of its own; it takes an eighth off the time of a batch, and no memory.
    """
    import gc

    gc.set_threshold(100_000, 50, 100)


def _begin() -> None:
    """Let a worker end when the process that started it is gone, killed or not."""
    from threading import Thread

    collect_seldom()
    Thread(target=_wait_and_end, daemon=True).start()


def _wait_and_end() -> None:
    import os
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
