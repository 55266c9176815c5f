"""Several processes on one grid at once: writers, readers, and one that holds its lock for long."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path

from crash.aftermath import Tally, promise
from crash.batches import FINE, Batch, outings
from crash.child import Child, run

from possmap.grid import database
from possmap.grid.verify import verify

SOON_S = 60.0
"""How long a busy machine may take for what is soon."""

TOO_EARLY = ("does not exist", "no such file", "empty: a first fuse")


def rounds(folder: Path, count: int, seed: int, short: bool = False) -> Tally:
    """Let 2, 4 and 8 processes fuse into one grid, while others read it, each ``count`` times.

    Into a new grid and into a known one; each is given logs of its own, or most of all logs; and
    with half of the writers killed.

    Parameters
    ----------
    short
        Fewer logs, most of them each, and half of the writers killed.
    """
    tally, chance = Tally(), random.Random(seed)
    options = ("--set", "transaction_records=10", *FINE)
    before = Batch("before", outings(folder / "before", 4, 11), folder, options)
    logs = outings(folder / "logs", 10 if short else 32, 12)
    new = Batch("all, new grid", logs, folder, options)
    known = Batch("all, known grid", logs, folder, options, before.undisturbed)
    for _, writers, whole in product(range(count), (2, 4, 8), (new, known)):
        shares = [list(logs[number::writers]) for number in range(writers)]
        most = [chance.sample(logs, len(logs) * 2 // 3) + share for share in shares]
        ways = (("most", most, True), ("most", most, False), ("own", shares, False))
        for what, some, kill in ways[: 1 if short else 3]:
            with tally.trying(f"{writers} writers, {what} logs each, {whole.name}, kill={kill}"):
                _at_once(tally, whole, some, chance if kill else None)
    return tally


def _at_once(
    tally: Tally, whole: Batch, shares: Sequence[Sequence[Path]], kill: random.Random | None
) -> None:
    grid = whole.folder / "shared.possmap"
    whole.begin(grid)
    commands = [["fuse", *map(str, some), "-g", str(grid), *whole.options] for some in shares]
    children = [Child(command, grid) for command in commands]
    doomed = children[::2] if kill is not None else []
    try:
        if kill is not None:
            start = time.monotonic()
            moments = sorted(kill.uniform(0, whole.seconds) for _ in doomed)
            for child, moment in zip(doomed, moments, strict=True):
                time.sleep(max(0.0, start + moment - time.monotonic()))
                os.kill(child.pid, signal.SIGKILL)
        _read_meanwhile(grid, children, whole.base is not None, tally)
    finally:
        ended = [child.wait() for child in children]
    for child, end in zip(children, ended, strict=True):
        tally.counts["writers killed" if end.was_killed else "writers done"] += 1
        fine = end.code == 0 or (child in doomed and end.was_killed)
        promise(fine, f"a writer: {end.code} {end.stderr}")
    if doomed:
        for command in commands:
            again = run(command, grid)
            promise(again.code == 0, f"given again: {again.stderr}")
    verdict = verify(grid, full=True)
    promise(verdict.is_sound, f"verify: {verdict.faults[:3]}")
    promise(verdict.digest == whole.digest, "the digest is not that of all logs")


def _read_meanwhile(grid: Path, children: Sequence[Child], known: bool, tally: Tally) -> None:
    picture = grid.with_suffix(".png")
    commands = (
        ["info", str(grid)],
        ["query", str(grid), "0.1", "0.2"],
        ["render", str(grid), "-o", str(picture), "--overwrite", "--max-size", "300"],
    )
    turn = 0
    while any(child.runs() for child in children) or turn < len(commands):
        ended = run(commands[turn % len(commands)], grid)
        turn += 1
        early = not known and any(text in ended.stderr for text in TOO_EARLY)
        tally.counts["readers too early" if early else "readers"] += 1
        promise(ended.code == 0 or early, f"a reader: {ended.code} {ended.stderr}")


@contextmanager
def holding(grid: Path, *statements: str) -> Iterator[Callable[[], None]]:
    """Let another process run statements of SQL and hold its locks; yields what lets go."""
    ready, go = os.pipe(), os.pipe()
    pid = os.fork()
    if not pid:
        connection = sqlite3.connect(grid, timeout=SOON_S, isolation_level=None)
        for statement in statements:
            connection.execute(statement).fetchall()
        os.write(ready[1], b"1")
        os.read(go[0], 1)
        os._exit(0)
    os.read(ready[0], 1)
    held = [True]

    def release() -> None:
        if held.pop():
            held.append(False)
            os.write(go[1], b"1")
            os.waitpid(pid, 0)

    try:
        yield release
    finally:
        if held[0]:
            release()
        for descriptor in (*ready, *go):
            os.close(descriptor)


def said_soon(child: Child, text: str) -> bool:
    """Wait until a process says something; False if it ends without, or takes too long."""
    end = time.monotonic() + SOON_S
    while text not in child.said() and child.runs() and time.monotonic() < end:
        time.sleep(0.02)
    return text in child.said()


def one_that_waits(folder: Path) -> Tally:
    """Let one process wait for another: it says so, goes on when it can, and has a limit."""
    tally = Tally()
    batch = Batch("waited for", outings(folder / "waiting", 3, 13), folder, FINE)
    more = [str(log) for log in outings(folder / "later", 3, 14)]
    grid = folder / "waiting.possmap"
    fuse, info = ["fuse", *more, "-g", str(grid)], ["info", str(grid)]
    for what, command, does, *held in (
        ("a writer for a writer", fuse, "writes", "BEGIN IMMEDIATE"),
        ("a writer for a reader", fuse, "reads", "BEGIN", "SELECT count(*) FROM tile"),
        ("a reader for a writer", info, "writes", "BEGIN EXCLUSIVE"),
    ):
        shutil.copy(batch.undisturbed, grid)
        note = f"possmap: waiting for another process that {does} {grid}…\n"
        with tally.trying(f"{what}, then goes on"), holding(grid, *held) as release:
            child = Child(command, grid)
            promise(said_soon(child, note), f"says nothing: {child.said()}")
            release()
            ended = child.wait()
            promise(ended.code == 0 and ended.stderr == note, f"{ended.code}: {ended.stderr}")
        shutil.copy(batch.undisturbed, grid)
        with tally.trying(f"{what}, then gives up"), holding(grid, *held):
            ended = run(command, grid, before=_impatient)
            limit = f"possmap: {grid}: in use by another process for more than 1 s; try again\n"
            promise(ended.code == 1, f"exit code {ended.code}")
            promise(ended.stderr == note + limit, f"says: {ended.stderr}")
        with tally.trying(f"{what}, unharmed"):
            verdict = verify(grid, full=True)
            promise(verdict.is_sound and verdict.digest == batch.digest, str(verdict.faults[:3]))
    tally.counts["processes that waited"] += 6
    return tally


def _impatient() -> None:
    sys.modules[database.__name__].WAIT_S = 1.4  # type: ignore[attr-defined]
