"""Trials and legs held against rectangles: laid out as logs, and carried by the host's own code."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Pose
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.core.track import stretches
from possmap.lab.calibrate.cutting import TrueTrack
from possmap.lab.calibrate.trials import Floats, Trial

WRAPPED_DEG = 170.0
"""A larger turn is laid out in parts, since of a half turn a log does not tell the side."""

Errors = tuple[float, float, float]
"""Half-widths of where a leg begins: x, y [m], heading [deg]."""


@dataclass(frozen=True, eq=False)
class HeldTrials:
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


def hold(trials: Sequence[Trial], model: ErrorModel, estimator: Estimator) -> HeldTrials:
    """Hold trials against the rectangles that a model gives their ends."""
    rows = [_held_trial(trial, model, estimator) for trial in trials]
    both = np.array(rows, dtype=np.float64).reshape(-1, 2, 3)
    return HeldTrials(both[:, 0], both[:, 1])


def _held_trial(trial: Trial, model: ErrorModel, estimator: Estimator) -> tuple[Errors, Errors]:
    """Return errors left and half-widths of one trial; poses begin turned away, and end ahead."""
    parts = math.ceil(abs(trial.turn) / 120) if abs(trial.turn) > WRAPPED_DEG else 1
    poses = [Pose(k, None, 0.0, 0.0, trial.turn * (k / parts - 1)) for k in range(parts + 1)]
    bend = 0.0
    if trial.distance > 0:
        bend = trial.bend
        poses.append(Pose(len(poses), None, trial.distance, 0.0, bend))
    found = estimate(poses[0], stretches(poses), model, EvidenceSettings(estimator=estimator))
    end, last = found.stretches[-1], found.errors[-1]
    nan = math.nan
    off_x = off_y = half_x = half_y = off = half = nan
    if trial.is_run:
        off_x, off_y = trial.distance + trial.along - end.end[0], trial.across - end.end[1]
        half_x, half_y = last.end.half_x, last.end.half_y
    if not math.isnan(trial.heading):
        off, half = bend + trial.heading - end.heading_deg, math.degrees(last.after.heading_half)
    return (off_x, off_y, off), (half_x, half_y, half)


@dataclass(frozen=True, slots=True)
class LegScore:
    """How rectangles fare on whole legs of a track that the model has not seen.

    Attributes
    ----------
    length
        Of a leg [m].
    legs, poses
        How many.
    coverage, end_coverage
        Share of the poses, and of the legs' ends, inside their rectangles.
    half_width
        Mean of (hx + hy)/2 at the ends [m].
    """

    length: float
    estimator: Estimator
    legs: int
    poses: int
    coverage: float
    end_coverage: float
    half_width: float


def held_legs(
    judged: Sequence[tuple[TrueTrack, ErrorModel]],
    estimator: Estimator,
    length: float,
    start: Errors = (0.0, 0.0, 0.0),
    mount: float = 0.0,
) -> LegScore | None:
    """Hold legs of so many metres against the rectangles of models that have not seen them.

    None if no track is so long.

    Parameters
    ----------
    judged
        Tracks, each with its model.
    start
        How wrong the truth itself may be where a leg begins.
    mount
        Angle between the truth's heading and the way driven [deg].
    """
    held = [
        _held_leg(leg, model, estimator, start, mount)
        for track, model in judged
        for leg in _legs(track, length)
    ]
    if not held:
        return None
    every = np.concatenate([inside for inside, _ in held])
    return LegScore(
        length, estimator, len(held), len(every), float(every.mean()),
        float(np.mean([inside[-1] for inside, _ in held])),
        float(np.mean([half for _, half in held])),
    )  # fmt: skip


def _legs(track: TrueTrack, length: float) -> Iterator[TrueTrack]:
    """Yield whole legs, one after the other; what is left at the end is none."""
    way, start = track.way, 0
    while (stop := int(np.searchsorted(way, way[start] + length))) < len(way):
        yield track.part(start, stop + 1)
        start = stop


def _held_leg(
    leg: TrueTrack, model: ErrorModel, estimator: Estimator, start: Errors, mount: float
) -> tuple[Floats, float]:
    """Return which poses lie in their rectangles (the first is known), and the last half-width."""
    turn = leg.true[0, 2] + mount - leg.logged[0, 2]
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    (dx, dy), (x0, y0) = (leg.logged[:, :2] - leg.logged[0, :2]).T, leg.true[0, :2]
    rows = np.column_stack([x0 + cos * dx - sin * dy, y0 + sin * dx + cos * dy,
                            leg.logged[:, 2] + turn]).tolist()  # fmt: skip
    poses = [Pose(k, None, *row, *(start if k == 0 else ())) for k, row in enumerate(rows)]
    found = estimate(poses[0], stretches(poses), model, EvidenceSettings(estimator=estimator))
    off = np.abs(leg.true[1:, :2] - np.array([one.end for one in found.stretches]))
    half = np.array([(one.end.half_x, one.end.half_y) for one in found.errors])
    return (off <= half + 1e-9).all(axis=1).astype(np.float64), float(half[-1].mean())
