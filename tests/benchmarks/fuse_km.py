"""What fusing *the km* costs: whole processes, stages, memory, and a grid that is already large.

The km: one excursion of 1 km in a 60 × 60 m building, 600 records, axis-parallel runs past walls
that are not followed, with a model whose half-widths reach ``max_error`` only at its end.

    python tests/benchmarks/fuse_km.py [--runs 7]
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tracks import MODEL, known_square, the_km

from possmap.core.evidence import findings
from possmap.core.fusion import fuse_tile
from possmap.core.model import ErrorModel
from possmap.core.plan import by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid
from possmap.grid.rows import excursion_rows
from possmap.logs import read_log
from possmap.settings.limits import Limits


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
    plan = plan_excursion(laid_out, 0, settings)
    touched = plan.touched()
    lap("cutting at tiles")
    _, works = by_tile([plan])
    changed = {work.key: fuse_tile(work, {}, settings) for work in works}
    lap("stamping")
    path = folder / f"stages-{time.perf_counter_ns()}.possmap"
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(settings, {})
        for key, layers in changed.items():
            grid.tiles.write(key, layers)
        grid.ledger.add(excursion_rows(version, settings.model, 0, laid_out.geometry, touched))
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
            lambda: seconds([*python, "-c", "import possmap.fusing.fuse, possmap.cli.main, tqdm"]),
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
