"""To a team of workers: a connection to a scheduler, or a cluster started on this machine."""

from __future__ import annotations

import gc
import logging
import signal
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from threading import current_thread, main_thread

from possmap.errors import MissingExtra, WorkerError, printable
from possmap.fusing.cluster import client
from possmap.fusing.cluster.client import Team

NEVER = logging.CRITICAL + 1
"""A level that no message of a log reaches."""

DEATHS = 3
"""How many workers of ``local`` may die of a task, and it is tried once more."""


@contextmanager
def team(address: str) -> Iterator[Team]:
    """Connect to a scheduler, or start one with workers on this machine.

    Parameters
    ----------
    address
        ``tcp://host:port``, ``local`` or ``local:N``.

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
        from distributed import Client, LocalCluster
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise MissingExtra("possmap fuse --dask", "cluster") from None
    _silence()
    name, _, count = address.partition(":")
    settings = {
        "distributed.admin.large-graph-warning-threshold": "1GiB",
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.worker.profile.enabled": False,
    }
    with (
        warnings.catch_warnings(),
        dask.config.set(settings),
        _enough(),
        ExitStack() as last,
        ExitStack() as stack,
    ):
        warnings.simplefilter("ignore", VersionMismatchWarning)
        if name == "local":
            place = "the cluster on this machine"
            with _undisturbed():  # half a cluster cannot be ended
                try:
                    with _deaf_to_interrupts():
                        started = LocalCluster(
                            n_workers=int(count) if count else None,
                            threads_per_worker=1,
                            host="127.0.0.1",
                            dashboard_address="127.0.0.1:0",
                            silence_logs=NEVER,
                        )
                    stack.enter_context(started)
                    connected = stack.enter_context(Client(started, set_as_default=False))
                    stack.callback(last.enter_context, _undisturbed())  # nor half-way
                except (OSError, RuntimeError, MemoryError) as error:
                    reason = printable(" ".join(str(error).split()))[:200] or "no memory"
                    raise WorkerError(f"{place} cannot be started: {reason}") from None
        else:
            place = f"the scheduler at {printable(address)}"
            seconds = client.CONNECT
            if address.startswith("tls:") and not _has_certificates():
                raise WorkerError(
                    f"{place} asks for certificates, and dask's configuration names none "
                    "(distributed.comm.tls)"
                )
            try:
                reached = Client(address, timeout=seconds, set_as_default=False)
            except (OSError, ValueError, RuntimeError):
                problem = f"cannot be reached, tried for {seconds:g} s; the grid is as it was"
                raise WorkerError(f"{place} {problem}") from None
            connected = stack.enter_context(reached)
        stack.enter_context(_unwatched(watchers))
        found = Team(connected, place)
        found.assemble()
        yield found


def _has_certificates() -> bool:
    """Whether dask is told with what to prove itself; without it fails half-way."""
    import dask

    return dask.config.get("distributed.comm.tls.ca-file", None) is not None


def _silence() -> None:
    """Keep dask's log off the terminal, to the end: what a user should know is said as an error."""
    names = ("distributed", "tornado", "asyncio")
    beneath = [
        name
        for name in logging.root.manager.loggerDict
        if name.startswith(tuple(f"{one}." for one in names))
    ]
    for name in (*names, *beneath):
        logging.getLogger(name).setLevel(NEVER)


@contextmanager
def _enough() -> Iterator[None]:
    """Say in one line that dask could not start a thread, here or in a worker, at any time."""
    try:
        yield
    except RuntimeError as error:
        if str(error) != "can't start new thread":
            raise
        raise WorkerError(
            f"dask cannot start a thread, perhaps for want of memory; {client.STAYS}"
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


@contextmanager
def _unwatched(watchers: Sequence[object]) -> Iterator[None]:
    """Let nobody but these watch the garbage collector.

    Ctrl-C would often arrive in dask's watcher, and Python drops what is raised there.
    """
    others = [one for one in gc.callbacks if one not in watchers]
    for one in others:
        gc.callbacks.remove(one)
    try:
        yield
    finally:
        gc.callbacks.extend(others)  # whoever came takes itself off again
