"""What a site of a million tiles costs: time and peak memory of each command, beside small sites.

A lattice of long runs, one in each row of tiles, as a robot would drive them: 15 × 15 km at 5 cm.
The grid is the one that ``possmap fuse`` makes of these logs, to the digest; it is written faster,
for runs whose errors do not grow say the same in many tiles: each pattern is stamped only once.

    python tests/benchmarks/million_tiles.py [--sides 100,316,1172] [--runs 3] [--folder DIR]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import statistics
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from render_map import cost
from tracks import the_km

import possmap
from possmap.core.evidence import Layer, findings
from possmap.core.lattice import TILE, TileKey
from possmap.core.records import KIND_OF, Corner, PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings
from possmap.grid.arrivals import Arrival
from possmap.grid.encoding import EncodedTile, decode, digest_of, encode
from possmap.grid.grid import Grid
from possmap.grid.rows import excursion_rows
from possmap.logs.delivery import Origin

Cells: TypeAlias = NDArray[np.unsignedinteger]

SETTINGS = EvidenceSettings()
SIDE = TILE * SETTINGS.resolution
MODEL = (("across", 0.0), ("along", 0.0), ("turn_spread", 0.0))
"""Errors that do not grow: only so are tiles alike."""
LEG = 5
"""Tiles from one pose to the next: every leg crosses tiles in the same places."""
LEGS = 3
"""Legs after which they repeat; the first runs past a wall, which ends at a corner."""
PERIOD, RECORDS = LEG * LEGS, LEGS + 2
PATTERNS = 23
"""Rows that differ, in place and half-width, before they repeat."""
SUFFIXES = {"render": ".png", "export": ".npz"}


def lane(row: int, columns: int) -> PartialMap:
    """Return one excursion: along a row of tiles, from its first column to its last."""
    pattern = row % PATTERNS
    y = (row + 0.3 + 0.4 * pattern / PATTERNS) * SIDE
    half = 0.05 + 0.55 * (7 * pattern % PATTERNS) / PATTERNS
    x, end = 0.5 * SIDE, (columns - 0.5) * SIDE
    records: list[Record] = [Pose(0, None, x, y, 0.0, half, half)]
    leg = 0
    while x < end:
        to = min(x + LEG * SIDE, end)
        if leg % LEGS == 0:
            records.append(Wall(len(records), None, x + 1, y + 0.8, to - 1, y + 0.8, False))
            records.append(Corner(len(records), None, to - 1, y + 0.8, "end"))
        records.append(Pose(len(records), None, to, y, 0.0))
        x, leg = to, leg + 1
    return PartialMap("surveyor", f"row-{row}", MODEL, tuple(records))


def as_log(version: PartialMap) -> dict[str, Any]:
    """Return an excursion as a log file holds it."""
    records = [
        {"kind": KIND_OF[type(record)]}
        | {
            field.name.removesuffix("_deg"): getattr(record, field.name)
            for field in fields(record)
            if field.name not in ("t", "extra")
        }
        for record in version.records
    ]
    head = {"possmap_log": 1, "robot": version.robot, "excursion": version.excursion}
    return {**head, "model": dict(version.model), "records": records}


@dataclass(frozen=True)
class Column:
    """What a tile of a short row holds, and the numbers of the records that touch it."""

    layers: dict[Layer, tuple[EncodedTile, Cells]]
    records: set[int]


@dataclass(frozen=True)
class Patterns:
    """Short rows, fused by possmap: what a row of any length consists of."""

    columns: list[list[Column]]

    @classmethod
    def of(cls, columns: int, folder: Path) -> Patterns:
        """Fuse rows that begin and end as rows of so many columns do."""
        short = columns if columns < 3 * PERIOD else columns % PERIOD + 3 * PERIOD
        for row in range(PATTERNS):
            (folder / f"{row}.json").write_text(json.dumps(as_log(lane(row, short))))
        possmap.fuse(folder, folder / "short.possmap")
        with Grid(folder / "short.possmap") as grid:
            return cls(
                [
                    [_column(grid, TileKey(row, at)) for at in range(short)]
                    for row in range(PATTERNS)
                ]
            )

    def row(self, row: int, columns: int) -> Iterator[tuple[TileKey, Column]]:
        """Yield the tiles of a row, moved there from the short one."""
        like = self.columns[row % PATTERNS]
        for column in range(columns):
            at = column
            if column >= columns - PERIOD:
                at = column - columns + len(like)
            elif column >= PERIOD:
                at = PERIOD + column % PERIOD
            key = TileKey(row, column)
            layers = {
                layer: (one._replace(digest=digest_of(layer, key, one.bounds, cells)), cells)
                for layer, (one, cells) in like[at].layers.items()
            }
            moved = (column - at) // PERIOD * RECORDS
            yield key, Column(layers, {number + moved for number in like[at].records})


def _column(grid: Grid, key: TileKey) -> Column:
    layers = {}
    for layer, array in grid.tiles.read(key).items():
        one = encode(layer, key, array)
        cells = decode(one.bounds, one.data).astype(f"<u{one.data[0]}")
        layers[layer] = one, cells
    ledger = grid.ledger
    entries = [ledger.entry_of(identity) for identity in ledger.known_in(key)]
    return Column(layers, set().union(*[ledger.numbers_in(key, one) for one in entries if one]))


def write(path: Path, rows: int, columns: int) -> Path:
    """Write a site of so many tiles, its rows in an order of chance, as robots come home."""
    with tempfile.TemporaryDirectory() as name:
        patterns = Patterns.of(columns, Path(name))
    order = random.Random(8).sample(range(rows), rows)
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(SETTINGS, {})
        parts = []
        for row in order:
            version = lane(row, columns)
            model = SETTINGS.model_in_force(version.model, {})
            touched = set()
            for key, column in patterns.row(row, columns):
                grid.tiles.put(key, {layer: one for layer, (one, _) in column.layers.items()})
                touched |= {(*key, number) for number in column.records}
            geometry = findings(version, model, SETTINGS).geometry
            grid.ledger.add(excursion_rows(version, model, 0, geometry, sorted(touched)))
            origin = Origin(f"row-{row}.json", f"{row:064x}", 1000)
            parts.append(Arrival(version.name, len(version.records), origin))
        grid.ledger.came.add(parts, "2026-11-25T12:00:00+00:00", possmap.version())
    return path


def commands(grid: Path, other: Path) -> dict[str, list[str]]:
    """Return what is measured of a grid; ``other`` holds one log more."""
    return {
        "info": ["info", str(grid)],
        "query": ["query", str(grid), "100", "100"],
        "render 200 × 200 m": ["render", str(grid), "--bare", "--window", "500,500,700,700"],
        "render the whole": ["render", str(grid)],
        "export .npz, 400 × 400 m": ["export", str(grid), "--window", "500,500,900,900"],
        "diff": ["diff", str(grid), str(other)],
    }


def median_costs(
    runs: int, variants: dict[str, tuple[Path | None, list[str]]], scratch: Path
) -> dict[str, tuple[float, float]]:
    """Return seconds (the median) and MiB (the most) of commands that change a copy of a grid.

    variants : the grid to copy, None for none yet, and the command; run in turns, so that a noisy
        machine is noisy for all of them.
    """
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in variants}
    for _ in range(runs + 1):  # the first warms up
        for name, (source, command) in variants.items():
            scratch.unlink(missing_ok=True)
            if source is not None:
                shutil.copy(source, scratch)
                os.sync()  # or the copying is paid for by whoever commits next
            found[name].append(cost(command))
    return {
        name: (statistics.median(c[0] for c in costs[1:]), max(c[1] for c in costs[1:]))
        for name, costs in found.items()
    }


def fusing(grids: dict[str, Path], folder: Path, runs: int) -> dict[str, tuple[float, float]]:
    """Measure adding one log, the km, to no grid and to each of the grids."""
    log, scratch = folder / "km.json", folder / "scratch.possmap"
    log.write_text(json.dumps(the_km()))
    command = [sys.executable, "-m", "possmap", "-q", "fuse", str(log), "-g", str(scratch)]
    variants = {"a new grid": (None, command)} | {
        name: (path, command) for name, path in grids.items()
    }
    return median_costs(runs, variants, scratch)


def say(*columns: str) -> None:
    sys.stdout.write("| " + " | ".join(columns) + " |\n")
    sys.stdout.flush()


def measured(name: str, grid: Path, folder: Path, runs: int) -> None:
    """Print a row for each command that reads a grid."""
    other = Path(shutil.copy(grid, folder / "other.possmap"))
    possmap.fuse(Path(__file__).parents[2] / "data" / "json", other)
    python = [sys.executable, "-m", "possmap", "-q"]
    for title, arguments in commands(grid, other).items():
        suffix = SUFFIXES.get(arguments[0])
        target = ["-o", str(folder / f"out{suffix}"), "--overwrite"] if suffix else []
        command = [*python, *arguments, *target]
        costs = [cost(command) for _ in range(runs)]
        seconds, most = statistics.median(c[0] for c in costs), max(c[1] for c in costs)
        say(name, title, f"{seconds:.2f} s", f"{most:.0f} MiB")
    other.unlink()


def main() -> None:
    """Measure, and print tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sides", default="100,316,1172", help="tiles along a side")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="where grids are kept and found again")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kept = given.folder or folder
        grids = {}
        for side in map(int, given.sides.split(",")):
            path = kept / f"lattice-{side}.possmap"
            if not path.exists():
                write(path, side, side)
            grids[f"{side * side:,} tiles"] = path
        say("a grid of", "command", "time", "peak memory")
        say(*["---"] * 4)
        for title, path in grids.items():
            measured(title, path, folder, given.runs)
        say("the km, fused into", "time", "× a new grid", "peak memory")
        say(*["---"] * 4)
        costs = fusing(grids, folder, max(7, given.runs))
        for title, (seconds, most) in costs.items():
            ratio = seconds / costs["a new grid"][0]
            say(title, f"{seconds:.3f} s", f"{ratio:.2f}", f"{most:.0f} MiB")


if __name__ == "__main__":
    main()
