"""What is fused and disturbed: batches of logs, and what becomes of them undisturbed."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from crash import child
from crash.child import Ended
from literal.teams import random_excursion
from teams import digest, write_logs

from possmap.lab.simulate.run import simulate
from possmap.settings.shipped import shipped

FINE = ("--set", "max_error=0.8", "--resolution", "0.05")


@dataclass
class Batch:
    """Logs to be fused in one command, into a new grid or into a known one.

    base : the known grid; None: a new one.
    options : of the command.
    """

    name: str
    logs: Sequence[Path]
    folder: Path
    options: Sequence[str] = ()
    base: Path | None = None
    _digests: dict[frozenset[str], str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.undisturbed = self.folder / f"{self.name}.undisturbed.possmap"
        self.ended = self.fused(self.undisturbed)
        self.digest = digest(self.undisturbed)
        known = set() if self.base is None else set(sources(self.base))
        self.order = [name for name in sources(self.undisturbed) if name not in known]
        self.seconds = self.ended.seconds
        """What it takes lately."""

    def command(self, grid: Path, jobs: int = 1) -> list[str]:
        """Return the arguments that fuse all of it into a grid."""
        logs = [str(log) for log in self.logs]
        return ["fuse", *logs, "-g", str(grid), "--jobs", str(jobs), *self.options]

    def begin(self, grid: Path) -> None:
        """Put the grid there as it was before."""
        for path in (grid, journal(grid)):
            path.unlink(missing_ok=True)
        if self.base is not None:
            shutil.copy(self.base, grid)

    def fused(self, grid: Path) -> Ended:
        """Fuse it from the beginning, undisturbed."""
        self.begin(grid)
        ended = child.run(self.command(grid), grid)
        assert ended.code == 0, ended.stderr
        return ended

    def digest_of(self, names: Iterable[str]) -> str:
        """Return the digest of a grid that holds exactly these of the logs."""
        chosen = frozenset(names)
        if chosen not in self._digests:
            grid = self.folder / f"{self.name}.part.possmap"
            self.begin(grid)
            logs = [str(log) for log in self.logs if str(log) in chosen]
            assert len(logs) == len(chosen), "the grid claims a log that was never given"
            if logs:
                ended = child.run(["fuse", *logs, "-g", str(grid), *self.options], grid)
                assert ended.code == 0, ended.stderr
            self._digests[chosen] = digest(grid) if grid.exists() else ""
        return self._digests[chosen]


def journal(grid: Path) -> Path:
    """Return the file that exists beside a grid while somebody writes."""
    return grid.with_name(grid.name + "-journal")


def sources(grid: Path) -> list[str]:
    """Return the logs that brought a grid something, in their order."""
    sql = "SELECT name FROM arrival JOIN source ON source.id = source ORDER BY arrival.id"
    with closing(sqlite3.connect(grid)) as connection:
        return list(dict.fromkeys(name for (name,) in connection.execute(sql)))


def outings(folder: Path, count: int, seed: int) -> list[Path]:
    """Write some random logs."""
    rng = np.random.default_rng(seed)
    made = [{"possmap_log": 1, **random_excursion(rng, f"r{seed}.{n}", "a")} for n in range(count)]
    return write_logs(folder, made)


def batches(folder: Path, short: bool = False) -> list[Batch]:
    """Return batches of several shapes.

    short : only the first two, and smaller.
    """
    count = 8 if short else 24
    logs, more = outings(folder / "logs", count, 9), outings(folder / "more", count, 10)
    each = ("--set", "transaction_records=30", *FINE)
    many = Batch("many transactions, new grid", logs, folder, each)
    known = Batch("many transactions, known grid", more, folder, each, many.undisturbed)
    if short:
        return [many, known]
    simulate(shipped("missions/figure8.yaml"), folder / "troupe", {"minutes": "8"})
    carried = sorted((folder / "troupe/logs").iterdir())
    few = ("--set", "transaction_records=400", "--profile", "robust")
    return [
        many,
        known,
        Batch("one transaction, known grid", more, folder, FINE, many.undisturbed),
        Batch("one strict transaction, new grid", logs, folder, ("--strict", *each)),
        Batch("troupe with carried copies, new grid", carried, folder, few),
    ]
