"""Power cuts, simulated: of what was written and not yet synced, a random part is on the disk.

The model: a file is what it was at its last ``fsync``; of each block of 4 KiB written since, any of
the states that it had since then may be there, and the file may have any of the lengths that it
had. That a file was made or removed is certain once its folder was synced; until then it may be so.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crash.aftermath import Lost, Tally, Unnoticed, completes, whole_logs
from crash.batches import Batch, journal
from crash.child import run
from crash.shim import Op, Strike

from possmap.grid.database import Database

BLOCK = 4096
GRID, JOURNAL, FOLDER = 1, 2, 3  # as in shim.c


@dataclass(frozen=True, slots=True)
class Call:
    """One thing done to a file. offset : for TRUNCATE, the new length."""

    op: Op
    file: int
    offset: int
    data: bytes


def traced(batch: Batch, grid: Path, before: Callable[[], object] | None = None) -> list[Call]:
    """Fuse a batch, and return everything that was done to the grid."""
    trace = batch.folder / "trace"
    batch.begin(grid)
    ended = run(batch.command(grid), grid, Strike(), trace=trace, before=before)
    assert ended.code == 0, ended.stderr
    return list(_calls(trace.read_bytes()))


def _calls(raw: bytes) -> Iterator[Call]:
    at = 0
    while at < len(raw):
        op, file, offset, size = struct.unpack_from("=4q", raw, at)
        at += 32
        data = raw[at : at + size] if op == Op.WRITE else b""
        at += len(data)
        yield Call(Op(op), file, offset, data)


@dataclass
class _File:
    """A file on a disk that has not yet been given everything.

    safe : what is certain.
    now : what a process reads.
    lengths, blocks : what it may be instead: every length, and every state of each block, since.
    """

    safe: bytes = b""
    now: bytearray = field(default_factory=bytearray)
    lengths: list[int] = field(default_factory=list)
    blocks: dict[int, list[bytes]] = field(default_factory=dict)

    def write(self, offset: int, data: bytes) -> None:
        end = offset + len(data)
        if len(self.now) < end:
            self.now.extend(bytes(end - len(self.now)))
        self.now[offset:end] = data
        self.lengths.append(len(self.now))
        for number in range(offset // BLOCK, (end - 1) // BLOCK + 1):
            state = bytes(self.now[number * BLOCK : (number + 1) * BLOCK])
            self.blocks.setdefault(number, []).append(state)

    def truncate(self, length: int) -> None:
        self.now = self.now[:length].ljust(length, b"\0")
        self.lengths.append(length)

    def sync(self) -> None:
        self.safe = bytes(self.now)
        self.lengths.clear()
        self.blocks.clear()

    def after_cut(self, chance: random.Random, lost: float) -> bytes:
        """Return what is on the disk; ``lost``: how likely a block's last states are not."""
        found = bytearray(self.safe)
        if self.lengths and chance.random() > lost / 2:
            length = chance.choice([self.lengths[-1], *self.lengths])
            found = found[:length].ljust(length, b"\0")
        for number, states in self.blocks.items():
            if chance.random() >= lost:
                state = chance.choice([states[-1], *states])
                part = found[number * BLOCK : (number + 1) * BLOCK]
                found[number * BLOCK : number * BLOCK + len(part)] = state[: len(part)].ljust(
                    len(part), b"\0"
                )
        return bytes(found)


class Disk:
    """What is certain, and what may be, after the calls so far."""

    def __init__(self, grid: bytes | None, *, lies: bool = False) -> None:
        self._lies = lies
        self._now: dict[int, _File | None] = {GRID: None, JOURNAL: None}
        if grid is not None:
            self._now[GRID] = _File(grid, bytearray(grid))
        self._names: dict[int, list[_File | None]] = {}
        self._settle()

    def _settle(self) -> None:
        """Make the folder certain: each name leads where it leads now, and nowhere else."""
        self._names = {name: [file] for name, file in self._now.items()}

    def do(self, call: Call) -> None:
        """Take in the next call."""
        if call.op is Op.SYNC and self._lies:
            return
        file = self._now.get(call.file)
        if call.op is Op.CREATE:
            self._rename(call.file, _File())
        elif call.op is Op.UNLINK:
            self._rename(call.file, None)
        elif call.op is Op.SYNC and call.file == FOLDER:
            self._settle()
        elif call.op is Op.MARK:
            return
        else:
            assert file is not None, "a file that is not there is written to"
            if call.op is Op.WRITE:
                file.write(call.offset, call.data)
            elif call.op is Op.TRUNCATE:
                file.truncate(call.offset)
            else:
                file.sync()

    def _rename(self, name: int, file: _File | None) -> None:
        self._now[name] = file
        self._names[name].append(file)

    def leave(self, grid: Path) -> None:
        """Leave everything in the folder."""
        self._put(
            grid,
            {name: None if file is None else bytes(file.now) for name, file in self._now.items()},
        )

    def cut(self, grid: Path, chance: random.Random) -> None:
        """Leave in the folder what may be there after the power has failed."""
        lost, left = chance.choice([0.0, 0.1, 0.5, 0.9, 1.0]), {}
        for name, states in self._names.items():
            file = states[0] if chance.random() < lost else chance.choice([states[-1], *states])
            left[name] = None if file is None else file.after_cut(chance, lost)
        self._put(grid, left)

    @staticmethod
    def _put(grid: Path, left: Mapping[int, bytes | None]) -> None:
        for name, path in ((GRID, grid), (JOURNAL, journal(grid))):
            path.unlink(missing_ok=True)
            data = left[name]
            if data is not None:
                path.write_bytes(data)


