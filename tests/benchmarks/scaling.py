"""How ``possmap fuse`` grows: with logs, jobs, the size of the site, of errors and of cells.

Whole processes, each into a new grid, in turn; medians. A log is *the km* of a seed of its own, one
excursion in JSON. CPU time is user and system, that of all processes: km a second per core is km
over CPU time. Peak memory is resident memory, looked at every 20 ms. Last, runs in this process
with a clock around each stage say where the time goes.

    python tests/benchmarks/scaling.py [--runs 3] [--logs 100] [--long] [--only logs,stages]
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any

from tracks import METRES, MODEL, the_km

KM = METRES / 1000
APART = 6 * 12.8
"""Metres between buildings: whole tiles at 5 cm, so that each is cut at its tiles alike."""

STAGES = (
    ("read and check logs", "possmap.fusing.reading", "read"),
    ("correct, propagate, lay out", "possmap.core.evidence", "findings"),
    ("cut at the borders of tiles", "possmap.core.plan", "plan_excursion"),
    ("rows of the ledger", "possmap.grid.rows", "excursion_rows"),
    ("judge", "possmap.fusing.joining", "Joining.join"),
    ("sort by tile", "possmap.core.plan", "by_tile"),
    ("sort by tile", "possmap.core.plan", "_work"),
    ("read tiles", "possmap.grid.tiles", "TileStore.read"),
    ("stamp", "possmap.core.fusion", "fuse_tile"),
    ("encode", "possmap.grid.encoding", "encode"),
    ("write tiles", "possmap.grid.tiles", "TileStore.put"),
    ("write the ledger", "possmap.grid.ledger", "Ledger.add"),
    ("write the ledger", "possmap.grid.arrivals", "Arrivals.add"),
    ("commit, to the disk", "possmap.grid.database", "Database.execute"),
)
"""What the clock of a stage is put around; of ``Database.execute`` only COMMIT."""


@dataclass(frozen=True)
class Run:
    """One whole process: seconds, seconds of CPU time of all processes, peak memory [MiB]."""

    seconds: float
    cpu: float
    memory: float
    memory_of_child: float


def _peak(pid: int) -> float:
    """Return the peak resident memory of a process so far [MiB]; 0 if it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    line = next((line for line in status.splitlines() if line.startswith("VmHWM")), "VmHWM: 0")
    return int(line.split()[1]) / 1024


def _children(pid: int) -> list[int]:
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # it has ended
            found += map(int, task.read_text().split())
    return found


def run(logs: Path, grid: Path, *options: str) -> Run:
    """Fuse a folder into a new grid."""
    grid.unlink(missing_ok=True)
    command = [sys.executable, "-m", "possmap", "-q", "fuse", str(logs), "-g", str(grid), *options]
    start = time.perf_counter()
    process = subprocess.Popen(command)
    own = child = 0.0
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        own = max(own, _peak(process.pid))
        child = max([child, *map(_peak, _children(process.pid))])
        time.sleep(0.02)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
    return Run(seconds, usage.ru_utime + usage.ru_stime, own, child)


def write_logs(
    folder: Path, seeds: Iterable[int], buildings: int = 1, model: Mapping[str, float] = MODEL
) -> Path:
    """Write one log for each seed, in buildings side by side in a square."""
    folder.mkdir()
    wide = round(buildings**0.5)
    for seed in seeds:
        log = the_km(seed) | {"excursion": f"{seed}", "model": dict(model)}
        row, column = divmod(seed % buildings, wide)
        for record in log["records"]:
            for name in record.keys() & {"x", "x2"}:
                record[name] += column * APART
            for name in record.keys() & {"y", "y2"}:
                record[name] += row * APART
        (folder / f"{seed:05d}.json").write_text(json.dumps(log))
    return folder


def print_table(title: str, head: str, rows: Iterable[list[str]]) -> None:
    lines = [head.split(" | "), ["---"] * len(head.split(" | ")), *rows]
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    sys.stdout.write(f"\n{title}\n\n{text}\n")
    sys.stdout.flush()


COLUMNS = "time | km a second | CPU time | km a second per core | peak memory | of a child | grid"


def columns(runs: list[Run], km: float, grid: Path) -> list[str]:
    """Return COLUMNS of some runs of the same."""
    seconds = statistics.median(one.seconds for one in runs)
    cpu = statistics.median(one.cpu for one in runs)
    child = max(one.memory_of_child for one in runs)
    times = [f"{seconds:.2f} s", f"{km / seconds:.1f}", f"{cpu:.2f} s", f"{km / cpu:.1f}"]
    memory = f"{max(one.memory for one in runs):.0f} MiB"
    size = f"{grid.stat().st_size / 2**20:.1f} MiB"
    return [*times, memory, f"{child:.0f} MiB" if child else "–", size]


