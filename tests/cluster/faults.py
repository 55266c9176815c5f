"""What may be wrong with a worker; ``dask worker --preload`` runs this in it."""

from __future__ import annotations

import importlib.metadata
import os
import signal
from collections.abc import Sequence
from typing import Any

from possmap.fusing import reading
from possmap.fusing.reading import How, Read

FAULTS = os.environ["FAULTS"].split()
_read_logs = reading.read_logs


def _read(names: Sequence[str], how: How, at_once: bool) -> list[Read]:
    if any("deadly" in name for name in names):
        os.kill(os.getpid(), signal.SIGKILL)  # as the kernel does where memory is short
    if any("huge" in name for name in names):
        raise MemoryError
    return _read_logs(names, how, at_once)


def _old(name: str) -> str:
    return "0.0.1"


def _none(name: str) -> Any:
    raise importlib.metadata.PackageNotFoundError(name)


if "logs" in FAULTS:
    reading.read_logs = _read
if "old" in FAULTS:
    importlib.metadata.version = _old
if "none" in FAULTS:
    importlib.metadata.version = _none
