"""How true maps are: profiles of possmap and log-odds grids on the same logs, over many seeds.

Drives teams through worlds, fuses what comes home under each profile, and holds all maps against
the truth on one mask, as `possmap evaluate --beside` does. Prints the tables of docs/quality.md:
medians over seeds, and reliability over all of them together.

    python tests/benchmarks/quality.py [--worlds report] [--seeds 20] [--jobs 2]
    python tests/benchmarks/quality.py --worlds tuning --variant 'robust:max_error=0.7'

Settings were chosen on the worlds called ``tuning``; those called ``report`` had no say in it.
Floor plans are taken from ../shared where it is there, and left out where it is not.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from possmap.lab.evaluate.evaluate import Baselines

from possmap.fusing.fuse import fuse
from possmap.lab.evaluate.bayes import BayesSettings
from possmap.lab.evaluate.distance import squared_distances
from possmap.lab.evaluate.results import Evaluation
from possmap.lab.evaluate.run import Question, evaluate
from possmap.lab.evaluate.smeared import SmearSettings
from possmap.lab.simulate.run import simulate
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting
from possmap.truth.plans import read_image

ROOT = Path(__file__).parents[2]
MISSIONS = ROOT / "configs" / "missions"
PLANS = ROOT.parent / "shared" / "realdata" / "worlds"
PIXEL_M = 0.05
CLEAR_M = 1.0
"""Between home and the nearest wall of a floor plan."""


@dataclass(frozen=True)
class World:
    """Where a team drives.

    mission : a shipped one, which also says how many robots; more : keys that differ.
    plan : the image of a floor plan that takes the place of the mission's world.
    """

    name: str
    mission: str
    more: tuple[tuple[str, str], ...] = ()
    plan: str = ""


WORLDS = {
    "tuning": [
        World("figure8", "figure8"),
        World("office", "office"),
        World("office, seed 21", "office", (("world.seed", "21"), ("world.size", "[24, 24]"))),
    ],
    "report": [
        World("maze", "maze"),
        World("drops", "drops"),
        World("office, seed 8", "office", (("world.seed", "8"), ("world.size", "[40, 25]"))),
        World("office, seed 9", "office", (("world.seed", "9"), ("world.size", "[25, 16]"))),
        World("plan Freiburg79", "office", plan="Freiburg79_scan.png"),
        World("plan lab_c", "office", plan="lab_c_scan.png"),
        World("plan office_a", "office", plan="office_a.png"),
        World("plan NLB", "office", plan="NLB.png"),
    ],
}
SHARED_ABSENT = "left out, since ../shared is not there"


@dataclass(frozen=True)
class Variant:
    """Settings under which the logs are fused, by a name."""

    name: str
    profile: str = "robust"
    settings: tuple[tuple[str, str], ...] = ()

    @classmethod
    def parse(cls, text: str) -> Variant:
        """Read ``profile:key=value,...``."""
        profile, _, rest = text.partition(":")
        pairs = [pair.partition("=") for pair in rest.split(",") if pair]
        return cls(text, profile, tuple((key, value) for key, _, value in pairs))

    def request(self) -> Request:
        """Return what to ask of fuse."""
        given = {name: parse_setting(name, text, "--variant") for name, text in self.settings}
        return Request(profile=self.profile, overrides=given)


BODY = Variant("robust, path_width 0.15", settings=(("path_width", "0.15"),))

TUNED = SmearSettings(free=0.2)
"""Of hit 0.4, 0.85, 1.7 and free 0.1 to 0.8 what ranks best on the worlds called tuning."""

MEASURES: dict[str, Callable[[Evaluation, str], float | None]] = {
    "AUC": lambda e, m: e.methods[m].auc,
    "F1 5 cm": lambda e, m: e.methods[m].f1_5cm,
    "F1 15 cm": lambda e, m: e.methods[m].f1_15cm,
    "Brier": lambda e, m: e.methods[m].brier.score,
    "log score": lambda e, m: e.methods[m].log_score.score,
    "refinement": lambda e, m: e.methods[m].log_score.refinement,
    "dangerously free": lambda e, m: e.methods[m].dangerous_free,
    "contradicted": lambda e, m: e.intervals[m].contradicted if m in e.intervals else None,
    "left open": lambda e, m: e.intervals[m].sharpness if m in e.intervals else None,
    "rectangles": lambda e, m: _rectangles(e, m, "coverage_by_length"),
    "half-width": lambda e, m: _rectangles(e, m, "mean_half_width"),
}

Bins = dict[tuple[float, float], tuple[float, float, float]]
"""By N's bounds: cells, sum of N, cells with a wall within the local rectangle."""


