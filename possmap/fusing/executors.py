"""Where work is done, as ``concurrent.futures.Executor``: in this process, or in several.

Each of several processes has a pipe of its own, and a thread here that asks it one thing at a time:
if a process dies, its pipe ends, and with it the wait for an answer. (Those of
``ProcessPoolExecutor`` and of loky share one pipe; one that is killed while it writes leaves it
open with half an answer, and whoever waits does so for ever: in 16 of 40 kills.)
"""

from __future__ import annotations

import os
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager
from pickle import PickleError
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar

from possmap.budget import Budget, collect_seldom
from possmap.errors import WorkerError, printable

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

Result = TypeVar("Result")
P = ParamSpec("P")

STAYS = "the grid holds whole logs only, and the same command completes the job"


class Hands(NamedTuple):
    """Who does the work, and how much of it may be on its way.

    room : what may be on its way, or done and not yet asked for [bytes]; 0: one task at a time.
    folder : from which the executor is to look for files; None: as this process does.
    """

    executor: Executor
    room: int = 0
    folder: str | None = None

    @property
    def are_others(self) -> bool:
        """Whether others than this process do the work."""
        return self.room > 0

    def map(
        self,
        function: Callable[..., Result],
        tasks: Iterable[tuple[Any, ...]],
        weigh: Callable[..., int],
    ) -> Iterator[Result]:
        """Yield what a function makes of the arguments in each task, in their order.

        weigh : what the task and its result take, about [bytes].
        """
        waiting: deque[tuple[Future[Result], int]] = deque()
        room = self.room
        try:
            for task in tasks:
                size = weigh(*task)
                while waiting and size > room:
                    future, its_size = waiting.popleft()
                    room += its_size
                    yield future.result()
                waiting.append((self.executor.submit(function, *task), size))
                room -= size
            while waiting:
                yield waiting.popleft()[0].result()
        finally:
            for future, _ in waiting:
                future.cancel()


def hands(jobs: int, dask: str | None, budget: Budget) -> AbstractContextManager[Hands]:
    """Start what does the work: this process, ``jobs`` processes, or a cluster of dask.

    Raises
    ------
    WorkerError
        If they cannot be started; and, at any time, if one ends before its work does.
    MissingExtra
        For a cluster, if dask is not installed.
    """
    if dask is not None:
        from possmap.fusing.cluster import cluster  # needs what few have

        return cluster(dask, budget)
    return _processes(jobs, budget) if jobs > 1 else _serial()


@contextmanager
def _serial() -> Iterator[Hands]:
    yield SERIAL


@contextmanager
def _processes(jobs: int, budget: Budget) -> Iterator[Hands]:
    with Processes(jobs) as executor:
        try:
            yield Hands(executor, budget.ahead)
        except BaseException:
            executor.kill()  # nothing of theirs is wanted any more
            raise


class Serial(Executor):
    """Does each task in this process, when it is submitted; its errors are raised there."""

    def submit(
        self, fn: Callable[P, Result], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[Result]:
        """Do a task."""
        future: Future[Result] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


SERIAL = Hands(Serial())


class Processes(Executor):
    """Several processes on this machine, each with a pipe of its own.

    Raises
    ------
    WorkerError
        If they cannot be started.
    """

    def __init__(self, jobs: int) -> None:
        from concurrent.futures import ThreadPoolExecutor
        from queue import SimpleQueue

        self._processes: list[BaseProcess] = []
        self._pipes: list[Connection] = []
        self._idle: SimpleQueue[Connection] = SimpleQueue()
        self._threads = ThreadPoolExecutor(jobs)
        try:
            with _undisturbed():
                for _ in range(jobs):
                    self._start()
        except (OSError, ImportError) as error:
            self.kill()
            raise WorkerError(
                f"processes of --jobs cannot be started: {printable(str(error))[:200]}; the grid "
                "is as it was"
            ) from error

    def _start(self) -> None:
        import multiprocessing

        # Not forked: a child must not inherit the connection to the grid.
        spawning = multiprocessing.get_context("spawn")
        ours, theirs = spawning.Pipe()
        self._pipes.append(ours)
        self._idle.put(ours)
        with theirs:  # closed here, so that it ends with the process
            process = spawning.Process(target=_serve, args=(theirs,), daemon=True)
            process.start()
        self._processes.append(process)

    def submit(
        self, fn: Callable[P, Result], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[Result]:
        """Let the next process that is idle do a task."""
        try:
            return self._threads.submit(self._ask, fn, args, kwargs)
        except RuntimeError as error:  # the standard library's word for "no more threads"
            raise WorkerError(
                "processes of --jobs cannot be asked: there is no room for more threads; the grid "
                "holds whole logs only, and the same command completes the job where there is"
            ) from error

    def _ask(self, *call: object) -> Any:
        pipe = self._idle.get()  # there are as many as threads
        try:
            pipe.send(call)
            result, error, trace = pipe.recv()
        except (EOFError, OSError) as gone:
            raise WorkerError(
                f"a process of --jobs ended early, perhaps for want of memory; {STAYS}"
            ) from gone
        finally:
            self._idle.put(pipe)  # one that ended says so to whoever asks it next
        if error is not None:
            error.add_note(trace)
            raise error
        return result

    @property
    def pids(self) -> list[int]:
        """The processes' numbers."""
        return [process.pid for process in self._processes if process.pid is not None]

    def kill(self) -> None:
        """End the processes at once, whatever they do."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.join()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when their work is done."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        self.kill()
        for pipe in self._pipes:
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


def _serve(pipe: Connection) -> None:
    """Do one task after another, until the pipe ends, or whoever started this process."""
    from threading import Thread

    collect_seldom()
    Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            answer = _answer(*pipe.recv())
            try:
                pipe.send(answer)
            except (TypeError, AttributeError, PickleError):  # what it was can be read
                pipe.send((None, RuntimeError(str(answer[1])), answer[2]))
        except (EOFError, OSError):
            return


def _answer(function: Callable[..., Any], args: Any, kwargs: Any) -> tuple[Any, Any, str]:
    try:
        return function(*args, **kwargs), None, ""
    except Exception as error:
        return None, error, "In a process of --jobs:\n" + traceback.format_exc()


def _end_with_parent() -> None:
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
