"""The workers of a dask cluster as an executor, and what goes wrong with them in one line."""

from __future__ import annotations

import gc
import logging
import signal
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from threading import Event, Thread, current_thread, main_thread
from time import monotonic
from typing import TYPE_CHECKING, Any

from possmap.budget import Budget
from possmap.errors import MissingExtra, WorkerError, plural, printable
from possmap.fusing import urls
from possmap.fusing.executors import STAYS, Hands
from possmap.release import version

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10.0
"""Seconds until a scheduler counts as out of reach."""

PATIENCE = 30.0
"""Seconds for which a scheduler may be without workers."""

RETRIES = 2
"""How often a task that failed is tried again, on whichever worker."""

DEATHS = 3
"""How many workers of ``local`` may die of a task, and it is tried once more."""

_LOOK_AGAIN = 1.0
"""Seconds after which it is asked whether there are workers at all."""

_NEVER = logging.CRITICAL + 1


@dataclass(frozen=True, slots=True)
class Task:
    """A call, which dask does not look into; and the version of who asks."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    asked_by: str


def run(task: Task) -> Any:
    """Do a task, unless this worker is of another version: a worker may join at any time.

    Raises
    ------
    WorkerError
        If it is.
    """
    if version() != task.asked_by:
        raise WorkerError(f"a worker has possmap {version()}, and this process has {task.asked_by}")
    return task.function(*task.arguments)


class Cluster(Executor):
    """The workers behind a scheduler; a worker that dies is replaced by any other.

    Parameters
    ----------
    place
        The scheduler, for messages.

    Raises
    ------
    WorkerError
        If there are no workers in time, or one has no possmap, or another.
    """

    def __init__(self, client: Client, place: str) -> None:
        self._client, self._place, self._version = client, place, version()
        self._assemble()
        self._executor = client.get_executor(pure=False, retries=RETRIES)
        self._waiting: set[Future[Any]] = set()
        self._is_over = Event()
        Thread(target=self._watch, daemon=True).start()

    def _assemble(self) -> None:
        """Wait for the first worker, and see whether all have this possmap."""
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE)
            found = self._client.run(installed, "possmap", on_error="return")
        except TimeoutError:
            raise self._forsaken() from None
        except OSError:
            raise self._lost() from None
        for worker, other in sorted(found.items()):
            if isinstance(other, PackageNotFoundError):
                raise WorkerError(f"the worker at {worker} has no possmap: install {self._version}")
            if other != self._version:
                raise WorkerError(
                    f"the worker at {worker} has possmap {other}, expected {self._version}"
                )

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a worker do a task; its future fails with WorkerError if none can."""
        told: Future[Any] = Future()
        self._waiting.add(told)
        what = _about(args[0]) if args and isinstance(args[0], list) else ""

        def tell(done: Future[Any]) -> None:
            self._waiting.discard(told)
            with suppress(InvalidStateError):  # nobody waits for it any more
                try:
                    told.set_result(done.result())
                except (Exception, CancelledError) as error:
                    told.set_exception(self._explained(error, what))

        self._executor.submit(run, Task(fn, args, self._version)).add_done_callback(tell)
        return told

    def _explained(self, error: BaseException, what: str) -> BaseException:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        if isinstance(error, WorkerError):
            return WorkerError(f"{what}{error}; {STAYS}")
        if isinstance(error, MemoryError):
            return WorkerError(f"{what}a worker ran out of memory; {STAYS}")
        if isinstance(error, KilledWorker):
            count = plural(error.allowed_failures + 1, "worker")
            return WorkerError(f"{what}{count} died of it, perhaps for want of memory; {STAYS}")
        if isinstance(error, ImportError):
            return WorkerError(f"a worker cannot run possmap: {error}")
        if isinstance(error, (CancelledError, FutureCancelledError, OSError)):
            return self._lost()
        return error

    def _watch(self) -> None:
        """Let nobody wait for workers that do not come, or for a scheduler that is gone."""
        alone_since = None
        while not self._is_over.wait(_LOOK_AGAIN):
            problem = None
            if self._client.status not in ("running", "connecting"):
                problem = self._lost()
            else:
                try:
                    ask = self._client.scheduler.ncores
                    has_workers = bool(self._client.sync(ask, callback_timeout=CONNECT))
                    alone_since = None if has_workers else alone_since or monotonic()
                except Exception:  # a connection that breaks now has errors of its own
                    problem = self._lost()
            if alone_since is not None and monotonic() - alone_since > PATIENCE:
                problem = self._forsaken()
            if problem is not None and not self._is_over.is_set():
                for told in list(self._waiting):
                    with suppress(InvalidStateError):
                        told.set_exception(problem)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Look after it no longer; what workers still do is nobody's concern."""
        self._is_over.set()

    def _forsaken(self) -> WorkerError:
        return WorkerError(f"{self._place} has no workers, waited {PATIENCE:g} s; {STAYS}")

    def _lost(self) -> WorkerError:
        return WorkerError(f"the connection to {self._place} is lost; {STAYS}")


