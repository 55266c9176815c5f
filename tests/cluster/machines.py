"""A real scheduler and real workers, each a process of its own, as somebody would start them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FAULTS = Path(__file__).with_name("faults.py")
NO_PAGE = ("--no-dashboard", "--dashboard-address=127.0.0.1:0")


class Machines:
    """One scheduler and its workers.

    Attributes
    ----------
    address
        Of the scheduler.
    workers
        The processes, in the order in which they were started.
    """

    def __init__(self, folder: Path, **environment: str) -> None:
        folder.mkdir()
        self._folder = folder
        self._environment = {**os.environ, **environment}
        self.workers: list[subprocess.Popen[bytes]] = []
        told = folder / "scheduler.json"
        self.scheduler = self._start(
            "dask_scheduler", "--host=127.0.0.1", "--port=0", f"--scheduler-file={told}"
        )
        self.address = str(self._read(told)["address"])

    def add(self, *options: str, nanny: bool = False) -> None:
        """Start a worker with one thread."""
        self.workers.append(
            self._start(
                "dask_worker", self.address, "--host=127.0.0.1", "--nthreads=1",
                f"--local-directory={self._folder}", "--nanny" if nanny else "--no-nanny",
                *options,
            )
        )  # fmt: skip

    def add_faulty(self, *faults: str, nanny: bool = False) -> None:
        """Start a worker with some of the faults of ``faults.py``."""
        self._environment["FAULTS"] = " ".join(faults)
        self.add(f"--preload={FAULTS}", nanny=nanny)

    def stop(self) -> None:
        """End all processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start(self, program: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *NO_PAGE, *options]
        return subprocess.Popen(
            command,
            env=self._environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self._folder,
        )

    def _read(self, told: Path) -> dict[str, object]:
        for _ in range(600):
            try:
                found: dict[str, object] = json.loads(told.read_text())
                return found
            except (OSError, ValueError):  # not yet, or not whole
                time.sleep(0.05)
        raise TimeoutError("the scheduler did not start")


@contextmanager
def machines(folder: Path, workers: int = 0, **environment: str) -> Iterator[Machines]:
    """Start a scheduler and workers, and end them in the end."""
    found = Machines(folder, **environment)
    try:
        for _ in range(workers):
            found.add()
        yield found
    finally:
        found.stop()