def by_logs(folder: Path, runs: int, counts: list[int]) -> None:
    """Print what more logs and a second job do; large batches run once."""
    every = write_logs(folder / "every", range(counts[-1]))
    grid, rows = folder / "site.possmap", []
    for count in counts:
        logs = folder / f"first-{count}"
        logs.mkdir()
        for path in sorted(every.iterdir())[:count]:
            (logs / path.name).hardlink_to(path)
        found: dict[int, list[Run]] = {1: [], 2: []}
        for _ in range(runs if count <= 100 else max(1, runs // 3)):
            for jobs, some in found.items():
                some.append(run(logs, grid, "--jobs", str(jobs)))
        for jobs, some in found.items():
            pairs = zip(found[1], some, strict=True)
            faster = statistics.median(one.seconds / other.seconds for one, other in pairs)
            rows.append(
                [f"{count:,}", f"{jobs}", *columns(some, count * KM, grid), f"{faster:.2f}"]
            )
    print_table(
        "Logs and jobs, one building of 60 m, 5 cm", f"logs | jobs | {COLUMNS} | faster", rows
    )


def by_size(folder: Path, runs: int, count: int) -> None:
    """Print what a larger site, larger errors and smaller cells do."""
    cases: list[tuple[str, Path, list[str]]] = []
    for buildings in (1, 4, 16, 64):
        logs = write_logs(folder / f"{buildings}-buildings", range(count), buildings)
        cases.append((f"buildings: {buildings}", logs, []))
    for limit in (0.25, 0.5, 2.0):
        model = MODEL | {"along": limit / METRES, "across": limit / METRES}
        logs = write_logs(folder / f"error-{limit}", range(count), model=model)
        cases.append((f"errors up to {limit:g} m", logs, [f"--set=max_error={limit}"]))
    cases += [
        (f"cells of {c * 100:g} cm", folder / "1-buildings", [f"--resolution={c}"])
        for c in (0.1, 0.025)
    ]
    found: dict[str, list[Run]] = {case: [] for case, *_ in cases}
    grids = {case: folder / f"{number}.possmap" for number, (case, *_) in enumerate(cases)}
    for _ in range(runs):
        for case, logs, options in cases:
            found[case].append(run(logs, grids[case], *options))
    rows = []
    for case, some in found.items():
        command = [sys.executable, "-m", "possmap", "info", str(grids[case]), "--json"]
        tiles = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["tiles"]
        rows.append([case, f"{tiles:,}", *columns(some, count * KM, grids[case])])
    title = f"{count} logs, one job; unless said: one building, errors up to 1 m, cells of 5 cm"
    print_table(title, f"case | tiles | {COLUMNS}", rows)


@dataclass
class Clock:
    """Time by stage: what a stage calls that is a stage itself counts there alone."""

    wall: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    stack: list[str] = field(default_factory=lambda: ["the rest"])
    last: tuple[float, float] = field(
        default_factory=lambda: (time.perf_counter(), time.process_time())
    )

    def lap(self) -> None:
        """Count the time since the last lap to the stage on top."""
        now = time.perf_counter(), time.process_time()
        stage = self.stack[-1]
        self.wall[stage] = self.wall.get(stage, 0.0) + now[0] - self.last[0]
        self.cpu[stage] = self.cpu.get(stage, 0.0) + now[1] - self.last[1]
        self.last = now

    def around(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with the clock around it."""

        @wraps(function)
        def timed(*args: Any, **named: Any) -> Any:
            if function.__name__ == "execute" and args[1] != "COMMIT":
                return function(*args, **named)
            self.lap()
            self.stack.append(stage)
            try:
                return function(*args, **named)
            finally:
                self.lap()
                self.stack.pop()

        return timed


def put_clocks(clock: Clock) -> None:
    """Put the clock around every stage, wherever its function has been imported to."""
    importlib.import_module("possmap.fusing.fuse")
    for stage, module, name in STAGES:
        try:
            owner: Any = importlib.import_module(module)
            *path, last = name.split(".")
            for part in path:
                owner = getattr(owner, part)
            original = getattr(owner, last)
        except (ImportError, AttributeError) as error:
            raise SystemExit(
                f"stages: no {module}.{name} ({error}); STAGES needs mending"
            ) from error
        timed = clock.around(stage, original)
        setattr(owner, last, timed)
        for other in [one for key, one in sys.modules.items() if key.startswith("possmap.")]:
            for key, value in list(vars(other).items()):
                if value is original:
                    setattr(other, key, timed)


def stages(folder: Path, runs: int, count: int) -> None:
    """Print where the time goes, medians of runs; the clocks stay, so this comes last."""
    logs = write_logs(folder / "staged", range(count))
    clock = Clock()
    put_clocks(clock)
    fuse = importlib.import_module("possmap.fusing.fuse").fuse
    laps: list[tuple[dict[str, float], dict[str, float]]] = []
    for number in range(runs + 1):
        clock.wall, clock.cpu = {}, {}
        clock.last = time.perf_counter(), time.process_time()
        fuse([str(logs)], folder / f"staged-{number}.possmap")
        clock.lap()
        laps.append((clock.wall | {"all": sum(clock.wall.values())}, clock.cpu))
    del laps[0]  # it warms up
    rows = []
    for name in dict.fromkeys([*(stage for stage, *_ in STAGES), "the rest", "all"]):
        wall = statistics.median(one.get(name, 0.0) for one, _ in laps)
        cpu = statistics.median(
            one.get(name, 0.0) if name != "all" else sum(one.values()) for _, one in laps
        )
        share = statistics.median(one.get(name, 0.0) / one["all"] for one, _ in laps)
        ms = 1000 / (count * KM)
        rows.append([name, f"{wall * ms:.2f} ms", f"{cpu * ms:.2f} ms", f"{share:.0%}"])
    title = f"Where the time goes: {count} logs, one building, one process, without start-up"
    print_table(title, "stage | time a km | CPU time a km | share of time", rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--logs", type=int, default=100, help="in all but the first table")
    parser.add_argument("--long", action="store_true", help="also 10,000 logs")
    parser.add_argument("--only", default="logs,sizes,stages")
    options = parser.parse_args()
    chosen = options.only.split(",")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "logs" in chosen:
            by_logs(folder, options.runs, [1, 10, 100, 1000, 10_000][: 5 if options.long else 4])
        if "sizes" in chosen:
            by_size(folder, options.runs, options.logs)
        if "stages" in chosen:
            stages(folder, options.runs, options.logs)


if __name__ == "__main__":
    main()
