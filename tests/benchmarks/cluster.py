"""What ``fuse --dask`` costs beside ``--jobs``: whole processes, each into a new grid, in turn.

python tests/benchmarks/cluster.py [--logs 200] [--workers 2] [--runs 3]
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from scaling import print_table, run, write_logs


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    ways = ("--jobs=1", f"--jobs={options.workers}", f"--dask=local:{options.workers}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = write_logs(folder / "logs", range(options.logs))
        rows = []
        for way in ways:
            laps = [run(logs, folder / "site.possmap", way) for _ in range(options.runs)]
            figures = (
                statistics.median(getattr(lap, what) for lap in laps)
                for what in ("seconds", "cpu", "memory")
            )
            rows.append([way, *(f"{figure:.2f}" for figure in figures)])
        print_table(f"{options.logs} logs", "way | s | CPU s | MiB", rows)


if __name__ == "__main__":
    main()
