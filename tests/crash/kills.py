"""SIGKILL at random moments, before chosen statements of SQL, and at chosen calls of the system."""

from __future__ import annotations

import random
import shutil
import sqlite3
import time
from collections.abc import Sequence
from contextlib import closing

from crash.aftermath import Tally, completes, promise, whole_logs
from crash.batches import Batch, journal
from crash.child import Child, Ended, Phase, run
from crash.shim import CHANGES, Action, Op, Strike
from teams import digest

from possmap.grid.verify import verify

WORKERS_END_S = 15.0
"""How long processes of ``--jobs`` may outlive the one that started them."""

_WORDS = {
    Phase.BEFORE: "before the first transaction",
    Phase.INSIDE: "inside a transaction",
    Phase.COMMIT: "in a commit",
    Phase.BETWEEN: "between transactions",
    Phase.DONE: "after the last",
}


def at_random(batches: Sequence[Batch], count: int, jobs: int, seed: int) -> Tally:
    """Kill at moments drawn evenly from the time that the command takes.

    Every other one from its first transaction on: starting takes most of the time. Half of the
    killed commands are killed again when they are given again.
    """
    tally, chance = Tally(), random.Random(seed)
    how = f"killed, --jobs {jobs}"
    lasts: dict[str, tuple[float, float]] = {}
    for turn in range(3 * count):
        batch = batches[turn % len(batches)]
        if turn % (10 * len(batches)) < len(batches):  # a busy machine takes now longer, now less
            lasts[batch.name] = _lasts(batch, jobs)
        grid = batch.folder / "killed.possmap"
        batch.begin(grid)
        again = True
        while again and tally.counts[how] < count:
            at_work = chance.random() < 0.5
            delay = chance.random() * lasts[batch.name][at_work]
            with tally.trying(f"{batch.name}, --jobs {jobs}, killed after {delay:.3f} s"):
                child = Child(batch.command(grid, jobs), grid)
                _note(tally, child.wait(delay, at_work), f"--jobs {jobs}")
                if jobs > 1:
                    _no_orphans(child, tally)
                whole_logs(grid, batch)
            again = chance.random() < 0.5
        with tally.completing(f"{batch.name}, --jobs {jobs}, completed"):
            completes(grid, batch, jobs if chance.random() < 0.3 else 1)
        if tally.counts[how] >= count:
            break
    return tally


def _lasts(batch: Batch, jobs: int) -> tuple[float, float]:
    """Return the seconds that it takes, and those from its first transaction on."""
    grid = batch.folder / "timed.possmap"
    batch.begin(grid)
    ended = run(batch.command(grid, jobs), grid)
    return ended.seconds, ended.working


def before_statements(batches: Sequence[Batch], count: int) -> Tally:
    """Kill before statements of SQL, spread evenly over all of a run."""
    tally = Tally()
    for batch in batches:
        for at in _spread(batch.ended.statements, count // len(batches)):
            grid = batch.folder / "killed.possmap"
            batch.begin(grid)
            with tally.trying(f"{batch.name}, killed before statement {at}"):
                ended = run(batch.command(grid), grid, kill_at_statement=at)
                promise(ended.was_killed, f"was not killed: {ended.code} {ended.stderr}")
                _note(tally, ended, "before a statement")
                whole_logs(grid, batch)
                completes(grid, batch)
    return tally


def at_calls(batches: Sequence[Batch], count: int) -> Tally:
    """Kill before calls that change the files, or in the middle of writing."""
    tally = Tally()
    for batch in batches:
        each = count // len(batches) // 2
        calls = sum(batch.ended.ops[op] for op in CHANGES)
        strikes = [Strike(Action.KILL, at=at) for at in _spread(calls, each)]
        writes = _spread(batch.ended.ops[Op.WRITE], each)
        strikes += [Strike(Action.TEAR, (Op.WRITE,), at) for at in writes]
        for strike in strikes:
            grid = batch.folder / "killed.possmap"
            batch.begin(grid)
            with tally.trying(f"{batch.name}, {strike}"):
                ended = run(batch.command(grid), grid, strike)
                promise(ended.was_killed, f"was not killed: {ended.code} {ended.stderr}")
                torn = "in the middle of a write" if strike.action is Action.TEAR else "at a call"
                _note(tally, ended, torn)
                whole_logs(grid, batch)
                completes(grid, batch)
    return tally


def of_forget(batch: Batch, count: int) -> Tally:
    """Kill ``possmap forget``: a robot's evidence is all there afterwards, or none of it."""
    tally = Tally()
    grid = batch.folder / "forgetful.possmap"
    with closing(sqlite3.connect(batch.undisturbed)) as connection:
        (robot,) = connection.execute("SELECT max(robot) FROM excursion").fetchone()
    command = ["forget", str(grid), "--robot", robot]
    shutil.copy(batch.undisturbed, grid)
    ended = run(command, grid)
    promise(ended.code == 0, ended.stderr)
    without = digest(grid)
    for at in _spread(sum(ended.ops[op] for op in CHANGES), count):
        shutil.copy(batch.undisturbed, grid)
        journal(grid).unlink(missing_ok=True)
        with tally.trying(f"{batch.name}, forget killed at call {at}"):
            _note(tally, run(command, grid, Strike(Action.KILL, at=at)), "at a call")
            verdict = verify(grid, full=True)
            promise(verdict.is_sound, f"verify: {verdict.faults[:3]}")
            promise(verdict.digest in (batch.digest, without), "half forgotten")
            tally.counts["forgotten" if verdict.digest == without else "as before"] += 1
            again = run(command, grid)
            promise(again.code == 0 and digest(grid) == without, f"given again: {again.stderr}")
    return tally


def _spread(whole: int, count: int) -> list[int]:
    """Return up to ``count`` of 1 … ``whole``, evenly spread, with both ends."""
    count = min(whole, count)
    return sorted({1 + round(n * (whole - 1) / max(1, count - 1)) for n in range(count)})


def _note(tally: Tally, ended: Ended, how: str) -> None:
    if ended.was_killed:
        tally.counts[f"killed, {how}"] += 1
        tally.counts[_WORDS[ended.phase]] += 1
    else:
        promise(ended.code == 0, f"exit code {ended.code}: {ended.stderr}")
        tally.tried -= 1  # it was done before


def _no_orphans(child: Child, tally: Tally) -> None:
    """Wait until the workers of a killed process have ended too."""
    start = time.monotonic()
    left = child.left_behind()
    tally.counts["workers left at first"] += len(left)
    while left and time.monotonic() - start < WORKERS_END_S:
        time.sleep(0.02)
        left = child.left_behind()
    longest = "ms that the longest outlived it"
    tally.counts[longest] = max(tally.counts[longest], round(1000 * (time.monotonic() - start)))
    promise(not left, f"{len(left)} processes of --jobs outlive their parent")
