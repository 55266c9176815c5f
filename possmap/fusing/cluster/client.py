"""Workers behind a scheduler of dask, and what may go wrong with them, said in one line."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

from possmap.errors import PossmapError, WorkerError, plural
from possmap.fusing.cluster.tasks import label_of, run_as, unpack
from possmap.release import version

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT = 10.0
"""Seconds until a scheduler counts as out of reach."""

PATIENCE = 30.0
"""Seconds for which a scheduler may be without workers."""

LOOK_AGAIN = 1.0
"""Seconds after which somebody who waits asks whether there are workers at all."""

RETRIES = 2
"""How often a task that failed is tried again, on whichever worker."""

IN_FLIGHT = 3
"""Tasks per thread that are waiting or done and not yet fetched: what bounds memory."""

STAYS = "the grid holds whole logs only, and the same command completes the job"


class Sent(NamedTuple):
    """A task that a worker has, or will have.

    what : it does, for messages.
    """

    what: str
    future: Future[Any]


class Work(NamedTuple):
    """A task to send: what it does, the function, and what it takes, packed."""

    what: str
    function: Callable[..., Any]
    data: bytes


class Team:
    """The workers behind one scheduler.

    Attributes
    ----------
    place
        The scheduler, for messages.
    threads
        Of all workers, when last asked.
    """

    def __init__(self, client: Client, place: str) -> None:
        self._client = client
        self.place = place
        self.threads = 0
        self._alone_since: float | None = None
        self._version = version()

    def assemble(self) -> None:
        """Wait for the first worker, and see whether all have this possmap.

        Raises
        ------
        WorkerError
            If there is none in time, or one has none, or another.
        """
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise self._forsaken() from None
        try:
            found = self._client.run(installed, "possmap", on_error="return")
        except OSError:
            raise self._lost() from None
        for worker, other in sorted(found.items()):
            if isinstance(other, PackageNotFoundError):
                raise WorkerError(f"the worker at {worker} has no possmap: install {self._version}")
            if other != self._version:
                raise WorkerError(
                    f"the worker at {worker} has possmap {other}, expected {self._version}"
                )
        self.look()

    def look(self) -> None:
        """Count the workers' threads.

        Raises
        ------
        WorkerError
            If there has been none for too long, or the scheduler is gone.
        """
        if self._client.status not in ("running", "connecting"):
            raise self._lost()
        try:
            threads = self._client.sync(self._client.scheduler.ncores, callback_timeout=CONNECT)
        except (OSError, TimeoutError):
            raise self._lost() from None
        self.threads = sum(threads.values())
        if self.threads:
            self._alone_since = None
        elif self._alone_since is None:
            self._alone_since = monotonic()
        elif monotonic() - self._alone_since > PATIENCE:
            raise self._forsaken()

    @property
    def in_flight(self) -> int:
        """How many tasks may be on their way at once."""
        return IN_FLIGHT * max(1, self.threads)

    def send(self, work: Work, *needs: Sent, priority: int = 0) -> Sent:
        """Send a task, with what other tasks yield as its further arguments."""
        future: Future[Any] = self._client.submit(
            run_as,
            self._version,
            work.function,
            *([work.data] if work.data else []),
            *(need.future for need in needs),
            key=f"possmap-{work.function.__name__}-{uuid4().hex}",
            pure=False,
            retries=RETRIES,
            priority=priority,
        )
        return Sent(work.what, future)

    def result(self, sent: Sent) -> Any:
        """Wait for what a task yields.

        Raises
        ------
        WorkerError
            If workers die of it again and again, there are none left, or the scheduler is gone.
        PossmapError
            That the task itself raised.
        """
        from distributed import CancelledError, KilledWorker

        what, future = sent
        while True:
            try:
                return future.result(timeout=LOOK_AGAIN)
            except PossmapError as error:
                if isinstance(error, WorkerError):
                    raise WorkerError(f"{what}: {error}; {STAYS}") from None
                raise
            except TimeoutError:
                if future.status == "error":
                    raise
                self.look()
            except MemoryError:
                raise WorkerError(f"{what}: a worker ran out of memory; {STAYS}") from None
            except KilledWorker as error:
                count = plural(error.allowed_failures + 1, "worker")
                reason = "perhaps for want of memory"
                raise WorkerError(f"{what}: {count} died of it, {reason}; {STAYS}") from None
            except ImportError as error:
                raise WorkerError(f"a worker cannot run possmap: {error}") from None
            except (CancelledError, OSError):
                raise self._lost() from None

    def labelled(
        self, works: Iterable[Work], priority: int = 0
    ) -> Iterator[tuple[Sent, list[Any]]]:
        """Let works make what workers keep; yield what stands for it, and its label, in order."""
        waiting: deque[tuple[Sent, Sent]] = deque()
        for work in works:
            held = self.send(work, priority=priority)
            label = self.send(Work(work.what, label_of, b""), held, priority=priority + 1)
            waiting.append((held, label))
            while len(waiting) >= self.in_flight:
                yield self._opened(*waiting.popleft())
        while waiting:
            yield self._opened(*waiting.popleft())

    def _opened(self, held: Sent, label: Sent) -> tuple[Sent, list[Any]]:
        return held, unpack(self.result(label))

    def homes(self, held: Iterable[Sent]) -> list[str]:
        """Return the workers that hold things, one for each; "" if nobody does any more."""
        futures = [one.future for one in held]
        try:
            found = self._client.who_has(futures)
        except OSError:
            raise self._lost() from None
        return [min(found.get(future.key, ()), default="") for future in futures]

    def _forsaken(self) -> WorkerError:
        return WorkerError(f"{self.place} has no workers, waited {PATIENCE:g} s; {STAYS}")

    def _lost(self) -> WorkerError:
        return WorkerError(f"the connection to {self.place} is lost; {STAYS}")
