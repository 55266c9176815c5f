"""How often a robot's true place lies in its error rectangle, estimator by estimator (METHOD §1).

Drives random tracks that err as the error model says, carries their errors with possmap's own
estimators, and prints the shares beside METHOD's reference figures, at 1, 4, 16 and 64 runs.

    python tests/benchmarks/estimators.py [--tracks 20000] [--jobs 2]

On a track of 64 runs between turns of ±45° or ±90°

- a free run of 0.5 to 3 m begins with a kick of the heading, which stays;
- with walls, every fourth run follows one of 1 to 4 m along an axis of the building: it sets the
  heading anew, and goes straight; free runs may see others in passing, noisy and tilted;
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
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, cast

import numpy as np

from possmap.core.correction import CorrectedStretch
from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.records import Pose, Record, Wall
from possmap.core.settings import Estimator, EvidenceSettings

RUNS = 64
AT = (1, 4, 16, 64)
"""After how many runs it is asked whether the robot is in its rectangle."""

Method: TypeAlias = Literal["linear", "heading", "quadrature", "walls", "walls seen"]
METHODS: tuple[Method, ...] = ("linear", "heading", "quadrature", "walls", "walls seen")
SEEN_M = (0.5, 3.0)
"""Length of a wall seen in passing."""


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


def _by_walls(name: str, model: ErrorModel, **figures: tuple[float, float]) -> Case:
    """Return a case of METHOD's table of the estimator walls: share and half-width of each."""
    named: dict[str, tuple[float, float]] = {
        one.replace("_", " "): figure for one, figure in figures.items()
    }
    methods = [method for method in METHODS if method in named]
    return Case(
        name,
        model,
        walls=True,
        shares={method: (named[method][0],) for method in methods},
        half_width={method: named[method][1] for method in methods},
    )


CASES = (
    NO_TURN_ERROR,
    CALIBRATED,
    _by_walls(
        "±0.5°, with walls",
        ErrorModel(turn_spread=0.5),
        linear=(1.0, 4.3),
        heading=(0.951, 0.77),
        walls=(0.949, 0.33),
        walls_seen=(0.942, 0.31),
    ),
    _by_walls(
        "±0.5°, noise 0.7°, with walls",
        ErrorModel(turn_spread=0.5, turn_noise=0.7),
        heading=(0.946, 0.80),
        walls=(0.943, 0.35),
        walls_seen=(0.938, 0.33),
    ),
    _by_walls(
        "±2°, noise 0.7°, with walls",
        ErrorModel(turn_spread=2, turn_noise=0.7),
        heading=(0.956, 1.32),
        walls=(0.944, 0.35),
        walls_seen=(0.944, 0.33),
    ),
    _by_walls(
        "±0.425°, noise and lining up 2.236°, with walls",
        ErrorModel(turn_spread=0.425, turn_noise=2.236, alignment_spread=2.236),
        linear=(1.0, 6.1),
        # METHOD has .976 at .61 m for walls, .976 at .54 with walls seen. Here lining up leaves an
        # error that the next turn starts from: .94 at .65, .93 at .50.
        heading=(0.954, 1.12),
    ),
)


@dataclass(frozen=True)
class Driven:
    """A track as logged, and where the robot truly was at the end of each run (x, y) [m].

    seen : the walls seen in passing, each to stand before the pose of that number.
    """

    records: list[Record]
    places: list[tuple[float, float]]
    seen: Mapping[int, Wall]

    def with_seen(self) -> list[Record]:
        """Return the records with what was seen in passing."""
        every = [
            one
            for record in self.records
            for one in (self.seen.get(record.seq), record)
            if one is not None
        ]
        return [replace(one, seq=seq) for seq, one in enumerate(every)]