@dataclass
class Outcome:
    """One mission's maps.

    metres : truly run by each robot, on average; home : share of excursions.
    scores : by method and measure.
    lower : reliability of N, by method.
    held : metres run, and those that ended within the rectangle, by method.
    reference : F1 of calling all wall, and of true poses.
    """

    metres: float
    home: float
    scores: dict[tuple[str, str], float] = field(default_factory=dict)
    lower: dict[str, Bins] = field(default_factory=dict)
    held: dict[str, tuple[float, float]] = field(default_factory=dict)
    reference: tuple[float | None, float | None] = (None, None)


def _rectangles(found: Evaluation, method: str, name: str) -> float | None:
    one = found.rectangles.get(method)
    value: float | None = None if one is None else getattr(one, name)
    return value


def home_of(plan: Path) -> tuple[float, float]:
    """Return a place of a plan with room around it, as near to its middle as can be."""
    free = read_image(plan, PIXEL_M).free
    reach = round(CLEAR_M / PIXEL_M)
    roomy = np.argwhere(squared_distances(~np.pad(free, reach), reach) > reach**2) - reach
    middle = roomy.mean(axis=0)
    row, column = roomy[np.argmin(((roomy - middle) ** 2).sum(axis=1))].tolist()
    return (column + 0.5) * PIXEL_M, (row + 0.5) * PIXEL_M


def overrides(world: World, seed: int) -> dict[str, str]:
    """Return the mission's values that a world changes."""
    given = {"seed": str(seed), **dict(world.more)}
    if world.plan:
        x, y = home_of(PLANS / world.plan)
        image = f"{{image: {PLANS / world.plan}, resolution: {PIXEL_M}, home: [{x}, {y}]}}"
        given["world"] = image
    return given


def one(
    world: World, variants: Sequence[Variant], baselines: Baselines, seed: int
) -> Outcome | None:
    """Drive, fuse and judge one mission; None if nobody came home."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        mission = MISSIONS / f"{world.mission}.yaml"
        if world.plan:
            text = "\n".join(f"{key}: {value}" for key, value in overrides(world, seed).items())
            mission = Path(name) / "mission.yaml"
            mission.write_text(f"robots: 6\n{text}\n")
            summary = simulate(mission, folder, {})
        else:
            summary = simulate(mission, folder, overrides(world, seed))
        if not summary.home:
            return None
        grids = []
        for number, variant in enumerate(variants):
            grids.append(Path(name) / f"{number}.possmap")
            fuse([str(folder / "logs")], grids[-1], variant.request())
        question = Question(beside=tuple(grids[1:]), baselines=baselines)
        found = evaluate(grids[0], folder / "truth.json", question)
        names = dict(zip(found.methods, (v.name for v in variants), strict=False))
        robots = {one.robot for one in summary.outings}
        outcome = Outcome(
            sum(one.distance for one in summary.outings) / len(robots),
            summary.home / len(summary.outings),
        )
        for method in found.methods:
            for measure, look in MEASURES.items():
                value = look(found, method)
                if value is not None:
                    outcome.scores[names.get(method, method), measure] = value
        for method, interval in found.intervals.items():
            outcome.lower[names[method]] = {
                (part.low, part.high): (
                    part.cells,
                    part.cells * part.mean,
                    part.cells * part.wall_local,
                )
                for part in interval.lower_validity
            }
        for method, tracks in found.tracks.items():
            steps = [np.diff(one.distance, prepend=0.0) for one in tracks]
            inside = sum(float((s * o.inside).sum()) for s, o in zip(steps, tracks, strict=True))
            outcome.held[names[method]] = float(sum(s.sum() for s in steps)), inside
        reference = found.reference
        outcome.reference = reference.all_wall_f1_15cm, reference.true_pose_f1_15cm
        return outcome


def tables(world: World, outcomes: list[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """Yield the lines of one world's tables."""
    metres = statistics.median(one.metres for one in outcomes)
    home = statistics.mean(one.home for one in outcomes)
    floor, ceiling = (
        statistics.median(value for value in values if value is not None)
        for values in zip(*(one.reference for one in outcomes), strict=True)
    )
    yield (
        f"**{world.name}**: {len(outcomes)} missions, {metres:.0f} m a robot, {home:.0%} of the "
        f"excursions came home; F1 15 cm of calling all wall {floor:.2f}, at true poses "
        f"{ceiling:.2f}"
    )
    yield ""
    yield f"| | {' | '.join(MEASURES)} |"
    yield f"|{' --- |' * (len(MEASURES) + 1)}"
    for method in methods:
        cells = []
        for measure in MEASURES:
            values = [o.scores[method, measure] for o in outcomes if (method, measure) in o.scores]
            cells.append(f"{statistics.median(values):.3f}" if values else "–")
        yield f"| {method} | {' | '.join(cells)} |"
    yield ""
    yield "Rectangles hold the true place on " + ", ".join(
        f"{_held(outcomes, method):.1%} of the way under {method}"
        for method in methods
        if method in outcomes[0].held
    )
    yield ""


