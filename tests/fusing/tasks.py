"""What processes of ``--jobs`` are asked to do in the tests; they import it by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from possmap.errors import GridError, LogError

UNHEARD = {
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
}


class Unsendable(Exception):
    """An error that no other process can be told as it is."""

    def __reduce__(self) -> str:
        raise TypeError


def square(number: int) -> int:
    return number * number


def power(number: int) -> int:
    return 2**number


def refuse(number: int) -> int:
    raise GridError(f"tile {number}")


def stumble(number: int) -> int:
    return 1 // number


def fail_unsendably(number: int) -> int:
    raise Unsendable(f"number {number}")


def refuse_a_log() -> None:
    raise LogError("a:3", "wrong")


def send(size: int) -> bytes:
    return bytes(size)


def unheard(_: int) -> set[signal.Signals]:
    return {one for one in signal.pthread_sigmask(signal.SIG_BLOCK, ()) if one in UNHEARD}


def sleep(folder: Path) -> None:
    (folder / f"{os.getpid()}-{time.monotonic_ns()}").touch()
    time.sleep(60)
