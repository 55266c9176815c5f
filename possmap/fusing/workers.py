"""Work spread over several processes: the same results in the same order (``--jobs``).

Each process has a pipe of its own, and a thread here that asks it one thing at a time. Whenever a
process dies, its pipe ends, and with it the wait for an answer. (The processes of the standard
library's pool share one pipe; one that dies while it writes leaves it open with half an answer.)
"""

from __future__ import annotations

import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from possmap.errors import WorkerError, printable
from possmap.fusing.serving import serve, unpacked

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess
    from queue import SimpleQueue

Task = TypeVar("Task")
Result = TypeVar("Result")
Sized = TypeVar("Sized")

IN_FLIGHT = 3
"""Tasks per worker that are waiting or being done."""


class Spread(Protocol):
    """Does tasks somewhere, and yields their results in the order of the tasks."""

    def __call__(
        self,
        function: Callable[[Task], Result],
        tasks: Iterable[Task],
        weigh: Callable[[Task], int],
        /,
    ) -> Iterator[Result]:
        """Yield what ``function`` makes of each task.

        weigh : what its result takes, about [bytes]; bounds what is done ahead.
        """


@contextmanager
def workers(jobs: int, ahead: int) -> Iterator[Spread]:
    """Start ``jobs`` processes to spread work over; one means this process.

    Parameters
    ----------
    ahead
        Results that may be done or on their way before they are asked for [bytes].

    Raises
    ------
    WorkerError
        If a process ends before its work does.
    """
    if jobs == 1:
        yield here
        return
    # Slow to import, and one process needs none of it.
    from concurrent.futures import ThreadPoolExecutor

    with ExitStack() as stack:
        processes, pipes = _started(jobs)
        threads = stack.enter_context(ThreadPoolExecutor(jobs))
        stack.callback(_end, processes, pipes)
        # First of all, so that no thread waits for an answer, or begins to.
        stack.callback(threads.shutdown, wait=False, cancel_futures=True)
        yield _Pool(threads, pipes, ahead)


def here(
    function: Callable[[Task], Result], tasks: Iterable[Task], _: Callable[[Task], int], /
) -> Iterator[Result]:
    """Do tasks in this process, each when its result is asked for."""
    return map(function, tasks)


def _started(jobs: int) -> tuple[list[BaseProcess], list[Connection]]:
    """Return processes on their way, and the pipe to each."""
    processes: list[BaseProcess] = []
    pipes: list[Connection] = []
    try:
        import multiprocessing

        # Not forked: a child must not inherit the connection to the grid.
        spawning = multiprocessing.get_context("spawn")
        with _undisturbed():
            for _ in range(jobs):
                ours, theirs = spawning.Pipe()
                pipes.append(ours)
                with theirs:  # closed here, so that it ends with the process
                    process = spawning.Process(target=serve, args=(theirs,), daemon=True)
                    process.start()
                processes.append(process)
    except (OSError, ImportError) as error:
        _end(processes, pipes)
        raise WorkerError(
            f"processes of --jobs cannot be started: {printable(str(error))[:200]}; the grid is as "
            "it was"
        ) from error
    return processes, pipes


def _end(processes: Iterable[BaseProcess], pipes: Iterable[Connection]) -> None:
    """End processes, whatever they do: nothing of theirs is wanted any more."""
    for process in processes:
        process.kill()
    for process in processes:
        process.join()
    for pipe in pipes:
        pipe.close()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let what is started meanwhile not hear what a terminal or a shell tells its whole group.

    This process does, as soon as they are started, and ends them.
    """
    if not hasattr(signal, "pthread_sigmask"):  # nor are there groups to tell
        yield
        return
    from multiprocessing import resource_tracker

    # It comes with the first process, and lets its own parent hear again what we do not want heard.
    resource_tracker.ensure_running()
    unheard = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, unheard)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Pool:
    """Spreads several kinds of work over the same processes."""

    def __init__(self, threads: ThreadPoolExecutor, pipes: list[Connection], ahead: int) -> None:
        from queue import SimpleQueue

        self._threads, self.ahead, self.most = threads, ahead, len(pipes) * IN_FLIGHT
        self._idle: SimpleQueue[Connection] = SimpleQueue()
        for pipe in pipes:
            self._idle.put(pipe)
        self.open: list[_InOrder[Any, Any]] = []

    def __call__(
        self,
        function: Callable[[Task], Result],
        tasks: Iterable[Task],
        weigh: Callable[[Task], int],
        /,
    ) -> Iterator[Result]:
        work = _InOrder(self, function, tasks, weigh)
        self.open.append(work)
        return work

    def begin(self, function: Callable[[Task], Any], task: Task) -> Future[bytes]:
        """Let the next process that is idle do a task."""
        try:
            return self._threads.submit(self._ask, function, task)
        except RuntimeError as error:  # the standard library's word for "no more threads"
            raise WorkerError(
                "processes of --jobs cannot be asked: there is no room for more threads; the grid "
                "holds whole logs only, and the same command completes the job where there is"
            ) from error

    def _ask(self, function: Callable[[Task], Any], task: Task) -> bytes:
        """Return a packed answer, which takes a part of the room of what is in it."""
        pipe = self._idle.get()  # there are as many as threads
        try:
            pipe.send_bytes(pickle.dumps((function, task), pickle.HIGHEST_PROTOCOL))
            return pipe.recv_bytes()
        finally:
            self._idle.put(pipe)  # one that ended says so to whoever asks it next


class _InOrder(Iterator[Result], Generic[Task, Result]):
    """Results in the order of the tasks, of which a few are always on their way."""

    def __init__(
        self,
        pool: _Pool,
        function: Callable[[Task], Result],
        tasks: Iterable[Task],
        weigh: Callable[[Task], int],
    ) -> None:
        self._pool, self._function, self._tasks, self._weigh = pool, function, iter(tasks), weigh
        self._begun: deque[tuple[Future[bytes], int]] = deque()

    def __next__(self) -> Result:
        self._go_ahead()
        if self._begun:
            result: Result = _result(self._begun.popleft()[0])
            return result
        if self in self._pool.open:
            self._pool.open.remove(self)
        # What follows now, a commit perhaps, is nothing for workers: let them read on.
        for other in self._pool.open:
            other._go_ahead()
        raise StopIteration

    def _go_ahead(self) -> None:
        """Begin with more tasks while there is room for them."""
        while self._has_room():
            for task in self._tasks:
                self._begun.append((self._pool.begin(self._function, task), self._weigh(task)))
                break
            else:
                return

    def _has_room(self) -> bool:
        undone = room = 0
        for future, weight in self._begun:
            is_done = future.done()
            undone += not is_done
            room += len(future.result()) if is_done and not future.exception() else weight
        return not self._begun or (undone < self._pool.most and room < self._pool.ahead)


def _result(future: Future[bytes]) -> Any:
    """Return what a process made of a task, or raise what it raised."""
    try:
        answer = future.result()
    except (EOFError, OSError) as error:
        raise WorkerError(
            "a process of --jobs ended early, perhaps for want of memory; the grid holds whole "
            "logs only, and the same command completes the job"
        ) from error
    return unpacked(answer)


def gathered(
    items: Iterable[Sized], size_of: Callable[[Sized], int], least: int
) -> Iterator[list[Sized]]:
    """Gather items until their sizes make up ``least``: tasks large enough to be worth sending.

    Only one that is larger by itself makes a task larger than that.
    """
    some: list[Sized] = []
    size = 0
    for item in items:
        its_size = size_of(item)
        if some and size + its_size > least:
            yield some
            some, size = [], 0
        some.append(item)
        size += its_size
    if some:
        yield some
