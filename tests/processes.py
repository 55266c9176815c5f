"""Helpers of the tests: groups of processes, as a terminal makes them, and who is in them."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def hear_ctrl_c() -> None:
    """Undo, in a new process, what a shell does to what it starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def members(group: int) -> dict[int, str]:
    """Return the live processes of a group, with their commands."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            state, _, its_group = _status(path)[:3]
            command = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:  # it has ended
            continue
        if int(its_group) == group and state != "Z":
            found[int(path.name)] = command
    return found


def workers(group: int) -> set[int]:
    """Return the processes of a group that do work for another."""
    return {pid for pid, command in members(group).items() if "spawn_main" in command}


def cpu_seconds(pid: int) -> float:
    """Return what a process has taken so far; nothing if it has ended."""
    try:
        status = _status(Path(f"/proc/{pid}"))
    except OSError:
        return 0.0
    return (int(status[11]) + int(status[12])) / os.sysconf("SC_CLK_TCK")


def _status(path: Path) -> list[str]:
    """Return what /proc says of a process, from its state on."""
    return (path / "stat").read_text().rpartition(")")[2].split()
