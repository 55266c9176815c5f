"""How often a robot's true place lies in its error rectangle, estimator by estimator (METHOD §1).

Drives random tracks that err as the error model says, carries their errors with possmap's own
estimators, and prints the shares beside METHOD's reference figures, at 1, 4, 16 and 64 runs.

    python tests/benchmarks/estimators.py [--tracks 20000] [--jobs 2]

On a track of 64 runs between turns of ±45° or ±90°

- a free run of 0.5 to 3 m begins with a kick of the heading, which stays;
- with walls, every fourth run follows one of 1 to 4 m: it sets the heading anew, and goes straight;
- one share of each run's length is lost or gained;
- turns go wrong by one over-turn per track, and by something new each time (``turn_noise``).

All errors are normal, with a half-width of ``factor`` deviations. ``quadrature`` is what would be
wrong: runs added as if each had an error of its own, with no heading that carries on.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from possmap.core.correction import CorrectedStretch, correct
from possmap.core.estimators import at_start
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle, propagate
from possmap.core.records import Pose, Record, Wall
from possmap.core.track import stretches

RUNS = 64
AT = (1, 4, 16, 64)
"""After how many runs it is asked whether the robot is in its rectangle."""

Method: TypeAlias = Literal["linear", "heading", "quadrature"]
METHODS: tuple[Method, ...] = ("linear", "heading", "quadrature")


@dataclass(frozen=True)
class Case:
    """Robots of one kind, and METHOD's figures for them.

    walls : whether they follow one after every three free runs.
    shares : METHOD's share of tracks inside, at 64 runs or at each of AT.
    half_width : METHOD's mean at 64 runs [m]: of √(hx·hy) with walls, of (hx + hy)/2 without.
    """

    name: str
    model: ErrorModel
    walls: bool
    shares: Mapping[Method, Sequence[float]]
    half_width: Mapping[Method, float] = field(default_factory=dict)


NO_TURN_ERROR = Case(
    "no turn error",
    ErrorModel(turn_spread=0),
    walls=False,
    shares={
        "linear": (0.95, 0.94, 0.93, 0.92),
        "heading": (0.95, 0.96, 0.96, 0.95),
        "quadrature": (0.95, 0.69, 0.36, 0.13),
    },
)
CALIBRATED = Case(
    "over-turn ±0.5° per 45°",
    ErrorModel(turn_spread=0.5),
    walls=False,
    shares={"linear": (0.95, 0.99, 1.0, 1.0), "heading": (0.95, 0.96, 0.95, 0.91)},
    half_width={"linear": 37.6, "heading": 6.7},
)
WITH_WALLS = Case(
    "the same, with walls",
    CALIBRATED.model,
    walls=True,
    shares={"linear": (1.0,), "heading": (0.95,)},
    half_width={"linear": 4.3, "heading": 0.77},
)
NOISY_TURNS = Case(
    "±0.425° and noise, with walls",
    ErrorModel(turn_spread=0.425, turn_noise=2.236, alignment_spread=2.236),
    walls=True,
    shares={"linear": (1.0,), "heading": (0.95,)},
    half_width={"linear": 6.1, "heading": 1.11},
)
CASES = (NO_TURN_ERROR, CALIBRATED, WITH_WALLS, NOISY_TURNS)


@dataclass(frozen=True)
class Driven:
    """A track as logged, and how far off the robot was at the end of each run (x, y) [m]."""

    records: list[Record]
    misses: list[tuple[float, float]]


def drive(rng: np.random.Generator, model: ErrorModel, walls: bool, runs: int = RUNS) -> Driven:
    """Drive a random track: what the robot believes is logged, where it really went is kept."""

    def deviation(half_width: float) -> float:
        return float(rng.normal(0, half_width / model.factor))

    over_turn = deviation(math.radians(model.turn_spread))
    records: list[Record] = [Pose(0, None, 0, 0, 0)]
    misses = []
    x = y = heading_deg = 0.0
    true_x = true_y = off = 0.0  # `off`: true heading minus believed [rad]
    for number in range(runs):
        follows = walls and number % 4 == 3
        if number:
            turn_deg = float(rng.choice((45, -45, 90, -90)))
            noise = deviation(math.radians(model.turn_noise))
            off += over_turn * abs(turn_deg) / 45 + noise * math.sqrt(abs(turn_deg) / 45)
            heading_deg += turn_deg
            records.append(Pose(len(records), None, x, y, heading_deg))
        distance = float(rng.uniform(1, 4) if follows else rng.uniform(0.5, 3))
        off = deviation(math.radians(model.alignment_spread)) if follows else off
        off += 0.0 if follows else deviation(model.across)
        believed = math.radians(heading_deg)
        true = believed if follows else believed + off
        true_distance = distance * (1 + deviation(model.along))
        next_x, next_y = x + distance * math.cos(believed), y + distance * math.sin(believed)
        if follows:
            records.append(Wall(len(records), None, x, y, next_x, next_y))
        x, y = next_x, next_y
        records.append(Pose(len(records), None, x, y, heading_deg))
        true_x += true_distance * math.cos(true)
        true_y += true_distance * math.sin(true)
        misses.append((true_x - x, true_y - y))
    return Driven(records, misses)


def rectangles(driven: Driven, model: ErrorModel, method: Method) -> list[ErrorRectangle]:
    """Return the error rectangle at the end of each run."""
    track = correct(stretches(driven.records), model)
    if method == "quadrature":
        return list(_in_quadrature(track, model))
    first = driven.records[0]
    assert isinstance(first, Pose)
    errors = propagate(at_start(first, method), track, model)
    return [
        error.end for error, stretch in zip(errors, track, strict=True) if stretch.logged.is_run
    ]


def _in_quadrature(
    track: Sequence[CorrectedStretch], model: ErrorModel
) -> Iterator[ErrorRectangle]:
    xx = yy = 0.0
    for stretch in track:
        if stretch.logged.is_run:
            along = model.along * stretch.length
            across = 0.0 if stretch.logged.is_followed else model.across * stretch.length
            cos, sin = stretch.along
            xx += (along * cos) ** 2 + (across * sin) ** 2
            yy += (along * sin) ** 2 + (across * cos) ** 2
            yield ErrorRectangle(math.sqrt(xx), math.sqrt(yy))


@dataclass(frozen=True)
class Count:
    """How many tracks ended inside at each of AT, and the sum of their half-widths at 64 runs."""

    inside: tuple[int, ...]
    half_widths: float


def count(case: Case, tracks: int, seed: int | Sequence[int]) -> dict[Method, Count]:
    """Drive so many tracks and count, under each method, who is where he may be."""
    rng = np.random.default_rng(seed)
    inside = {method: [0] * len(AT) for method in METHODS}
    widths = dict.fromkeys(METHODS, 0.0)
    for _ in range(tracks):
        driven = drive(rng, case.model, case.walls)
        for method in METHODS:
            found = rectangles(driven, case.model, method)
            for place, runs in enumerate(AT):
                rect, (miss_x, miss_y) = found[runs - 1], driven.misses[runs - 1]
                inside[method][place] += abs(miss_x) <= rect.half_x and abs(miss_y) <= rect.half_y
            last = found[-1]
            widths[method] += (
                math.sqrt(last.half_x * last.half_y)
                if case.walls
                else (last.half_x + last.half_y) / 2
            )
    return {method: Count(tuple(inside[method]), widths[method]) for method in METHODS}


PORTION = 500
"""Tracks of one seed: the figures do not depend on the number of processes."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--tracks", type=int, default=20_000)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    portions = max(1, options.tracks // PORTION)
    _print_row(
        "robots", "estimator", "inside at 1, 4, 16, 64 runs", "METHOD", "half-width", "METHOD"
    )
    _print_row(*["---"] * 6)
    with ProcessPoolExecutor(options.jobs) as pool:
        for number, case in enumerate(CASES):
            seeds = [(number, portion) for portion in range(portions)]
            counted = list(pool.map(count, [case] * portions, [PORTION] * portions, seeds))
            for method in METHODS:
                _print_row(*_row(case, method, [one[method] for one in counted]))


def _row(case: Case, method: Method, counts: Sequence[Count]) -> Iterator[str]:
    tracks = PORTION * len(counts)
    yield case.name
    yield method
    yield " ".join(
        f"{sum(inside) / tracks:.3f}"
        for inside in zip(*(one.inside for one in counts), strict=True)
    )
    yield " ".join(f"{share:.2f}" for share in case.shares.get(method, ())) or "–"
    yield f"{sum(one.half_widths for one in counts) / tracks:.2f} m"
    yield f"{case.half_width[method]} m" if method in case.half_width else "–"


def _print_row(*columns: str) -> None:
    sys.stdout.write(f"| {' | '.join(columns)} |\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
