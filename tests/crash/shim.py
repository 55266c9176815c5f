"""What stands between a process and its grid file (shim.c): compiled, preloaded and armed."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).with_name("shim.c")
NAME = "possmap-shim.so"


class Op(IntEnum):
    """What is done to a grid file, its journal or their folder."""

    CREATE = 0
    WRITE = 1
    SYNC = 2
    TRUNCATE = 3
    UNLINK = 4
    READ = 5
    MARK = 6  # nothing: a commit was reported done


CHANGES = (Op.CREATE, Op.WRITE, Op.SYNC, Op.TRUNCATE, Op.UNLINK)


class Action(IntEnum):
    """What happens at the chosen operation."""

    COUNT = 0  # nothing
    KILL = 1  # the process is killed before it
    TEAR = 2  # … after half of a write
    FAIL = 3  # it fails
    SHORTEN = 4  # half of a write is done, and that is said


@dataclass(frozen=True, slots=True)
class Strike:
    """What goes wrong with which operation.

    ops : kinds of operations that count.
    at : which of these, from 1.
    error : the errno of one that fails.
    for_good : all later ones fail too.
    """

    action: Action = Action.COUNT
    ops: Sequence[Op] = CHANGES
    at: int = 0
    error: int = 0
    for_good: bool = False


def preload(folder: Path) -> None:
    """Start this very command again with the shim in it, unless it is.

    Raises
    ------
    RuntimeError
        If there is no C compiler, or the system knows no LD_PRELOAD.
    """
    if _preloaded() is not None:
        return
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        raise RuntimeError("needs Linux and a C compiler")
    library = folder / NAME
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
    subprocess.run(command, check=True)
    command = [sys.executable, *sys.argv]
    os.execve(sys.executable, command, {**os.environ, "LD_PRELOAD": str(library)})


def _preloaded() -> str | None:
    path = os.environ.get("LD_PRELOAD", "")
    return path if path.endswith(NAME) else None


@cache
def _library() -> ctypes.CDLL:
    path = _preloaded()
    assert path is not None, "preload() was not called"
    return ctypes.CDLL(path)


def arm(grid: Path, strike: Strike, trace: int, counts: int) -> None:
    """Begin to count what this process does to a grid file, and strike when it is time.

    trace : a descriptor to write down what is done, or -1.
    counts : the address of as many 64-bit integers as there are kinds of operations.
    """
    path = os.fsencode(grid.resolve())
    mask = sum(1 << op for op in strike.ops)
    _library().shim_arm(
        path, int(strike.action), mask, ctypes.c_long(strike.at), strike.error,
        int(strike.for_good), trace, ctypes.c_void_p(counts),
    )  # fmt: skip


def mark() -> None:
    """Note in the trace that something was reported done."""
    _library().shim_mark()
