"""What ``possmap forget`` costs beside fusing all the other logs anew: whole processes in turn.

Excursions of 1 km each, all in one building or ten in each of several; one of them is forgotten.
Every digest is compared.

    python tests/benchmarks/forget.py [--runs 5] [--excursions 100]
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from scaling import print_table, run, write_logs


def forget(grid: Path, *target: str) -> tuple[float, float, str]:
    """Forget something; return seconds, seconds of CPU time, and the digest that is left."""
    command = [sys.executable, "-c", TIMED, "forget", str(grid), *target, "--json"]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - start
    return seconds, float(done.stderr), json.loads(done.stdout)["digest"]


TIMED = """
import atexit, sys, time
atexit.register(lambda: sys.stderr.write(str(time.process_time())))
from possmap.cli.main import main
main(prog_name="possmap")
"""


def digest(grid: Path) -> str:
    command = [sys.executable, "-m", "possmap", "info", str(grid), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return str(json.loads(done.stdout)["digest"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--excursions", type=int, default=100)
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for profile in ("paper", "robust"):
            for buildings in (1, max(1, asked.excursions // 10)):
                rows.append(_row(Path(name), profile, buildings, asked.excursions, asked.runs))
                shutil.rmtree(name)
                Path(name).mkdir()
    head = "profile | buildings | forget one | CPU time | fuse the others | CPU time | ratio of CPU"
    print_table(f"one of {asked.excursions} excursions of 1 km", head, rows)


def _row(folder: Path, profile: str, buildings: int, excursions: int, runs: int) -> list[str]:
    logs = write_logs(folder / "logs", range(excursions), buildings)
    options = ("--profile", profile)
    run(logs, folder / "whole.possmap", *options)
    middle = excursions // 2
    (logs / f"{middle:05d}.json").rename(folder / "forgotten.json")
    forgetting, fusing = [], []
    for _ in range(runs):
        shutil.copy(folder / "whole.possmap", folder / "site.possmap")
        target = ("--robot", "km", "--excursion", f"{middle}")
        *cost, left = forget(folder / "site.possmap", *target)
        forgetting.append(cost)
        fused = run(logs, folder / "others.possmap", *options)
        fusing.append([fused.seconds, fused.cpu])
        if left != digest(folder / "others.possmap"):
            raise SystemExit("the digests differ")
    times = [[statistics.median(column) for column in zip(*some, strict=True)]
             for some in (forgetting, fusing)]  # fmt: skip
    (seconds, cpu), (anew, anew_cpu) = times
    return [
        profile, f"{buildings}", f"{seconds * 1000:.0f} ms", f"{cpu * 1000:.0f} ms",
        f"{anew * 1000:.0f} ms", f"{anew_cpu * 1000:.0f} ms", f"{cpu / anew_cpu:.2f}",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
