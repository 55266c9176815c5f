"""All robots: each by itself, and together as one that stands for a robot not yet known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.results import Calibration, RobotResult
from possmap.lab.calibrate.robot import Unusable, calibrate_robot
from possmap.lab.calibrate.trials import Trial

APART = 4.0
"""Standard errors between two robots' known parts from which they are called different."""


def calibrate(
    trials: Sequence[Trial],
    rng: np.random.Generator,
    notes: Sequence[str] = (),
    pool: bool = True,
) -> Calibration:
    """Calibrate each robot of some trials, and all together if they may be pooled.

    Pooled, each robot counts as an outing of one robot: so spreads hold what differs from robot to
    robot.
    """
    by_robot: dict[str, list[Trial]] = {}
    for trial in trials:
        by_robot.setdefault(trial.robot, []).append(trial)
    found: list[RobotResult] = []
    refused: dict[str, str] = {}
    for robot, own in sorted(by_robot.items()):
        try:
            found.append(calibrate_robot(robot, own, rng))
        except Unusable as reason:
            refused[robot] = str(reason)
    pooled = None
    if pool and len(found) > 1:
        together = [replace(one, outing=robot.robot) for robot in found for one in robot.trials]
        try:
            pooled = calibrate_robot("", together, rng, fleet=True)
        except Unusable as reason:
            notes = (*notes, f"all together: {reason}")
    if pooled is not None:
        words = list(_differences(found))
        if len(found) < LEAST:
            words.append(
                f"{len(found)} robots say little of how robots differ: the pooled spreads are wide "
                "to match"
            )
        pooled = replace(pooled, notes=(*pooled.notes, *words))
    return Calibration(tuple(found), pooled, refused, tuple(notes))


def _differences(robots: Sequence[RobotResult]) -> Iterator[str]:
    """Yield which known parts differ between robots beyond what their trials leave open."""
    for name in ("turn_bias", "turn_gain", "drift", "scale"):
        known: Mapping[str, tuple[float, float]] = {
            one.robot: (found.value, (found.high - found.low) / 3.92)
            for one in robots
            if (found := one.estimates.get(name)) is not None
        }
        if len(known) < 2:
            continue
        least = min(known, key=lambda robot: known[robot][0])
        most = max(known, key=lambda robot: known[robot][0])
        gap = known[most][0] - known[least][0]
        error = math.hypot(known[most][1], known[least][1])
        if error > 0 and gap > APART * error:
            yield (
                f"robots differ in {name}: {least} {known[least][0]:.3g}, {most} "
                f"{known[most][0]:.3g}; their own models are better than the pooled one"
            )