def drive(rng: np.random.Generator, model: ErrorModel, walls: bool, runs: int = RUNS) -> Driven:
    """Drive a random track: what the robot believes is logged, where it really went is kept."""

    def deviation(half_width: float) -> float:
        return float(rng.normal(0, half_width / model.factor))

    over_turn = deviation(math.radians(model.turn_spread))
    records: list[Record] = [Pose(0, 0.0, 0, 0, 0)]
    places = []
    seen: dict[int, Wall] = {}
    x = y = heading_deg = 0.0
    true_x = true_y = off = 0.0  # `off`: true heading minus believed [rad]

    def stands_at(t: float, heading_deg: float) -> None:
        records.append(Pose(len(records), t, x, y, heading_deg))

    for number in range(runs):
        follows, t = walls and number % 4 == 3, float(number)
        if number:
            turn_deg = float(rng.choice((45, -45, 90, -90)))
            noise = deviation(math.radians(model.turn_noise))
            if follows:
                # It turns until it faces along the wall, and sets its belief to a right angle.
                if (heading_deg + turn_deg) % 90:
                    turn_deg = math.copysign(135 - abs(turn_deg), turn_deg)
                axis_deg = heading_deg + turn_deg
                off_axis = deviation(math.radians(model.alignment_spread))
                true_turn = math.radians(turn_deg) + off_axis - off
                logged = true_turn
                for _ in range(3):
                    logged = true_turn - _gone_wrong(math.degrees(logged), over_turn, noise)
                stands_at(t, heading_deg + math.degrees(logged))
                heading_deg, off = axis_deg, off_axis
            else:
                off += _gone_wrong(turn_deg, over_turn, noise)
                heading_deg += turn_deg
            stands_at(t, heading_deg)
        distance = float(rng.uniform(1, 4) if follows else rng.uniform(0.5, 3))
        off += 0.0 if follows else deviation(model.across)
        believed = math.radians(heading_deg)
        true = believed if follows else believed + off
        true_distance = distance * (1 + deviation(model.along))
        next_x, next_y = x + distance * math.cos(believed), y + distance * math.sin(believed)
        if follows:
            records.append(Wall(len(records), None, x, y, next_x, next_y))
        elif walls:
            seen[len(records)] = _seen(rng, model, (x, y), off)
        x, y = next_x, next_y
        stands_at(t + 0.5, heading_deg)
        true_x += true_distance * math.cos(true)
        true_y += true_distance * math.sin(true)
        places.append((true_x, true_y))
    return Driven(records, places, seen)


def _gone_wrong(turn_deg: float, over_turn: float, noise: float) -> float:
    """Return by how much a turn is further than it is believed to be [rad]."""
    parts = abs(turn_deg) / 45
    return over_turn * parts + noise * math.sqrt(parts)


def _seen(rng: np.random.Generator, model: ErrorModel, at: tuple[float, float], off: float) -> Wall:
    """Return a wall near a place as the robot logs it, which believes its heading ``off`` less."""
    length = float(rng.uniform(*SEEN_M))
    tilt = math.radians(float(rng.normal(0, model.wall_tilt / model.factor)))
    direction = float(rng.choice((0.0, math.pi / 2))) + tilt - off
    sin, cos = math.sin(direction), math.cos(direction)
    (x, y), noise = at, rng.normal(0, model.wall_noise / model.factor, 2).tolist()
    return Wall(
        0,
        None,
        x - noise[0] * sin,
        y + noise[0] * cos,
        x + length * cos - noise[1] * sin,
        y + length * sin + noise[1] * cos,
        followed=False,
    )


def rectangles(
    driven: Driven, model: ErrorModel, method: Method
) -> list[tuple[tuple[float, float], ErrorRectangle]]:
    """Return place and error rectangle at the end of each run."""
    records = driven.with_seen() if method == "walls seen" else driven.records
    name = {"walls seen": "walls", "quadrature": "linear"}.get(method, method)
    settings = EvidenceSettings(estimator=cast("Estimator", name), orthogonal=True)
    found = estimate(records, model, settings)
    runs = [
        (stretch.end, error.end)
        for stretch, error in zip(found.stretches, found.errors, strict=True)
        if stretch.logged.is_run
    ]
    if method == "quadrature":
        rects = _in_quadrature(found.stretches, model)
        return [(place, rect) for (place, _), rect in zip(runs, rects, strict=True)]
    return runs


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
    methods = tuple(case.shares)
    inside = {method: [0] * len(AT) for method in methods}
    widths = dict.fromkeys(methods, 0.0)
    for _ in range(tracks):
        driven = drive(rng, case.model, case.walls)
        for method in methods:
            found = rectangles(driven, case.model, method)
            for place, runs in enumerate(AT):
                ((x, y), rect), (true_x, true_y) = found[runs - 1], driven.places[runs - 1]
                inside[method][place] += (
                    abs(true_x - x) <= rect.half_x and abs(true_y - y) <= rect.half_y
                )
            last = found[-1][1]
            widths[method] += (
                math.sqrt(last.half_x * last.half_y)
                if case.walls
                else (last.half_x + last.half_y) / 2
            )
    return {method: Count(tuple(inside[method]), widths[method]) for method in methods}


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
            for method in case.shares:
                _print_row(*_row(case, method, [one[method] for one in counted]))


def _row(case: Case, method: Method, counts: Sequence[Count]) -> Iterator[str]:
    tracks = PORTION * len(counts)
    yield case.name
    yield method
    yield " ".join(
        f"{sum(inside) / tracks:.3f}"
        for inside in zip(*(one.inside for one in counts), strict=True)
    )
    yield " ".join(f"{share:.3f}" for share in case.shares.get(method, ())) or "–"
    yield f"{sum(one.half_widths for one in counts) / tracks:.2f} m"
    yield f"{case.half_width[method]} m" if method in case.half_width else "–"


def _print_row(*columns: str) -> None:
    sys.stdout.write(f"| {' | '.join(columns)} |\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
