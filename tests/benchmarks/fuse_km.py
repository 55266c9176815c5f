"""What fusing *the km* costs: whole processes, stages, memory, and a grid that is already large.

The km: one excursion of 1 km in a 60 × 60 m building, 600 records, axis-parallel runs past walls
that are not followed, with a model whose half-widths reach ``max_error`` only at its end.

    python tests/benchmarks/fuse_km.py [--runs 7]
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from possmap.core.evidence import findings
from possmap.core.fusion import Plan, add_to_plan, fuse_tile
from possmap.core.model import ErrorModel
from possmap.core.settings import EvidenceSettings
from possmap.files.gridfile.grid import Grid
from possmap.files.limits import Limits
from possmap.files.logs import read_log

MODEL = {"along": 0.001, "across": 0.001, "turn_spread": 0}
TURNS = ((1, 0, 0), (0, 1, 90), (-1, 0, 180), (0, -1, -90))
RECORDS, METRES, SIDE = 600, 1000.0, 60.0


def the_km(seed: int = 0) -> dict[str, Any]:
    """Return the log: 255 runs with a turn before each, walls beside 90 of them."""
    rng = random.Random(seed)
    records: list[dict[str, Any]] = []

    def add(kind: str, **fields: float | bool) -> None:
        records.append({"seq": len(records), "kind": kind, **fields})

    runs = 255
    walls = RECORDS - 1 - 2 * runs
    beside = set(rng.sample(range(runs), walls))
    length = METRES / runs
    x, y, last = SIDE / 2, SIDE / 2, -1
    add("pose", x=x, y=y, heading=0.0)
    for run in range(runs):
        while True:
            turn = rng.randrange(4)
            dx, dy, heading = TURNS[turn]
            to_x, to_y = x + dx * length, y + dy * length
            if turn != last and 2 < to_x < SIDE - 2 and 2 < to_y < SIDE - 2:
                break
        last = turn
        add("pose", x=round(x, 4), y=round(y, 4), heading=heading)
        if run in beside:
            side_x, side_y = -0.3 * dy, 0.3 * dx
            add(
                "wall",
                x=round(x + side_x, 4),
                y=round(y + side_y, 4),
                x2=round(to_x + side_x, 4),
                y2=round(to_y + side_y, 4),
                followed=False,
            )
        x, y = to_x, to_y
        add("pose", x=round(x, 4), y=round(y, 4), heading=heading)
    return {"possmap_log": 1, "robot": "km", "excursion": "1", "model": MODEL, "records": records}


def known_square(side_m: float = 200.0) -> dict[str, Any]:
    """Return a log that makes 4000 × 4000 cells of 5 cm known: a lawn mower with a wide error."""
    model = {"along": 0, "across": 0, "turn_spread": 0, "max_error": 2.0}
    records: list[dict[str, Any]] = []
    lane = 0
    while lane * 1.5 <= side_m:
        ends = (0.0, side_m) if lane % 2 == 0 else (side_m, 0.0)
        for x in ends:
            records.append(
                {"seq": len(records), "kind": "pose", "x": x, "y": lane * 1.5, "heading": 0}
            )
        lane += 1
    records[0] |= {"error_x": 1.0, "error_y": 1.0}
    return {
        "possmap_log": 1,
        "robot": "mower",
        "excursion": "1",
        "model": model,
        "records": records,
    }


def seconds(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def median(runs: int, once: Callable[[], float]) -> float:
    once()
    return statistics.median(once() for _ in range(runs))


def stages(log: Path, folder: Path) -> dict[str, float]:
    """Return the seconds of each stage of one fuse, in this process."""
    settings = EvidenceSettings(model=ErrorModel(**MODEL))
    clock = [time.perf_counter()]
    found: dict[str, float] = {}

    def lap(name: str) -> None:
        clock.append(time.perf_counter())
        found[name] = clock[-1] - clock[-2]

    version = read_log(log, Limits()).deliveries[0].version
    lap("parsing")
    laid_out = findings(version, settings.model, settings)
    lap("propagation")
    plan: Plan = {}
    touched = add_to_plan(plan, laid_out, 0, 0, settings)
    changed = {key: fuse_tile(key, jobs, {}, settings) for key, jobs in plan.items()}
    lap("stamping")
    path = folder / f"stages-{time.perf_counter_ns()}.possmap"
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(settings, {})
        for key, layers in changed.items():
            grid.tiles.write(key, layers)
        grid.ledger.add(version, settings.model, 0, laid_out.geometry, touched)
    lap("storing")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=7)
    runs = parser.parse_args().runs
    python = [sys.executable]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, square = folder / "km.json", folder / "square.json"
        log.write_text(json.dumps(the_km()))
        square.write_text(json.dumps(known_square()))
        possmap = [*python, "-m", "possmap"]
        large = folder / "large.possmap"
        subprocess.run([*possmap, "fuse", str(square), "-g", str(large)], check=True)

        def fuse_new() -> float:
            grid = folder / "new.possmap"
            grid.unlink(missing_ok=True)
            return seconds([*possmap, "-q", "fuse", str(log), "-g", str(grid)])

        def fuse_into_large() -> float:
            grid = folder / "copy.possmap"
            grid.write_bytes(large.read_bytes())
            return seconds([*possmap, "-q", "fuse", str(log), "-g", str(grid)])

        click = median(runs, lambda: seconds([*python, "-c", "import click"]))
        helped = median(runs, lambda: seconds([*possmap, "--help"]))
        started = median(
            runs,
            lambda: seconds([*python, "-c", "import possmap.app.fuse, possmap.cli.main, tqdm"]),
        )
        new, into_large = median(runs, fuse_new), median(runs, fuse_into_large)
        laps = [stages(log, folder) for _ in range(runs)]
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        rows = [
            ("import click", click, ""),
            ("possmap --help", helped, f"{helped / click:.2f} × import click"),
            ("fuse the km, whole process", new, ""),
            ("  start-up: imports", started, ""),
            *((f"  {k}", statistics.median(lap[k] for lap in laps), "") for k in laps[0]),
            ("the km into 4000 × 4000 cells", into_large, f"{into_large / new:.2f} × into none"),
        ]
        for row, figure, note in rows:
            sys.stdout.write(f"{row:<32}{figure * 1000:8.0f} ms   {note}\n")
        size = (folder / "new.possmap").stat().st_size
        sys.stdout.write(f"{'grid file of the km':<32}{size / 1024:8.0f} KiB\n")
        sys.stdout.write(
            f"{'grid file of 4000 × 4000 cells':<32}{large.stat().st_size / 1024:8.0f} KiB\n"
        )
        sys.stdout.write(f"{'peak memory of a fuse':<32}{memory:8.0f} MiB\n")


if __name__ == "__main__":
    main()
