"""What a picture costs: whole processes, their peak memory, and which stage limits.

Two maps, written tile by tile: 4000 × 4000 known cells; 20,000 × 20,000 cells with 10 % touched,
as whole tiles here and there (*patches*) or as a band through every tile (*bands*).

    python tests/benchmarks/render_map.py [--runs 5]
"""

from __future__ import annotations

import argparse
import io
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from possmap.pictures.png import palette_image, write_png

from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, TileLayers
from possmap.core.lattice import TILE, TileKey
from possmap.core.pyramid import FULL
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid
from possmap.pictures import compose, overlays
from possmap.pictures.render import Look, overlays_of, raster_of, scene_of

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


def known() -> Tiles:
    """Yield the tiles of a map that is known throughout."""
    tile = known_tile()
    for key in np.ndindex(KNOWN, KNOWN):
        yield TileKey(*key), tile


def patches() -> Tiles:
    """Yield one tile in ten, known throughout, and the corners."""
    tile = known_tile()
    for row, column in np.ndindex(WIDE, WIDE):
        if (7 * row + column) % 10 == 0 or row == column == WIDE - 1:
            yield TileKey(row, column), tile


def bands() -> Tiles:
    """Yield every tile, known in a tenth of its rows."""
    tile = known_tile(TILE // 10)
    for key in np.ndindex(WIDE, WIDE):
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


def stages(path: Path, look: Look) -> dict[str, float]:
    """Return the seconds of each stage of one picture, in this process."""
    found: dict[str, float] = {}

    def timed(name: str, work: Callable[[], object]) -> None:
        start = time.perf_counter()
        work()
        found[name] = time.perf_counter() - start

    with Grid(path) as grid:
        chosen = raster_of(grid, look)
        scene = scene_of(grid, look, chosen)
        name = look.layers[0]

        def read() -> None:
            for window in grid.tiles.areas(chosen.window):
                for layer in Layer:
                    grid.tiles.read_window(layer, window)

        timed("reading tiles", read)
        timed("reading tiles, values, blocks", lambda: compose.indices(scene, name, chosen))
        index, _ = compose.indices(scene, name, chosen)
        image = palette_image(index, compose.colours(name, look.palette), chosen.scale)
        if not look.bare:
            image = image.convert("RGB")
            what = overlays_of(grid, look, chosen)
            timed("overlays", lambda: overlays.paint(image, what, chosen, grid.resolution))
        timed("writing PNG", lambda: write_png(image, io.BytesIO(), {}))
    return found


def say(row: str, figure: float, peak: float | None = None) -> None:
    sys.stdout.write(f"{row:<36}{figure:9.2f}{'' if peak is None else f'{peak:10.0f}'}\n")
    sys.stdout.flush()


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    python = [sys.executable]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        grids = {
            "4000": write(folder / "known.possmap", known()),
            "patches": write(folder / "patches.possmap", patches()),
            "bands": write(folder / "bands.possmap", bands()),
        }
        imports = "import possmap.pictures.render, possmap.cli.main"
        start, memory = median(runs, [*python, "-c", imports])
        sys.stdout.write(f"{'seconds beyond start-up':<36}{'s':>9}{'peak MiB':>10}\n")
        say("start-up: imports", start, memory)
        window = ["--window", "0,0,200,200"]  # 4000 × 4000 cells of 5 cm
        window_m = (0.0, 0.0, 200.0, 200.0)
        jobs: list[tuple[str, str, list[str], Look]] = [
            ("4000 × 4000, necessity, bare", "4000", ["--bare", "--layer", "necessity", *window],
             Look(layers=("necessity",), bare=True, window_m=window_m)),
            ("4000 × 4000, necessity, gray",
             "4000", ["--bare", "--layer", "necessity", "--palette", "gray", *window],
             Look(layers=("necessity",), bare=True, palette="gray", window_m=window_m)),
            ("4000 × 4000, map, bare", "4000", ["--bare", *window],
             Look(bare=True, window_m=window_m)),
            ("4000 × 4000, map, furnished", "4000", window, Look(window_m=window_m)),
            ("20,000², patches, map at 2000", "patches", ["--max-size", "2000"],
             Look(max_size=2000)),
            ("20,000², patches, necessity bare", "patches",
             ["--max-size", "2000", "--bare", "--layer", "necessity"],
             Look(max_size=2000, bare=True, layers=("necessity",))),
            ("20,000², bands, map at 2000", "bands", ["--max-size", "2000"], Look(max_size=2000)),
        ]  # fmt: skip
        out = folder / "out.png"
        for title, grid, args, look in jobs:
            command = [*python, "-m", "possmap", "-q", "render", str(grids[grid]), "-o", str(out)]
            took, memory = median(runs, [*command, "--overwrite", *args])
            say(title, took - start, memory)
            for stage, part in stages(grids[grid], look).items():
                say(f"  {stage}", part)
            say("  the file [MiB]", out.stat().st_size / 2**20)


if __name__ == "__main__":
    main()
