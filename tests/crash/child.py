"""Runs ``possmap`` in a process forked from one that has imported it: hundreds in a minute."""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NoReturn

from crash import shim
from crash.shim import Op, Strike

import possmap.cli.fuse
import possmap.cli.main
import possmap.cli.progress
import possmap.core.kernel

# All that a command imports late is imported here, so that no child has to.
import possmap.fusing.fuse
import possmap.inspection.info
from possmap.grid.database import Database


class Phase(IntEnum):
    """Where a process was when it ended."""

    BEFORE = 0  # its first transaction
    INSIDE = 1  # a transaction
    COMMIT = 2
    BETWEEN = 3  # transactions, or after the last
    DONE = 4


_OPS, _PHASE, _STATEMENTS, _COMMITS, _BEGAN_NS = 0, 8, 9, 10, 11


class _Shared:
    """Numbers that outlive the child: operations, phase, statements and commits."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, mmap.PAGESIZE)
        self._view = memoryview(self._memory).cast("q")
        self.address = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))

    def __getitem__(self, place: int) -> int:
        return self._view[place]

    def __setitem__(self, place: int, value: int) -> None:
        self._view[place] = value


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended.

    code : its exit code, or minus the signal that killed it.
    seconds, working : it took, and from its first transaction on.
    ops, statements, commits : how many it came to.
    """

    code: int
    stderr: str
    stdout: str
    seconds: float
    working: float
    phase: Phase
    ops: dict[Op, int]
    statements: int
    commits: int

    @property
    def was_killed(self) -> bool:
        """Whether SIGKILL ended it."""
        return self.code == -signal.SIGKILL


class Child:
    """A command that runs, in a session of its own.

    Parameters
    ----------
    grid
        Of which file the operations count.
    kill_at_statement
        It kills itself before that statement of SQL, from 1.
    trace
        A file that gets what it does to the grid.
    before
        What it does first.
    after
        What it does last, unless it is killed.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        grid: Path,
        strike: Strike | None = None,
        *,
        kill_at_statement: int = 0,
        trace: Path | None = None,
        before: Callable[[], object] | None = None,
        after: Callable[[], object] | None = None,
    ) -> None:
        self._shared = _Shared()
        self._stderr, self._stdout = (os.memfd_create(name) for name in ("stderr", "stdout"))
        self._start = time.monotonic()
        self.pid = os.fork()
        if self.pid:
            return
        code = 70
        try:
            os.setsid()
            os.dup2(self._stdout, 1)
            os.dup2(self._stderr, 2)
            sys.stdout = os.fdopen(1, "w", closefd=False)
            sys.stderr = os.fdopen(2, "w", closefd=False)
            if before is not None:
                before()
            _watch(self._shared, kill_at_statement)
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            traced = -1 if trace is None else os.open(trace, flags)
            shim.arm(grid, strike or Strike(), traced, self._shared.address)
            code = _exit_code(arguments)
            self._shared[_PHASE] = Phase.DONE
            if after is not None:
                after()
        except BaseException:
            traceback.print_exc()
        _leave(code)

    def wait(self, kill_after: float | None = None, at_work: bool = False) -> Ended:
        """Wait for the end, or kill it after some seconds.

        at_work : they count from its first transaction on.
        """
        if kill_after is not None:
            while at_work and not self._shared[_BEGAN_NS] and self.runs():
                time.sleep(0.0005)
            began = self._shared[_BEGAN_NS] / 1e9 if at_work else self._start
            time.sleep(max(0.0, began + kill_after - time.monotonic()))
            os.kill(self.pid, signal.SIGKILL)
        _, status = os.waitpid(self.pid, 0)
        now = time.monotonic()
        seconds = now - self._start
        working = now - self._shared[_BEGAN_NS] / 1e9 if self._shared[_BEGAN_NS] else 0.0
        shared, texts = self._shared, []
        for stream in (self._stderr, self._stdout):
            os.lseek(stream, 0, os.SEEK_SET)
            with os.fdopen(stream, encoding="utf-8", errors="replace") as text:
                texts.append(text.read())
        return Ended(
            os.waitstatus_to_exitcode(status), texts[0], texts[1], seconds, working,
            Phase(shared[_PHASE]), {op: shared[_OPS + op] for op in Op},
            shared[_STATEMENTS], shared[_COMMITS],
        )  # fmt: skip

    def said(self) -> str:
        """Return what it wrote on stderr so far."""
        return os.pread(self._stderr, 1 << 16, 0).decode(errors="replace")

    def left_behind(self) -> list[int]:
        """Return the processes that it started and that still run."""
        return [pid for pid in _processes() if _session(pid) == self.pid]

    def runs(self) -> bool:
        """Whether it has not ended yet; it is not waited for."""
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None


def run(arguments: Sequence[str], grid: Path, strike: Strike | None = None, **more: Any) -> Ended:
    """Run a command to its end; the parameters are those of ``Child``."""
    return Child(arguments, grid, strike, **more).wait()


def _exit_code(arguments: Sequence[str]) -> int:
    try:
        possmap.cli.main.main(list(arguments))
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    return 0


def _leave(code: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)


def _watch(shared: _Shared, kill_at_statement: int) -> None:
    """Note where the process is; kill it before a statement of SQL."""

    def counted(method: Any) -> Any:
        def wrapper(self: Database, sql: str, *values: Any) -> Any:
            shared[_STATEMENTS] += 1
            if shared[_STATEMENTS] == kill_at_statement:
                os.kill(os.getpid(), signal.SIGKILL)
            if sql == "COMMIT":
                shared[_PHASE] = Phase.COMMIT
            result = method(self, sql, *values)
            if sql == "BEGIN IMMEDIATE":
                shared[_PHASE] = Phase.INSIDE
                shared[_BEGAN_NS] = shared[_BEGAN_NS] or time.monotonic_ns()
            elif sql == "COMMIT":
                shim.mark()
                shared[_COMMITS] += 1
                shared[_PHASE] = Phase.BETWEEN
            return result

        return wrapper

    for name in ("execute", "many", "one", "all"):
        setattr(Database, name, counted(getattr(Database, name)))


def _processes() -> list[int]:
    return [int(name) for name in os.listdir("/proc") if name.isdigit()]  # noqa: PTH208


def _session(pid: int) -> int:
    try:
        state, _, _, session, *_ = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (OSError, ValueError):
        return -1
    return -1 if state == "Z" else int(session)
