"""What each export costs: whole processes on 4000 × 4000 known cells, and their peak memory.

python tests/benchmarks/export_map.py [--runs 3] [--tiny]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from render_map import KNOWN, known, median, write

JOBS = (
    (".npz", []),
    (".yaml", []),
    (".yaml", ["--mode", "scale"]),
    (".yaml", ["--mode", "raw"]),
    (".geojson", []),
    (".csv", []),
    (".png", []),
    (".svg", []),
    (".dxf", []),
    (".bt", ["--window", "0,0,20,20"]),  # at most 2 million voxels
    (".ot", ["--window", "0,0,20,20"]),
)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--tiny", action="store_true", help="a few tiles, to see that it runs")
    asked = parser.parse_args()
    window = ["--window", "0,0,20,20" if asked.tiny else "0,0,200,200"]  # 4000 × 4000 cells of 5 cm
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        grid = write(folder / "known.possmap", known(2 if asked.tiny else KNOWN))
        sys.stdout.write("| format | seconds | peak MiB | file MiB |\n| --- | --- | --- | --- |\n")
        for suffix, options in JOBS:
            out = folder / f"out{suffix}"
            command = [
                *(sys.executable, "-m", "possmap", "-q", "export", str(grid), "-o", str(out)),
                *("--overwrite", *window, *options),
            ]
            seconds, memory = median(asked.runs, command)
            size = sum(path.stat().st_size for path in folder.glob("out.*")) / 2**20
            title = " ".join([f"`{suffix}`", *options])
            sys.stdout.write(f"| {title} | {seconds:.1f} | {memory:.0f} | {size:.1f} |\n")
            sys.stdout.flush()
            for path in folder.glob("out.*"):
                path.unlink()


if __name__ == "__main__":
    main()
