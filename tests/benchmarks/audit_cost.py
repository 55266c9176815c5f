"""What `possmap audit` costs: an honest site, and two that are made to cost much.

*honest* is 50 logs of a kilometre each in one hall; *far apart* 15,000 excursions of half a metre,
nearly each in a tile of its own; *on one place* 15,000 excursions whose rectangles each cover 24 ×
24 m of the same floor. Each is one process: CPU time and wall time are medians, start included, and
memory the most of any.

    python tests/benchmarks/audit_cost.py [--rounds 3] [--excursions 15000] [--kilometres 50]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracks import the_km

from possmap.fusing.fuse import fuse
from possmap.settings.request import Request

SIDE_M = 9400.0
Log = dict[str, Any]


def honest(count: int) -> list[Log]:
    return [{**the_km(seed), "robot": f"km{seed}"} for seed in range(count)]


def far_apart(count: int) -> list[Log]:
    rng = random.Random(1)
    places = [(rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M)) for _ in range(count)]
    exact = {"along": 0, "across": 0}
    return _carried([_run(number, x, y, 0.5, exact) for number, (x, y) in enumerate(places)])


def on_one_place(count: int) -> list[Log]:
    wide = {"error_x": 12, "error_y": 12}
    return _carried(
        [_run(number, 6, 6, 0.1, {"max_error": 100}, **wide) for number in range(count)]
    )


def _run(number: int, x: float, y: float, long: float, model: Log, **error: float) -> Log:
    start = {"seq": 0, "kind": "pose", "x": round(x, 1), "y": round(y, 1), "heading": 0, **error}
    end = {**start, "seq": 1, "x": round(x + long, 1)}
    return {"robot": f"q{number}", "excursion": "a", "model": model, "records": [start, end]}


def _carried(logs: list[Log]) -> list[Log]:
    carrier = {"possmap_log": 1, "robot": "r", "excursion": "a", "records": [], "carried": logs}
    return [carrier]


def audited(grid: Path) -> tuple[float, float, float]:
    """Return CPU time, wall time [s] and peak memory [MiB] of an audit that ends well."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "possmap", "audit", str(grid)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"audit ended with {process.returncode}")
    return used.ru_utime + used.ru_stime, time.perf_counter() - begin, used.ru_maxrss / 1024


def report(folder: Path, rounds: int, count: int, kilometres: int) -> Iterator[str]:
    sites = {
        "honest": honest(kilometres),
        "far apart": far_apart(count),
        "on one place": on_one_place(count),
    }
    found: dict[str, list[tuple[float, float, float]]] = {}
    for number, logs in enumerate(sites.values()):
        paths = []
        for place, log in enumerate(logs):
            paths.append(folder / f"{number}-{place}.json")
            paths[-1].write_text(json.dumps(log, separators=(",", ":")))
        fuse([str(path) for path in paths], folder / f"{number}.possmap", Request())
    for _ in range(rounds):
        for number, name in enumerate(sites):
            found.setdefault(name, []).append(audited(folder / f"{number}.possmap"))
    yield "| site | CPU [s] | wall [s] | memory [MiB] |"
    yield "| --- | --- | --- | --- |"
    for name, some in found.items():
        cpu, wall, memory = zip(*some, strict=True)
        yield (
            f"| {name} | {statistics.median(cpu):.1f} | {statistics.median(wall):.1f} "
            f"| {max(memory):.0f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--excursions", type=int, default=15_000)
    parser.add_argument("--kilometres", type=int, default=50)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        lines = report(Path(name), asked.rounds, asked.excursions, asked.kilometres)
        sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