def _held(outcomes: Sequence[Outcome], method: str) -> float:
    """Return the share of all the way that lies within rectangles: missions count by length."""
    metres, inside = np.sum([one.held[method] for one in outcomes], axis=0)
    return float(inside / metres)


def reliability(outcomes: Sequence[Outcome], variants: Sequence[Variant]) -> Iterator[str]:
    """Yield the table of N against walls within the local rectangle, over all missions."""
    for variant in variants:
        total: dict[tuple[float, float], np.ndarray] = defaultdict(lambda: np.zeros(3))
        for outcome in outcomes:
            for bounds, counts in outcome.lower[variant.name].items():
                total[bounds] += counts
        yield f"N of {variant.name}, all missions together: mean N → share with a wall within"
        yield "  ".join(
            f"{sums[1] / sums[0]:.2f} → {sums[2] / sums[0]:.3f}"
            for bounds, sums in sorted(total.items())
            if bounds[1]
        )
        yield ""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--worlds", choices=[*WORLDS, "all"], default="report")
    parser.add_argument("--only", help="only worlds whose name holds this")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--variant", action="append", default=[], metavar="PROFILE:KEY=VALUE,...")
    parser.add_argument("--hit", type=float)
    parser.add_argument("--free", type=float)
    parser.add_argument("--smeared-hit", type=float)
    parser.add_argument("--smeared-free", type=float)
    parser.add_argument("--smeared-height", choices=["mass", "peak"])
    options = parser.parse_args()
    variants = [Variant("robust"), Variant("paper", "paper"), BODY]
    variants += [Variant.parse(text) for text in options.variant]
    given = {k: v for k, v in (("hit", options.hit), ("free", options.free)) if v is not None}
    smeared = {
        key: value
        for key, value in (
            ("hit", options.smeared_hit),
            ("free", options.smeared_free),
            ("height", options.smeared_height),
        )
        if value is not None
    }
    baselines = Baselines(replace(BayesSettings(), **given), replace(TUNED, **smeared))
    sets = WORLDS if options.worlds == "all" else [options.worlds]
    chosen = [world for name in sets for world in WORLDS[name]]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    everything: list[Outcome] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for world in chosen:
            if options.only and options.only not in world.name:
                continue
            if world.plan and not (PLANS / world.plan).exists():
                say(f"**{world.name}**: {SHARED_ABSENT}", "")
                continue
            drive = partial(one, world, variants, baselines)
            outcomes = [outcome for outcome in pool.map(drive, seeds) if outcome is not None]
            everything += outcomes
            names = [*(variant.name for variant in variants), "bayes", "bayes-smeared"]
            say(*tables(world, outcomes, names))
    say(*reliability(everything, variants))


def say(*lines: str) -> None:
    """Print lines at once."""
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
