"""A disk that fails: at any single call or from one on, full, or with a limit on file sizes."""

from __future__ import annotations

import ctypes
import errno
import os
import random
import re
import resource
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from crash.aftermath import Tally, completes, promise, whole_logs
from crash.batches import Batch, journal
from crash.child import Ended, run
from crash.shim import Action, Op, Strike

KINDS: Sequence[tuple[str, Op, Action, int]] = (
    ("write: no space left", Op.WRITE, Action.FAIL, errno.ENOSPC),
    ("write: I/O error", Op.WRITE, Action.FAIL, errno.EIO),
    ("write: half of it done", Op.WRITE, Action.SHORTEN, 0),
    ("sync: I/O error", Op.SYNC, Action.FAIL, errno.EIO),
    ("creation: no space left", Op.CREATE, Action.FAIL, errno.ENOSPC),
    ("creation: not allowed", Op.CREATE, Action.FAIL, errno.EACCES),
    ("removal: I/O error", Op.UNLINK, Action.FAIL, errno.EIO),
    ("reading: I/O error", Op.READ, Action.FAIL, errno.EIO),
)

FULL_DISK, SIZE_LIMIT = "a full disk", "a limit on file sizes"


def at_calls(batches: Sequence[Batch], count: int, seed: int) -> Tally:
    """Let calls fail, once or from then on: every kind of fault, spread over all of a run."""
    tally, chance = Tally(), random.Random(seed)
    trials = [
        (batch, name, Strike(action, (op,), at, error, for_good))
        for batch in batches
        for name, op, action, error in KINDS
        for for_good in (False, True)
        for at in range(1, batch.ended.ops[op] + 1)
    ]
    by_kind = {name: [one for one in trials if one[1] == name] for name, *_ in KINDS}
    for some in by_kind.values():
        chance.shuffle(some)
    while tally.tried < min(count, len(trials)):
        for name, some in by_kind.items():
            if some:
                batch, _, strike = some.pop()
                jobs = 2 if tally.tried % 8 == 7 else 1
                _try(tally, batch, name, f"{name}, {strike}, --jobs {jobs}", strike, jobs=jobs)
    return tally


def _try(
    tally: Tally,
    batch: Batch,
    name: str,
    what: str,
    strike: Strike | None = None,
    before: Callable[[], object] | None = None,
    jobs: int = 1,
) -> None:
    grid = batch.folder / "faulty.possmap"
    batch.begin(grid)
    with tally.trying(f"{batch.name}, {what}"):
        ended = run(batch.command(grid, jobs), grid, strike, before=before)
        tally.counts[f"--jobs {jobs}"] += 1
        _judge(tally, batch, grid, name, ended)


def _judge(tally: Tally, batch: Batch, grid: Path, name: str, ended: Ended) -> None:
    tally.counts[name] += 1
    held = whole_logs(grid, batch, least=0)
    if ended.code == 0:
        tally.counts["overcome, exit code 0"] += 1
        promise(not ended.stderr, f"says something: {ended.stderr}")
        promise(held == len(batch.order), "says that all is well, and it is not")
    else:
        tally.counts["refused in one line, exit code 1"] += 1
        lines = ended.stderr.splitlines()
        promise(ended.code == 1, f"exit code {ended.code}: {ended.stderr}")
        one_line = len(lines) == 1 and lines[0].startswith("possmap: ")
        promise(one_line, f"not one clear line: {ended.stderr}")
        tally.counts[re.sub(r"\S*\.possmap", "SITE", lines[0])] += 1
    completes(grid, batch)


def size_limits(batches: Sequence[Batch], count: int) -> Tally:
    """Forbid files larger than so and so much: one page … what the grid needs."""
    tally = Tally()
    for batch in batches:
        for limit in _steps(batch, count // len(batches), least=4096):

            def before(limit: int = limit) -> None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))

            _try(tally, batch, SIZE_LIMIT, f"files up to {limit} bytes", before=before)
    return tally


def full_disks(batches: Sequence[Batch], count: int) -> Tally:
    """Fuse on a small disk of its own, which only the child sees; none if that is not permitted."""
    tally = Tally()
    for batch in batches:
        for size in _steps(batch, count // len(batches), least=64 << 10):
            _on_small_disk(tally, batch, size)
    return tally


def _steps(batch: Batch, count: int, least: int = 0) -> list[int]:
    most = batch.undisturbed.stat().st_size
    low = least if batch.base is None else batch.base.stat().st_size
    return [low + (most - low) * n // count for n in range(count)]


def _on_small_disk(tally: Tally, batch: Batch, size: int) -> None:
    disk, grid = batch.folder / "disk", batch.folder / "faulty.possmap"
    disk.mkdir(exist_ok=True)
    there = disk / "faulty.possmap"
    batch.begin(grid)

    def mount() -> None:
        """Put a small disk there, and the grid on it."""
        _mount(disk, size)
        if grid.exists():
            shutil.copy(grid, there)

    def bring() -> None:
        """Put what is on it where everybody sees it."""
        for source, target in ((there, grid), (journal(there), journal(grid))):
            target.unlink(missing_ok=True)
            if source.exists():
                shutil.copy(source, target)

    command = batch.command(there)
    ended = run(command, there, before=mount, after=bring)
    if "PermissionError" in ended.stderr and "_mount" in ended.stderr:
        return
    with tally.trying(f"{batch.name}, a disk of {size} bytes"):
        _judge(tally, batch, grid, FULL_DISK, ended)


def _mount(folder: Path, size: int) -> None:
    """Mount a file system in memory that no other process sees.

    Raises
    ------
    PermissionError
        If this user may not.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    new_namespace, private = 0x00020000, 0x00040000 | 0x4000
    options = f"size={size}".encode()
    if (
        libc.unshare(new_namespace)
        or libc.mount(b"none", b"/", None, private, None)
        or libc.mount(b"tmpfs", os.fsencode(folder), b"tmpfs", 0, options)
    ):
        raise PermissionError(ctypes.get_errno(), "may not mount")