def _about(names: list[str]) -> str:
    others = f" or one of {len(names) - 1} after it" if len(names) > 1 else ""
    return f"{printable(urls.public(names[0]))}{others}: "


@contextmanager
def cluster(address: str, budget: Budget) -> Iterator[Hands]:
    """Connect to a scheduler, or start one with workers on this machine.

    Parameters
    ----------
    address
        ``tcp://host:port``, ``local`` or ``local:N``.
    budget
        Memory of this process.

    Raises
    ------
    MissingExtra
        If dask.distributed is not installed.
    WorkerError
        If the scheduler cannot be reached, has no workers, or its workers will not do.
    """
    watchers = list(gc.callbacks)
    try:
        import dask
        from distributed import Client
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise MissingExtra("possmap fuse --dask", "cluster") from None
    _silence()
    settings = {
        "distributed.admin.large-graph-warning-threshold": "1GiB",
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.worker.profile.enabled": False,
    }
    with (
        warnings.catch_warnings(),
        dask.config.set(settings),
        _enough_threads(),
        ExitStack() as last,
        ExitStack() as stack,
    ):
        warnings.simplefilter("ignore", VersionMismatchWarning)
        if address.partition(":")[0] == "local":
            place = "the cluster on this machine"
            client = _started(address, place, stack)
            stack.callback(last.enter_context, _undisturbed())  # half a cluster cannot be ended
        else:
            place = f"the scheduler at {printable(address)}"
            if address.startswith("tls:") and not dask.config.get(
                "distributed.comm.tls.ca-file", None
            ):
                raise WorkerError(
                    f"{place} asks for certificates, and dask's configuration names none "
                    "(distributed.comm.tls)"
                )
            try:
                client = Client(address, timeout=CONNECT, set_as_default=False)
            except (OSError, ValueError, RuntimeError):
                problem = f"cannot be reached, tried for {CONNECT:g} s; the grid is as it was"
                raise WorkerError(f"{place} {problem}") from None
            stack.enter_context(client)
        # Ctrl-C would often arrive in dask's watcher of the garbage collector, and Python drops
        # what is raised there.
        stack.callback(gc.callbacks.extend, [one for one in gc.callbacks if one not in watchers])
        gc.callbacks[:] = watchers
        with Cluster(client, place) as executor:
            yield Hands(executor, budget.spare // 8, str(Path.cwd()))


def _started(address: str, place: str, stack: ExitStack) -> Client:
    """Start a scheduler and workers on this machine."""
    from distributed import Client, LocalCluster

    count = address.partition(":")[2]
    with _undisturbed():
        try:
            with _deaf_to_interrupts():
                started = LocalCluster(
                    n_workers=int(count) if count else None,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=_NEVER,
                )
            stack.enter_context(started)
            return stack.enter_context(Client(started, set_as_default=False))
        except (OSError, RuntimeError, MemoryError) as error:
            reason = printable(" ".join(str(error).split()))[:200] or "no memory"
            raise WorkerError(f"{place} cannot be started: {reason}") from None


def _silence() -> None:
    """Keep dask's log off the terminal, to the end: what a user should know is said as an error."""
    names = ("distributed", "tornado", "asyncio")
    for name in [*names, *logging.root.manager.loggerDict]:
        if name.partition(".")[0] in names:
            logging.getLogger(name).setLevel(_NEVER)


@contextmanager
def _enough_threads() -> Iterator[None]:
    """Say in one line that dask could not start a thread, here or in a worker, at any time."""
    try:
        yield
    except RuntimeError as error:
        if str(error) != "can't start new thread":
            raise
        raise WorkerError(
            f"dask cannot start a thread, perhaps for want of memory; {STAYS}"
        ) from error


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let threads started meanwhile, and all that these ever start, have Ctrl-C blocked.

    It goes to every process of a terminal's group; workers are to be told by this one. Dask starts
    them from such threads, those too that replace a dead one, and what is blocked is inherited.
    """
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # later, it would take the block off the thread that does so
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Put Ctrl-C, or being asked to end, off until the end."""
    if current_thread() is not main_thread():
        yield
        return
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.signal(number, lambda which, _: came.append(which)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, handlers, strict=True):
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
