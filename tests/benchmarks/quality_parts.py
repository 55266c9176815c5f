"""What makes maps rank: walls and paths of possmap and of smeared log-odds, put together crosswise.

On the worlds on which settings were chosen, each map is taken apart into what speaks for walls and
what speaks against them. Prints AUC, F1 within 15 cm and the share of walls called free (Π < 0.5)
of each pairing; docs/quality.md draws its conclusion.

    python tests/benchmarks/quality_parts.py [--seeds 4] [--jobs 2]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from quality import BODY, MISSIONS, TUNED, WORLDS, Variant, World, overrides

from possmap.core.evidence import findings
from possmap.core.lattice import Window
from possmap.fusing.fuse import fuse
from possmap.grid.grid import Grid
from possmap.lab.evaluate.bayes import BayesSettings, bayes
from possmap.lab.evaluate.exam import Exam
from possmap.lab.evaluate.raster import Floats, grown
from possmap.lab.evaluate.smeared import bayes_smeared
from possmap.lab.evaluate.strokes import Outing
from possmap.lab.evaluate.true_map import TrueMap, true_map
from possmap.lab.simulate.run import simulate
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

MARGIN = 30
MOST_CELLS = 25_000_000
SUMMED = 0.8
"""Weight of evidence against a wall that one excursion's certain swath has, where they add up."""

Scores = dict[str, tuple[float, float, float]]


def one(world: World, seed: int) -> Scores:
    """Drive a mission, fuse it twice, and score every pairing on one mask."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        simulate(MISSIONS / f"{world.mission}.yaml", folder, overrides(world, seed))
        grids = []
        for variant in (Variant("robust"), BODY):
            grids.append(Path(name) / f"{len(grids)}.possmap")
            fuse([str(folder / "logs")], grids[-1], variant.request())
        truth = read_truth(folder / "truth.json", Limits())
        with Grid(grids[0]) as plain, Grid(grids[1]) as swept:
            assert plain.window is not None and swept.window is not None
            window = grown(plain.window.union(swept.window), MARGIN)
            entries = list(plain.ledger.entries())
            versions = [plain.ledger.version(entry) for entry in entries]
            outings = [
                Outing(version, findings(version, entry.model, plain.settings))
                for entry, version in zip(entries, versions, strict=True)
            ]
            n = plain.necessity(window)
            paths = {"pyramids": plain.possibility(window), "swaths": swept.possibility(window)}
        inside = np.concatenate([track[:, 1:3] for track in truth.tracks.values()])
        true = true_map(np.array(truth.walls), inside, window, 0.05, MOST_CELLS)
        return dict(_scored(outings, window, n, paths, true))


def _scored(
    outings: list[Outing], window: Window, n: Floats, paths: dict[str, Floats], true: TrueMap
) -> Iterator[tuple[str, tuple[float, float, float]]]:
    walls = bayes_smeared(outings, window, 0.05, replace(TUNED, free=0.0))
    # Each excursion's probability that a body went over a cell, added up over excursions.
    swept = bayes_smeared(outings, window, 0.05, replace(TUNED, hit=0.0, free=1.0, low=-99.0))
    both = bayes_smeared(outings, window, 0.05, TUNED)
    sharp = bayes(outings, window, 0.05, BayesSettings())
    touched = (n > 0) | both.touched | sharp.touched
    for possibility in paths.values():
        touched |= possibility < 1
    exam = Exam.of(true, touched)
    m = exam.mask
    summed = np.exp(SUMMED * swept.log_odds.astype(np.float64))
    rows: dict[str, tuple[Floats, Floats]] = {
        "walls by pyramids alone": (n, np.ones_like(n)),
        "walls by Gaussians alone": (walls.log_odds.astype(np.float64), np.ones_like(n)),
        "pyramids, strongest pyramid of a path": ((n + paths["pyramids"]) / 2, paths["pyramids"]),
        "pyramids, strongest swath of a path": ((n + paths["swaths"]) / 2, paths["swaths"]),
        "pyramids, swaths added up over excursions": ((n + summed) / 2, summed),
        "Gaussians for both, added up": (
            both.log_odds.astype(np.float64),
            np.where(both.log_odds < 0, 0.0, 1.0),
        ),
    }
    for name, (score, possibility) in rows.items():
        found = exam.score(score[m], np.full(int(m.sum()), 0.5), possibility[m] < 0.5)
        yield name, (found.auc or 0.0, found.f1_15cm or 0.0, found.dangerous_free or 0.0)


def main() -> None:
    """Print a table for each world."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.jobs) as pool:
        for world in WORLDS["tuning"]:
            scored = list(pool.map(partial(one, world), range(1, options.seeds + 1)))
            sys.stdout.write(
                f"| {world.name} | AUC | F1 15 cm | walls called free |\n|{' --- |' * 4}\n"
            )
            for name in scored[0]:
                values = [statistics.median(one[name][k] for one in scored) for k in range(3)]
                cells = " | ".join(f"{value:.3f}" for value in values)
                sys.stdout.write(f"| {name} | {cells} |\n")
            sys.stdout.write("\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
