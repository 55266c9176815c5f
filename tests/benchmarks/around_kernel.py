"""What a km of log costs besides stamping: CPU time of reading, laying out and the ledger.

Medians of interleaved rounds in one process, user and system time together: each round does every
step once for each of a few logs of *the km* (``tracks.py``).

    python tests/benchmarks/around_kernel.py [--rounds 15] [--logs 8]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tracks import the_km

from possmap.core.evidence import findings
from possmap.core.model import ErrorModel
from possmap.core.plan import plan_excursion
from possmap.core.records import PartialMap
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid
from possmap.grid.rows import excursion_hash, excursion_rows
from possmap.logs import read_log
from possmap.logs.writing import writing
from possmap.settings.limits import Limits

SETTINGS = EvidenceSettings()
HEADING = EvidenceSettings(
    estimator="heading",
    free_along_walls=True,
    free_along_beams=True,
    clip_coobserved=True,
    independence="excursion",
)


def write_logs(folder: Path, count: int) -> list[Path]:
    """Write the logs in each encoding; return their names without suffix."""
    names = [folder / f"km{seed}" for seed in range(count)]
    for seed, name in enumerate(names):
        log = the_km(seed)
        name.with_suffix(".json").write_text(json.dumps(log))
        head = {key: log[key] for key in ("robot", "model")} | {"excursion": f"{seed}"}
        for suffix in (".jsonl", ".csv"):
            with writing(name.with_suffix(suffix), overwrite=False) as writer:
                writer.begin(head)
                for record in log["records"]:
                    writer.record(record)
                writer.end()
    return names


def read_all(names: list[Path], suffix: str) -> list[PartialMap]:
    logs = [read_log(name.with_suffix(suffix), Limits()) for name in names]
    return [log.deliveries[0].version for log in logs]


def one_round(names: list[Path], grid_file: Path) -> dict[str, float]:
    """Do every step for every log; return what each took [s of CPU time]."""
    spent: dict[str, float] = {}

    def timed(step: str, work: Callable[[], object]) -> None:
        start = time.process_time()
        work()
        spent[step] = time.process_time() - start

    for suffix, encoding in ((".json", "JSON"), (".jsonl", "JSON Lines"), (".csv", "CSV")):
        timed(f"read {encoding}", partial(read_all, names, suffix))
    versions = read_all(names, ".jsonl")  # those that have names of their own, and models
    models = [ErrorModel(**dict(version.model)) for version in versions]
    pairs = list(zip(versions, models, strict=True))
    timed("lay out, linear", lambda: [findings(*pair, SETTINGS) for pair in pairs])
    timed("lay out, heading", lambda: [findings(*pair, HEADING) for pair in pairs])
    timed("hash", lambda: [excursion_hash(*pair) for pair in pairs])
    laid_out = [findings(*pair, SETTINGS) for pair in pairs]
    touched = [plan_excursion(found, 0, SETTINGS).touched() for found in laid_out]
    with Grid(grid_file, write=True) as grid:

        def add_all() -> None:
            for pair, found, tiles in zip(pairs, laid_out, touched, strict=True):
                grid.ledger.add(excursion_rows(*pair, 0, found.geometry, tiles))

        with grid.transaction():
            grid.prepare(SETTINGS, {})
            timed("ledger: add, with the hash", add_all)
        entries = list(grid.ledger.entries())
        timed("ledger: read back", lambda: [grid.ledger.version(entry) for entry in entries])
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--logs", type=int, default=8)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = write_logs(folder, options.logs)
        rounds = [
            one_round(names, folder / f"{number}.possmap") for number in range(options.rounds + 1)
        ]
        del rounds[0]  # it warms up
        sys.stdout.write(f"{'step':<28}{'median':>8}{'fastest':>9}   ms of CPU a km\n")
        for step in rounds[0]:
            per_km = [one[step] / options.logs * 1000 for one in rounds]
            sys.stdout.write(f"{step:<28}{statistics.median(per_km):8.2f}{min(per_km):9.2f}\n")


if __name__ == "__main__":
    main()
