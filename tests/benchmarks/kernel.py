"""What a swept cell costs: the compiled kernel, a bare C loop, a memory pass and the plain kernel.

The bare loop is METHOD §2 as it stands, compiled when this runs: two profiles of 16-bit integers
for each stamp, then min and max over its cells. It must give the kernel's integers. Swept cells are
the distinct cells of each segment, summed over segments; touches are the cells of all stamps. CPU
time of interleaved rounds, medians; a ratio is the median of the rounds' ratios.

    python tests/benchmarks/kernel.py [--rounds 15] [--no-plain]
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from kernel_scenes import Scene, Values, km_scenes, run_scene

from possmap.core import kernel, plain_kernel
from possmap.core.fusion import WEIGHT
from possmap.core.lattice import Window, tile_window
from possmap.core.pyramid import COLUMNS

Work: TypeAlias = Callable[[], object]

LEAST = 0.02
"""CPU time of one measurement [s]: shorter work is repeated."""

BARE = r"""
#include <math.h>
#include <stdint.h>
static uint16_t up[65536], across[65536];
static inline void profile(uint16_t *out, int reach, double half, double max_error, double c)
{
    double height = 1 - half / max_error;
    for (int i = -reach; i <= reach; i++) {
        double slope = 1 - (double)(i < 0 ? -i : i) * c / (half + c / 2);
        out[i + reach] = (uint16_t)(int)(65535 * (height * (slope > 0 ? slope : 0)) + 0.5);
    }
}
void bare(uint16_t *block, int64_t row0, int64_t column0, int64_t columns, const double *s,
          int64_t first, int64_t last, double c)
{
    double x0 = s[0], y0 = s[1], x1 = s[2], y1 = s[3], limit = s[8];
    double n = fmax(1, ceil(fmax(fabs(x1 - x0), fabs(y1 - y0)) / c - 1e-6));
    for (int64_t k = first; k <= last; k++) {
        double share = (double)k / n;
        int64_t row = (int64_t)floor((y0 + share * (y1 - y0)) / c + 1e-6);
        int64_t column = (int64_t)floor((x0 + share * (x1 - x0)) / c + 1e-6);
        double half_x = s[4] + share * (s[6] - s[4]), half_y = s[5] + share * (s[7] - s[5]);
        int64_t reach_x = (int64_t)ceil(half_x / c + 0.5) - 1;
        int64_t reach_y = (int64_t)ceil(half_y / c + 0.5) - 1;
        profile(up, (int)reach_y, half_y, limit, c);
        profile(across, (int)reach_x, half_x, limit, c);
        for (int64_t i = 0; i <= 2 * reach_y; i++) {
            uint16_t *line = block + (row - reach_y + i - row0) * columns;
            line += column - reach_x - column0;
            for (int64_t j = 0; j <= 2 * reach_x; j++) {
                uint16_t least = across[j] < up[i] ? across[j] : up[i];
                line[j] = line[j] > least ? line[j] : least;
            }
        }
    }
}
void bare_all(uint16_t *block, int64_t row0, int64_t column0, int64_t columns, const double *s,
              int64_t width, const int64_t *spans, int64_t count, double c)
{
    for (int64_t i = 0; i < count; i++)
        bare(block, row0, column0, columns, s + i * width, spans[2 * i], spans[2 * i + 1], c);
}
"""


class BareLoop:
    """The bare loop, compiled as the kernel is, without -march."""

    FLAGS = ("-O3", "-ffp-contract=off", "-shared", "-fPIC")

    def __init__(self, compiler: str, folder: Path) -> None:
        source, library = folder / "bare.c", folder / "bare.so"
        source.write_text(BARE)
        subprocess.run([compiler, *self.FLAGS, "-o", library, source, "-lm"], check=True)
        self._function = ctypes.CDLL(str(library)).bare_all
        number, address = ctypes.c_int64, ctypes.c_void_p
        self._function.argtypes = [
            address,
            number,
            number,
            number,
            address,
            number,
            address,
            number,
        ]
        self._function.argtypes += [ctypes.c_double]
        self._function.restype = None

    def raise_block(self, block: Values, window: Window, scene: Scene) -> None:
        """Raise a block, whose window must hold every stamp whole."""
        self._function(
            block.ctypes.data, window.row0, window.column0, window.shape[1],
            scene.table.ctypes.data, len(COLUMNS), scene.spans.ctypes.data, len(scene.table),
            scene.resolution,
        )  # fmt: skip


def measured(works: Mapping[str, Work], rounds: int) -> dict[str, list[float]]:
    """Return seconds of CPU time of each work in each round, all of them in turn."""
    repeats = {}
    for name, work in works.items():
        work()
        start = time.process_time()
        work()
        repeats[name] = max(1, round(LEAST / max(1e-7, time.process_time() - start)))
    found: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            start = time.process_time()
            for _ in range(repeats[name]):
                work()
            found[name].append((time.process_time() - start) / repeats[name])
    return found


def ratio(of: list[float], to: list[float]) -> float:
    return statistics.median(one / other for one, other in zip(of, to, strict=True))


def in_one_array(scene: Scene, bare: BareLoop | None) -> dict[str, Work]:
    """Return the kernel and the bare loop at work on one array each; they must agree."""
    block, other = scene.blank(), scene.blank()

    def compiled() -> None:
        kernel.raise_block(block, scene.window, scene.table, scene.pieces, scene.resolution)

    compiled()
    if bare is None:
        return {"kernel": compiled}
    bare.raise_block(other, scene.window, scene)
    if not np.array_equal(block, other):
        raise SystemExit("the kernel and the bare loop give different integers")
    return {"kernel": compiled, "bare": lambda: bare.raise_block(other, scene.window, scene)}


def in_tiles(scene: Scene, walls: bool = False) -> Work:
    """Return the kernel at work as ``possmap fuse`` uses it: a tile at a time, walls as weights."""
    works = scene.by_tile()
    kind = np.int64 if walls else np.uint16
    blocks = {key: np.zeros(tile_window(key).shape, dtype=kind) for key, _ in works}

    def work() -> None:
        for key, pieces in works:
            place = blocks[key], tile_window(key), scene.table, pieces, scene.resolution
            if walls:
                kernel.reinforce(*place, WEIGHT)
            else:
                kernel.raise_block(*place)

    return work


def passes() -> dict[str, tuple[int, Work]]:
    """Return memory passes, np.maximum in place, with how many cells each goes over."""
    found: dict[str, tuple[int, Work]] = {}
    for name, cells in (("DRAM", 2**26), ("L2", 2**17)):
        one, other = (np.full(cells, value, dtype=np.uint16) for value in (1, 2))
        found[name] = cells, partial(np.maximum, one, other, out=one)
    return found


def table(title: str, head: str, rows: list[list[str]]) -> None:
    names = [name.strip() for name in head.split("|")]
    lines = [names, ["---"] * len(names), *rows]
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    sys.stdout.write(f"\n{title}\n\n{text}\n")
    sys.stdout.flush()


def per(seconds: list[float], cells: int) -> str:
    """Return the median as nanoseconds a cell."""
    ns = statistics.median(seconds) / cells * 1e9
    return f"{ns:.2f}" if ns < 100 else f"{ns:.0f}"


def the_km_tables(bare: BareLoop | None, rounds: int) -> None:
    alone, in_fuse = [], []
    cases = [(c, 1.0, 1.0) for c in (0.1, 0.05, 0.025)]
    cases += [(0.05, limit, limit) for limit in (0.25, 0.5, 2.0)] + [(0.05, 1.0, 0.25)]
    for c, max_error, growth in cases:
        free, walls = km_scenes(c, max_error, growth)
        both = Scene.of(np.concatenate([free.table, walls.table]), c)
        works = in_one_array(both, bare)
        works |= {"free": in_tiles(free), "walls": in_tiles(walls, walls=True)}
        works["touch"] = partial(kernel.touch, both.table, c)
        found = measured(works, rounds)
        case = [f"{c * 100:g} cm", f"{max_error:g} m", f"{growth:g} m"]
        sizes = [f"{both.swept / 1e6:.2f} M", f"{both.touches / both.swept:.1f}"]
        alone.append([*case, *sizes, *beside_bare(found, both)])
        stamped = [sum(pair) for pair in zip(found["free"], found["walls"], strict=True)]
        in_fuse.append(
            [
                *case, per(found["free"], free.swept), per(found["walls"], walls.swept),
                per(stamped, both.swept),
                f"{ratio(stamped, found['bare']):.2f}" if bare else "–",
                f"{statistics.median(found['touch']) * 1e3:.2f} ms",
            ]
        )  # fmt: skip
    columns = "resolution | max_error | error at the end"
    table(
        "The km in one array, ns per swept cell",
        f"{columns} | swept cells | touches a cell | kernel | a touch | bare loop | ratio",
        alone,
    )
    table(
        "The km as fuse stamps it, a tile at a time, ns per swept cell",
        f"{columns} | free (raise) | walls (reinforce) | both | to the bare loop | touch, a km",
        in_fuse,
    )


def beside_bare(found: Mapping[str, list[float]], scene: Scene) -> list[str]:
    """Return the kernel's time per swept cell and per touch, the bare loop's, and the ratio."""
    alone = [per(found["kernel"], scene.swept), per(found["kernel"], scene.touches)]
    if "bare" not in found:
        return [*alone, "–", "–"]
    slower = ratio(found["kernel"], found["bare"])
    return [*alone, per(found["bare"], scene.swept), f"{slower:.2f}"]


def directions_table(bare: BareLoop | None, rounds: int) -> None:
    rows, largest = [], 0.0
    kinds = {"equal, 0.5 m": (0.5, 0.5), "from 0.2 to 0.8 m": (0.2, 0.8), "none": (0.0, 0.0)}
    for name, halves in kinds.items():
        for step in range(13):
            scene = run_scene(step * 7.5, *halves)
            found = measured(in_one_array(scene, bare), rounds)
            rows.append([name, f"{step * 7.5:g}°", *beside_bare(found, scene)])
            if bare:
                largest = max(largest, ratio(found["kernel"], found["bare"]))
    columns = "half-widths | direction | kernel | a touch | bare loop | ratio"
    table("A run of 4 m at 5 cm by direction, in one array, ns per swept cell", columns, rows)
    if bare:
        sys.stdout.write(f"\nlargest ratio to the bare loop: {largest:.2f}\n")


def floor_table(rounds: int, plain: bool) -> None:
    free, walls = km_scenes(0.05, 1.0, 1.0)
    both = Scene.of(np.concatenate([free.table, walls.table]), 0.05)
    every = passes()
    found = measured({name: work for name, (_, work) in every.items()}, rounds)
    found_kernel = measured(in_one_array(both, None), rounds)["kernel"]
    base = statistics.median(found_kernel) / both.swept
    names = {f"memory pass, {name}": (found[name], cells) for name, (cells, _) in every.items()}
    names["kernel, compiled"] = found_kernel, both.swept
    if plain:
        block = both.blank()
        work = partial(plain_kernel.raise_block, block, both.window, both.table, both.pieces, 0.05)
        seconds = measured({"plain": work}, max(3, rounds // 5))["plain"]
        names["kernel, plain (NumPy)"] = seconds, both.swept
    rows = [
        [name, per(seconds, cells), f"{statistics.median(seconds) / cells / base:.2f}"]
        for name, (seconds, cells) in names.items()
    ]
    table("The floor: the km at 5 cm", "what | ns per swept cell | to the kernel", rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--no-plain", action="store_true", help="leave the plain kernel out")
    options = parser.parse_args()
    if not kernel.COMPILED:
        raise SystemExit(
            "no compiled kernel was built, or POSSMAP_KERNEL=numpy chose the plain one"
        )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compiler = shutil.which("cc")
        bare = BareLoop(compiler, folder) if compiler else None
        if bare is None:
            sys.stdout.write("no compiler (cc): no bare loop to compare with\n")
        directions_table(bare, options.rounds)
        the_km_tables(bare, options.rounds)
        floor_table(options.rounds, not options.no_plain)


if __name__ == "__main__":
    main()
