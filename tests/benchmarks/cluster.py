"""What ``possmap fuse --dask`` sends, and what it costs.

First without dask: every task is done by this process at once, as if by so many workers, and what
would cross the network is packed and counted. Of partial tiles, which travel from worker to worker,
one of each pair that is merged counts. Then whole processes into new grids, in turn: ``--jobs 1``,
``--jobs 2`` and ``--dask local:2``; medians, and ratios within one round. Last, what a grid file
takes on the disk. A log is *the km* of a seed of its own (tracks.py).

    python tests/benchmarks/cluster.py [--logs 1000] [--timed 200] [--runs 3]
"""

from __future__ import annotations

import argparse
import sqlite3
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from scaling import KM, print_table, run, write_logs

from possmap.fusing.cluster import crew, tasks
from possmap.fusing.cluster.client import Sent, Team, Work
from possmap.fusing.fuse import fuse
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting


class Pretended(Team):
    """Workers that are this process; counts what they would send, and their CPU time."""

    def __init__(self, workers: int) -> None:
        self.threads = workers
        self.place = "here"
        self.bytes: Counter[str] = Counter()
        self.seconds: Counter[str] = Counter()
        self.partials: list[int] = []
        self._turn = 0

    def look(self) -> None:
        """Count nobody."""

    def send(self, work: Work, *needs: Sent, priority: int = 0) -> Sent:
        """Do a task at once."""
        name = work.function.__name__
        values = [need.future.value for need in needs]
        self.bytes[f"committer to workers: {name}"] += len(work.data)
        if name == "merge":
            start = time.process_time()
            packed = tasks.pack(values[1])
            values[1] = tasks.unpack(packed)
            self.seconds["pack partial tiles"] += time.process_time() - start
            self.bytes["worker to worker: partial tiles"] += len(packed)
            self.partials.append(len(packed))
        start = time.process_time()
        value = work.function(*([work.data] if work.data else []), *values)
        self.seconds[name] += time.process_time() - start
        if name in ("read_held", "lay_out_held"):
            self._turn += 1
        future = SimpleNamespace(value=value, key=f"{id(value)}", worker=self._turn % self.threads)
        return Sent(work.what, future)

    def result(self, sent: Sent) -> Any:
        """Return what a task yielded."""
        value = sent.future.value
        what = "tiles" if sent.what.startswith("tile ") else "labels: records, rows"
        self.bytes[f"workers to committer: {what}"] += len(value)
        return value

    def homes(self, held: Any) -> list[str]:
        """Return who would hold things."""
        return [f"{one.future.worker}" for one in held]


def sent(logs: Path, folder: Path, count: int, workers: int, records: int) -> list[list[str]]:
    """Return rows of what crosses the network, and rows of CPU time by step, per km."""
    team = Pretended(workers)

    @contextmanager
    def pretended(_: str) -> Iterator[Team]:
        yield team

    crew.team = pretended
    grid = folder / f"sent-{workers}-{records}.possmap"
    given = parse_setting("transaction_records", str(records), "")
    start = time.process_time()
    fuse([str(logs)], grid, Request(overrides={"transaction_records": given}), dask="local")
    whole = time.process_time() - start
    grid.unlink()
    km = count * KM
    case = f"{workers} | {records:,}"
    rows = [
        [*case.split(" | "), name, f"{size / km / 1000:.2f} kB"]
        for name, size in sorted(team.bytes.items())
        if size
    ]
    if team.partials:
        half = statistics.median(team.partials) / 1000
        largest = max(team.partials) / 1000
        text = f"{half:.0f} kB, {largest:.0f} kB"
        rows.append([*case.split(" | "), "one partial of a range: median, largest", text])
    for name, seconds in team.seconds.items():
        rows.append([*case.split(" | "), f"CPU: {name}", f"{seconds / km * 1000:.2f} ms"])
    rest = whole - sum(team.seconds.values())
    rows.append([*case.split(" | "), "CPU: the committer", f"{rest / km * 1000:.2f} ms"])
    return rows


def timed(logs: Path, folder: Path, count: int, runs: int) -> None:
    """Print whole processes: one process, two, and a cluster of two workers on this machine."""
    large = "--set=transaction_records=200000"
    dask = ("--dask", "local:2")
    ways = (("--jobs", "1"), ("--jobs", "2"), dask, ("--jobs", "1", large), (*dask, large))
    found: dict[tuple[str, ...], list[Any]] = {way: [] for way in ways}
    for _ in range(runs):
        for way, some in found.items():
            some.append(run(logs, folder / "timed.possmap", *way))
    rows = []
    for way, some in found.items():
        pairs = list(zip(some, found[ways[0]], strict=True))
        rows.append(
            [
                " ".join(way),
                f"{statistics.median(one.seconds for one in some):.2f} s",
                f"{statistics.median(one.seconds / base.seconds for one, base in pairs):.2f}",
                f"{statistics.median(one.cpu for one in some):.2f} s",
                f"{statistics.median(one.cpu / base.cpu for one, base in pairs):.2f}",
            ]
        )
    title = f"{count} logs, whole processes"
    print_table(title, "how | time | to --jobs 1 | CPU time, all | to --jobs 1", rows)


def stored(logs: Path, folder: Path, count: int) -> list[str]:
    """Return what a grid file takes, per km: all, cells of tiles, and the rest, the ledger."""
    grid = folder / "stored.possmap"
    grid.unlink(missing_ok=True)
    fuse([str(logs)], grid)
    with sqlite3.connect(grid) as connection:
        cells, tiles = connection.execute(
            "SELECT sum(length(data)), count(DISTINCT row || ',' || \"column\")"
            " FROM tile JOIN cells ON cells.tile = tile.id"
        ).fetchone()
    connection.close()
    size = grid.stat().st_size
    km = count * KM
    return [
        f"{count:,}",
        f"{tiles:,}",
        f"{size / km / 1000:.1f} kB",
        f"{(size - cells) / km / 1000:.1f} kB",
        f"{cells / tiles / 1000:.1f} kB",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=1000)
    parser.add_argument("--timed", type=int, default=200)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        timed_logs = write_logs(folder / "timed", range(options.timed))
        timed(timed_logs, folder, options.timed, options.runs)
        one = folder / "one"
        write_logs(one, range(1))
        timed(one, folder, 1, options.runs)
        logs = write_logs(folder / "logs", range(options.logs))
        sizes = [stored(logs, folder, options.logs)]
        apart = write_logs(folder / "apart", range(options.logs), buildings=options.logs)
        sizes.append(stored(apart, folder, options.logs))
        head = "logs | tiles | file, per km | of it the ledger, per km | cells of one tile"
        print_table("On the disk: one building, then one building for each log", head, sizes)
        rows = []
        for workers, records in ((2, 20_000), (8, 20_000), (8, 200_000), (50, 600_000)):
            rows += sent(logs, folder, options.logs, workers, records)
        head = "workers | transaction_records | what | per km"
        print_table(f"{options.logs} logs of one building", head, rows)
        rows = sent(apart, folder, options.logs, 8, 200_000)
        print_table("A building for each log", head, rows)


if __name__ == "__main__":
    main()
