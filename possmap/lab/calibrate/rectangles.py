"""Trials held against rectangles: laid out as logs, and carried by the host's own code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Pose
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.core.track import stretches
from possmap.lab.calibrate.trials import Floats, Trial

_AXES = 3

WRAPPED_DEG = 170.0
"""A larger turn is laid out in parts, since of a half turn a log does not tell the side."""


@dataclass(frozen=True, eq=False)
class Held:
    """Errors left, and half-widths, of n trials; NaN where a trial tells nothing.

    error, half : along x, along y [m] and of the heading [deg], shape (n, 3). x is the way the
    trial was asked to run.
    """

    error: Floats
    half: Floats

    @property
    def inside(self) -> Floats:
        """Whether each end lies in its rectangle: 1, 0, NaN without a run; shape (n,)."""
        return self._joint(slice(0, 2))

    @property
    def heading_inside(self) -> Floats:
        """Whether each heading lies within its half-width; shape (n,)."""
        return self._joint(slice(2, 3))

    def _joint(self, which: slice) -> Floats:
        error, half = self.error[:, which], self.half[:, which]
        held: Floats = np.all(np.abs(error) <= half + 1e-9, axis=1).astype(np.float64)
        held[np.isnan(error).any(axis=1)] = np.nan
        return held

    @property
    def size(self) -> Floats:
        """The square root of a rectangle's sides, as a half-width [m]; shape (n,)."""
        found: Floats = np.sqrt(self.half[:, 0] * self.half[:, 1])
        return found


def hold(trials: Sequence[Trial], model: ErrorModel, estimator: Estimator) -> Held:
    """Hold trials against the rectangles that a model gives their ends."""
    rows = [_one(trial, model, estimator) for trial in trials]
    both = np.array(rows, dtype=np.float64).reshape(-1, 2, _AXES)
    return Held(both[:, 0], both[:, 1])


def _one(
    trial: Trial, model: ErrorModel, estimator: Estimator
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return errors left and half-widths of one trial; poses begin turned away, and end ahead."""
    poses = [Pose(0, None, 0.0, 0.0, -trial.turn), Pose(1, None, 0.0, 0.0, 0.0)]
    if abs(trial.turn) > WRAPPED_DEG:
        parts = math.ceil(abs(trial.turn) / 120)
        poses = [Pose(k, None, 0.0, 0.0, trial.turn * (k / parts - 1)) for k in range(parts + 1)]
    if trial.distance > 0:
        poses.append(Pose(len(poses), None, trial.distance, 0.0, trial.bend))
    found = estimate(poses[0], stretches(poses), model, EvidenceSettings(estimator=estimator))
    end, last = found.stretches[-1], found.errors[-1]
    error = [math.nan, math.nan, math.nan]
    half = [math.nan, math.nan, math.nan]
    if trial.is_run:
        error[0] = trial.distance + trial.along - end.end[0]
        error[1] = trial.across - end.end[1]
        half[0], half[1] = last.end.half_x, last.end.half_y
    if not math.isnan(trial.heading):
        bend = trial.bend if trial.distance > 0 else 0.0
        error[2] = bend + trial.heading - end.heading_deg
        half[2] = math.degrees(last.after.heading_half)
    return tuple(error), tuple(half)