@dataclass(frozen=True, slots=True)
class Cut:
    """A moment of a run. done : how many commits were reported before it."""

    at: int
    done: int


WEAKER: Mapping[str, tuple[str, bool]] = {
    "synchronous FULL": ("FULL", False),
    "synchronous OFF": ("OFF", False),
    "EXTRA, and a disk that lies": ("EXTRA", True),
}
"""Less than possmap asks for: the setting of SQLite, and whether the disk only says it synced."""


def weaker(batches: Sequence[Batch], count: int, seed: int) -> Tally:
    """Cut the power where less is promised, and count what comes of it."""
    tally = Tally()
    for name, (setting, lies) in WEAKER.items():

        def weaken(setting: str = setting) -> None:
            execute = Database.execute

            def weakened(self: Database, sql: str, *values: Any) -> int:
                sql = sql.replace("synchronous = EXTRA", f"synchronous = {setting}")
                return execute(self, sql, *values)

            Database.execute = weakened  # type: ignore[method-assign, assignment]

        found = power_cuts(batches, count, seed, lies=lies, before=weaken)
        lost, unnoticed = (
            sum(f": {kind.__name__}: " in line for line in found.broken)
            for kind in (Lost, Unnoticed)
        )
        tally.tried += found.tried
        for what, times in (
            ("nothing lost", found.tried - len(found.broken)),
            ("sound, without logs that were reported", lost),
            ("damaged, and verify says so", len(found.broken) - lost - unnoticed),
            ("wrong, and verify does not say so", unnoticed),
        ):
            tally.counts[f"{name}: {what}"] += times
    return tally


def cuts(calls: Sequence[Call], count: int, chance: random.Random) -> list[Cut]:
    """Return moments of a run, evenly spread with some chance, and its end."""
    marks = [number for number, call in enumerate(calls) if call.op is Op.MARK]
    steps = [len(calls) * n / count for n in range(count)]
    places = sorted({int(step + chance.random() * len(calls) / count) for step in steps})
    return [Cut(at, sum(mark < at for mark in marks)) for at in [*places[:-1], len(calls)]]


def power_cuts(
    batches: Sequence[Batch],
    count: int,
    seed: int,
    *,
    lies: bool = False,
    before: Callable[[], object] | None = None,
) -> Tally:
    """Cut the power all along a run, and look as after a kill.

    What was reported as committed must be there.

    Parameters
    ----------
    lies
        The disk says that it has synced, and has not.
    before
        What the fusing process does first.
    """
    tally, chance = Tally(), random.Random(seed)
    for batch in batches:
        grid = batch.folder / "cut.possmap"
        calls = traced(batch, grid, before)
        reported = logs_by_commit(batch, calls)
        disk, done = Disk(_base(batch), lies=lies), 0
        for cut in cuts(calls, count // len(batches), chance):
            for call in calls[done : cut.at]:
                disk.do(call)
            done = cut.at
            with tally.trying(f"{batch.name}, power cut before call {cut.at}, seed {seed}"):
                disk.cut(grid, chance)
                held = whole_logs(grid, batch, least=reported[cut.done])
                tally.counts["some logs there" if held < len(batch.order) else "all there"] += 1
                completes(grid, batch)
    return tally


def logs_by_commit(batch: Batch, calls: Sequence[Call]) -> list[int]:
    """Return how many logs the grid holds after no commit, one, two, …."""
    grid = batch.folder / "replayed.possmap"
    disk, found = Disk(_base(batch)), [0]
    for call in calls:
        disk.do(call)
        if call.op is Op.MARK:
            disk.leave(grid)
            found.append(whole_logs(grid, batch))
    return found


def _base(batch: Batch) -> bytes | None:
    return None if batch.base is None else batch.base.read_bytes()
