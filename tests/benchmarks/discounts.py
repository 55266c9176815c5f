"""What `certainty_power` and `pass_weight` of the profile robust were chosen by.

Drives teams through offices that docs/quality.md does not judge, calibrated and not, one mission
each and then night after night in one house, and fuses them under a grid of values of the two
settings. Prints, as Markdown, means over the missions; every value's map is judged on one mask.

    python tests/benchmarks/discounts.py [--seeds 2] [--nights 20] [--powers ...] [--weights ...]

The other half of what they were chosen by are real legs:

    python tests/benchmarks/real_robots.py --half first --set certainty_power=2 --set ...
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from quality import World, drive, one_night

from possmap.fusing.fuse import fuse
from possmap.lab.evaluate.run import Question, evaluate
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting

WORLDS = tuple(
    World(f"office, seed {seed}", "office", (("world.seed", str(seed)), ("world.size", size)))
    for seed, size in ((31, "[30, 20]"), (32, "[24, 24]"), (33, "[40, 25]"))
)
HOUSE = World("office, seed 34", "office", (("world.seed", "34"), ("world.size", "[16, 12]")))
MEASURES = ("f1_15cm", "f1_5cm", "auc", "dangerous_free", "called_free")

Point = tuple[float, float]
"""A power and a weight."""


def judged(
    folder: Path, logs: Sequence[Path], points: Sequence[Point]
) -> dict[str, Mapping[str, float]]:
    """Fuse logs under every pair of values; return the scores of each and of the baselines."""
    first = folder / "first.possmap"
    first.unlink(missing_ok=True)
    fuse([str(path) for path in logs], first, Request(profile="robust"))
    grids = []
    for power, weight in points:
        given = {"certainty_power": f"{power}", "pass_weight": f"{weight}"}
        parsed = {name: parse_setting(name, text, "--set") for name, text in given.items()}
        grids.append(folder / f"{power:g}-{weight:g}.possmap")
        grids[-1].unlink(missing_ok=True)
        fuse([str(first)], grids[-1], Request(profile="robust", overrides=parsed))
    found = evaluate(grids[0], folder / "truth.json", Question(beside=tuple(grids[1:])))
    names = {"possmap": grids[0].stem}
    return {
        names.get(key, key): {name: getattr(score, name) for name in MEASURES}
        for key, score in found.methods.items()
    }


def say(title: str, outcomes: Sequence[Mapping[str, Mapping[str, float]]]) -> None:
    """Print the mean of every measure."""
    lines = [f"## {title}: {len(outcomes)} missions", ""]
    lines += [f"| power-weight | {' | '.join(MEASURES)} |", "| --- " * (len(MEASURES) + 1) + "|"]
    for name in outcomes[0]:
        told = (statistics.mean(one[name][measure] for one in outcomes) for measure in MEASURES)
        lines.append(f"| {name} | {' | '.join(f'{value:.3f}' for value in told)} |")
    sys.stdout.write("\n".join((*lines, "", "")))
    sys.stdout.flush()


def missions(options: argparse.Namespace, points: Sequence[Point], calibrated: bool) -> None:
    """Judge single missions in several worlds."""
    outcomes = []
    for world, seed in product(WORLDS, range(1, options.seeds + 1)):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "out"
            if drive(world, folder, {"seed": f"{seed}", "calibrated": f"{calibrated}".lower()}):
                outcomes.append(judged(folder, [folder / "logs"], points))
    say(f"one mission, {'' if calibrated else 'not '}calibrated", outcomes)


def nights(options: argparse.Namespace, points: Sequence[Point]) -> None:
    """Judge one house after some nights."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth: dict[str, object] = {"possmap_truth": 1, "walls": [], "robots": [], "meetings": []}
        every = [folder / f"night-{night:02d}" for night in range(1, options.nights + 1)]
        for night, logs in enumerate(every, 1):
            one_night(HOUSE, night, logs, truth, options)
            if night in (1, 5, options.nights):
                (folder / "truth.json").write_text(json.dumps(truth))
                say(f"night {night}", [judged(folder, every[:night], points)])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=2, help="missions of each world")
    parser.add_argument("--nights", type=int, default=20)
    parser.add_argument("--powers", type=float, nargs="+", default=[1.5, 2, 3, 4])
    parser.add_argument("--weights", type=float, nargs="+", default=[0.5, 0.7, 0.9])
    parser.set_defaults(first_seed=500, broken=None, calibrated=True)
    options = parser.parse_args()
    points = list(product(options.powers, options.weights))
    for calibrated in (True, False):
        missions(options, points, calibrated)
    nights(options, points)


if __name__ == "__main__":
    main()
