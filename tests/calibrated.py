"""Helpers of the calibration's tests: robots whose faults are known, and their trials."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from possmap.core.model import ErrorModel
from possmap.core.settings import Estimator
from possmap.lab.calibrate import held_out
from possmap.lab.calibrate.trials import Trial

FACTOR = 2.2365
"""Standard deviations in a half-width of the truth."""

PAPER = ((3.048, 0.0), (6.096, 0.0), (3.048, 45.0), (3.048, -45.0))
"""The paper's §3: 10 and 20 feet straight, and 10 feet after a turn to either side."""

SPINS = ((0.0, 90.0), (0.0, -90.0), (0.0, 180.0), (0.0, -180.0))


@dataclass(frozen=True, kw_only=True)
class Faults:
    """A robot as METHOD §1 describes it; half-widths are FACTOR standard deviations."""

    along: float = 1.25 / 120
    across: float = 5.5 / 120
    turn_bias: float = 2.0
    turn_gain: float = 0.01
    turn_spread: float = 0.0
    turn_noise: float = 0.7
    drift: float = 0.5
    drift_spread: float = 0.0
    scale: float = 1.01


def trials(
    faults: Faults,
    rng: np.random.Generator,
    times: int = 20,
    plan: tuple[tuple[float, float], ...] = PAPER,
    *,
    robot: str = "r1",
    outings: bool = False,
    heading: bool = True,
) -> list[Trial]:
    """Return so many trials of each kind; with ``outings`` those of one round are one outing."""
    return list(_trials(faults, rng, times, plan, robot, outings, heading))


def _trials(
    faults: Faults,
    rng: np.random.Generator,
    times: int,
    plan: tuple[tuple[float, float], ...],
    robot: str,
    outings: bool,
    heading: bool,
) -> Iterator[Trial]:
    for time in range(times):
        common = rng.standard_normal(2) / FACTOR
        for number, (distance, turn) in enumerate(plan):
            own = common if outings else rng.standard_normal(2) / FACTOR
            stretch, kick, noise = rng.standard_normal(3) / FACTOR
            parts = abs(turn) / 45
            over = (faults.turn_bias + faults.turn_spread * own[0]) * parts
            over += faults.turn_gain * turn + faults.turn_noise * math.sqrt(parts) * noise
            drift = faults.drift + faults.drift_spread * own[1]
            off = over + (math.degrees(faults.across) * kick if distance else 0.0)
            half = math.radians(drift * distance / 2)
            length = distance * faults.scale * (1 + faults.along * stretch)
            length *= math.sin(half) / half if half else 1.0
            way = math.radians(off) + half
            yield Trial(
                robot,
                f"{time}" if outings else f"{time}-{number}",
                distance,
                turn,
                length * math.cos(way) - distance,
                length * math.sin(way),
                off + drift * distance if heading or not distance else math.nan,
                place=f"{robot}.csv:{2 + time * len(plan) + number}",
            )


def hold(some: list[Trial], model: ErrorModel, estimator: Estimator) -> held_out.HeldTrials:
    """Hold trials against one model."""
    return held_out.hold(some, [(None, model)], estimator)
