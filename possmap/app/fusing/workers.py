"""Work spread over several processes: the same results in the same order (``--jobs``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from possmap.errors import WorkerError, printable

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future, ProcessPoolExecutor

Task = TypeVar("Task")
Result = TypeVar("Result")
Sized = TypeVar("Sized")

IN_FLIGHT = 3
"""Tasks per worker that are waiting or being done."""

AHEAD = 3
"""How many times as many may be done and not yet fetched besides: what bounds memory."""


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
    from concurrent.futures import BrokenExecutor

    try:
        with _started(jobs) as pool:
            yield _Pool(pool, jobs * IN_FLIGHT)
    except BrokenExecutor as error:
        raise WorkerError(
            "a process of --jobs ended early, perhaps for want of memory; the grid holds whole "
            "logs only, and the same command completes the job"
        ) from error


def _started(jobs: int) -> ProcessPoolExecutor:
    """Return a pool whose processes are on their way.

    Ctrl-C goes to every process of a terminal's group; theirs is to be told by this one.
    """
    try:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        # Not forked: a child must not inherit the connection to the grid.
        pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_begin)
        with _deaf_to_interrupts():
            for _ in range(jobs):  # none is started before there is something to do
                pool.submit(int)
    except (OSError, ImportError) as error:
        raise WorkerError(
            f"processes of --jobs cannot be started: {printable(str(error))[:200]}; the grid is as "
            "it was"
        ) from error
    return pool


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let what is started meanwhile ignore Ctrl-C, from its first moment on."""
    import signal
    from threading import current_thread, main_thread

    if current_thread() is not main_thread():  # nobody else may
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class _Pool:
    """Spreads several kinds of work over one pool of processes."""

    def __init__(self, executor: Executor, most: int) -> None:
        self.executor, self.most = executor, most
        self.open: list[_InOrder[Any, Any]] = []

    def __call__(
        self, function: Callable[[Task], Result], tasks: Iterable[Task], /
    ) -> Iterator[Result]:
        work = _InOrder(self, function, tasks)
        self.open.append(work)
        return work


class _InOrder(Iterator[Result], Generic[Task, Result]):
    """Results in the order of the tasks, of which a few are always on their way."""

    def __init__(
        self, pool: _Pool, function: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> None:
        self._pool, self._function, self._tasks = pool, function, iter(tasks)
        self._waiting: deque[Future[Result]] = deque()

    def __next__(self) -> Result:
        self._go_ahead()
        if self._waiting:
            return self._waiting.popleft().result()
        if self in self._pool.open:
            self._pool.open.remove(self)
        # What follows now, a commit perhaps, is nothing for workers: let them read on.
        for other in self._pool.open:
            other._go_ahead()
        raise StopIteration

    def _go_ahead(self) -> None:
        """Begin with more tasks while there is room for them."""
        most = self._pool.most
        while len(self._waiting) < AHEAD * most and self._undone() < most:
            for task in self._tasks:
                self._waiting.append(self._pool.executor.submit(self._function, task))
                break
            else:
                return

    def _undone(self) -> int:
        return sum(not one.done() for one in self._waiting)


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
