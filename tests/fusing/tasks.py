"""What processes of ``--jobs`` are asked to do in the tests; they import it by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from possmap.errors import GridError

LARGE = 1 << 20
"""More bytes than a pipe holds."""

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


def note(folder: Path) -> bytes:
    """Leave a file that says that this was done."""
    (folder / f"{os.getpid()}-{time.monotonic_ns()}").touch()
    return bytes(LARGE)


def die_at_2(number: int) -> bytes:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return bytes(LARGE)


def unheard(_: int) -> set[signal.Signals]:
    return {one for one in signal.pthread_sigmask(signal.SIG_BLOCK, ()) if one in UNHEARD}


def sleep(folder: Path) -> None:
    note(folder)
    time.sleep(60)
