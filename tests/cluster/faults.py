"""What may be wrong with a worker; ``dask worker --preload`` runs this in it."""

from __future__ import annotations

import importlib.metadata
import os
import signal
from typing import Any

from possmap.fusing.cluster import tasks
from possmap.fusing.stages import Read, ReadTask

FAULTS = os.environ["FAULTS"].split()
_read_logs = tasks.read_logs


def _read(task: ReadTask) -> list[Read]:
    if any("deadly" in name for name in task.names):
        os.kill(os.getpid(), signal.SIGKILL)  # as the kernel does where memory is short
    if any("huge" in name for name in task.names):
        raise MemoryError
    return _read_logs(task)


def _old(name: str) -> str:
    return "0.0.1"


def _none(name: str) -> Any:
    raise importlib.metadata.PackageNotFoundError(name)


if "logs" in FAULTS:
    tasks.read_logs = _read
if "old" in FAULTS:
    importlib.metadata.version = _old
if "none" in FAULTS:
    importlib.metadata.version = _none
