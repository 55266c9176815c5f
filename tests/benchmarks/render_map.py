"""What a picture costs: whole processes, and their peak memory.

Two maps, written tile by tile: 4000 × 4000 known cells; 20,000 × 20,000 cells with 10 % touched,
as whole tiles here and there (*patches*) or as a band through every tile (*bands*).

    python tests/benchmarks/render_map.py [--runs 5] [--tiny]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, TileLayers
from possmap.core.lattice import TILE, TileKey
from possmap.core.pyramid import FULL
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid

KNOWN = 16  # tiles along a side: 4096, of which 4000 cells are drawn
WIDE = 79  # tiles along a side: 20,224 cells
Tiles = Iterator[tuple[TileKey, TileLayers]]


def known_tile(rows: int = TILE) -> TileLayers:
    """Return a tile with walls, free space between them and points, in its lowest rows."""
    row, column = np.mgrid[0:TILE, 0:TILE]
    away = np.minimum(row % 64, column % 64)
    inside = row < rows
    walls = np.where(inside & (away < 8), CERTAIN // 8 * (8 - away), 0).astype(np.int64)
    free = np.where(inside & (away > 5), FULL // 64 * away, 0).astype(np.uint16)
    points = np.where(inside & (row % 64 < 3) & (column % 64 < 3), CERTAIN // 2, 0)
    return {Layer.WALLS: walls, Layer.FREE: free, Layer.POINTS: points.astype(np.int64)}


def known(side: int = KNOWN) -> Tiles:
    """Yield the tiles of a map that is known throughout."""
    tile = known_tile()
    for key in np.ndindex(side, side):
        yield TileKey(*key), tile


def patches(side: int = WIDE) -> Tiles:
    """Yield one tile in ten, known throughout, and the corners."""
    tile = known_tile()
    for row, column in np.ndindex(side, side):
        if (7 * row + column) % 10 == 0 or row == column == side - 1:
            yield TileKey(row, column), tile


def bands(side: int = WIDE) -> Tiles:
    """Yield every tile, known in a tenth of its rows."""
    tile = known_tile(TILE // 10)
    for key in np.ndindex(side, side):
        yield TileKey(*key), tile


def write(path: Path, tiles: Tiles) -> Path:
    """Write a grid of tiles that no excursion reported."""
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(EvidenceSettings(), {})
        for key, layers in tiles:
            grid.tiles.write(key, layers)
    return path


def cost(command: Sequence[str]) -> tuple[float, float]:
    """Return the seconds of a process and its peak memory [MiB]."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def median(runs: int, command: Sequence[str]) -> tuple[float, float]:
    costs = [cost(command) for _ in range(runs)]
    return statistics.median(c[0] for c in costs), max(c[1] for c in costs)


def say(row: str, figure: float, peak: float | None = None) -> None:
    sys.stdout.write(f"{row:<36}{figure:9.2f}{'' if peak is None else f'{peak:10.0f}'}\n")
    sys.stdout.flush()


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--tiny", action="store_true", help="a few tiles, to see that it runs")
    asked = parser.parse_args()
    side, wide = (2, 3) if asked.tiny else (KNOWN, WIDE)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        grids = {
            "known": write(folder / "known.possmap", known(side)),
            "patches": write(folder / "patches.possmap", patches(wide)),
            "bands": write(folder / "bands.possmap", bands(wide)),
        }
        imports = "import possmap.pictures.render, possmap.cli.main"
        start, memory = median(asked.runs, [sys.executable, "-c", imports])
        sys.stdout.write(f"{'seconds beyond start-up':<36}{'s':>9}{'peak MiB':>10}\n")
        say("start-up: imports", start, memory)
        metres = 200 if side == KNOWN else 20  # 4000 × 4000 cells of 5 cm
        window = ["--window", f"0,0,{metres},{metres}"]
        small = ["--max-size", "2000"]
        necessity = ["--bare", "--layer", "necessity"]
        jobs: list[tuple[str, str, list[str]]] = [
            ("4000 × 4000, necessity, bare", "known", [*necessity, *window]),
            ("4000 × 4000, necessity, gray", "known", [*necessity, "--palette", "gray", *window]),
            ("4000 × 4000, map, bare", "known", ["--bare", *window]),
            ("4000 × 4000, map, furnished", "known", window),
            ("20,000², patches, map at 2000", "patches", small),
            ("20,000², patches, necessity bare", "patches", [*small, *necessity]),
            ("20,000², bands, map at 2000", "bands", small),
        ]
        out = folder / "out.png"
        for title, grid, args in jobs:
            command = [sys.executable, "-m", "possmap", "-q", "render", str(grids[grid])]
            took, memory = median(asked.runs, [*command, "-o", str(out), "--overwrite", *args])
            say(title, took - start, memory)
            say("  the file [MiB]", out.stat().st_size / 2**20)


if __name__ == "__main__":
    main()
