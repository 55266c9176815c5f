"""How far off the robot may be: error rectangles along the track (METHOD §1; the paper's §3.1).

This is the estimator ``linear``, the paper's: half-widths never shrink, and a heading error shows
as growth of the rectangle during each run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.records import Pose

RIGHT_ANGLE = math.pi / 2


@dataclass(frozen=True, slots=True)
class ErrorRectangle:
    """Where the robot may really be: a world-aligned box centred on its corrected place.

    half_x, half_y : half-widths [m], both >= 0.
    """

    half_x: float
    half_y: float

    def __post_init__(self) -> None:
        if not (self.half_x >= 0 and self.half_y >= 0):  # phrased so that NaN is refused too
            raise ValueError(f"half-widths must be >= 0 m, got {self.half_x}, {self.half_y}")

    def towards(self, other: ErrorRectangle, share: float) -> ErrorRectangle:
        """Return the rectangle at ``share`` of the way to ``other``, linearly (METHOD §2)."""
        return ErrorRectangle(
            self.half_x + share * (other.half_x - self.half_x),
            self.half_y + share * (other.half_y - self.half_y),
        )

    def grown(self, by_x: float, by_y: float) -> ErrorRectangle:
        """Return the rectangle with its half-widths increased [m]."""
        return ErrorRectangle(self.half_x + by_x, self.half_y + by_y)


@dataclass(frozen=True, slots=True)
class PoseError:
    """What may be wrong with a pose.

    Attributes
    ----------
    rectangle
        Around the corrected place.
    heading_half
        Half-width H of the heading [rad], at most a right angle.
    run_heading_half, run_length
        H at the start of the run so far [rad], and how long that run is [m]: runs that follow no
        wall, with no turn between them, count as one.
    """

    rectangle: ErrorRectangle
    heading_half: float
    run_heading_half: float = 0.0
    run_length: float = 0.0


@dataclass(frozen=True, slots=True)
class StretchErrors:
    """The errors along one stretch, before the turn that ends it.

    start, end : rectangles; between them the rectangle is taken linearly.
    heading_half : H at the end of the run [rad]; at standstill that of the place.
    after : the pose error after the turn.
    """

    start: ErrorRectangle
    end: ErrorRectangle
    heading_half: float
    after: PoseError


def at_start(pose: Pose) -> PoseError:
    """Return the first pose's own error, zero unless the log says otherwise."""
    heading_half = min(RIGHT_ANGLE, math.radians(pose.error_heading_deg))
    return PoseError(ErrorRectangle(pose.error_x, pose.error_y), heading_half)


def after_run(error: PoseError, run: CorrectedStretch, model: ErrorModel) -> PoseError:
    """Grow ``error`` by a run in free space, or past walls that were only seen (METHOD §1)."""
    spread = math.radians(model.drift_spread)
    so_far = error.run_length
    first_half = error.run_heading_half if so_far else error.heading_half

    def gained(distance: float) -> tuple[float, float]:
        half = min(RIGHT_ANGLE, first_half + spread * distance / 2)
        return (
            model.along * distance + distance * (1 - math.cos(half)),
            model.across * distance + distance * math.sin(half),
        )

    along, across = gained(so_far + run.length)
    if so_far:
        along_before, across_before = gained(so_far)
        # Both terms grow with distance; rounding must not make a half-width shrink.
        along, across = max(0.0, along - along_before), max(0.0, across - across_before)
    cos, sin = abs(run.along[0]), abs(run.along[1])
    return PoseError(
        error.rectangle.grown(cos * along + sin * across, sin * along + cos * across),
        min(RIGHT_ANGLE, first_half + spread * (so_far + run.length)),
        first_half,
        # Without a spread of the drift growth is linear, and a run needs no memory.
        so_far + run.length if spread else 0.0,
    )


def after_following(error: PoseError, run: CorrectedStretch, model: ErrorModel) -> PoseError:
    """Grow ``error`` by a run along a followed wall: only along it; the heading is the wall's."""
    along = model.along * run.length
    return PoseError(
        error.rectangle.grown(abs(run.along[0]) * along, abs(run.along[1]) * along),
        min(RIGHT_ANGLE, math.radians(model.alignment_spread)),
    )


def after_turn(error: PoseError, turn_deg: float, model: ErrorModel) -> PoseError:
    """Grow the heading's half-width by a turn; a turn ends the run so far."""
    if turn_deg == 0:
        return error
    gained = math.radians(model.turn_spread * abs(turn_deg) / 45)
    return replace(
        error, heading_half=min(RIGHT_ANGLE, error.heading_half + gained), run_length=0.0
    )


def after_stretch(before: PoseError, stretch: CorrectedStretch, model: ErrorModel) -> StretchErrors:
    """Carry a pose's error along one stretch, and through the turn that ends it."""
    at_end = before
    if stretch.logged.is_followed:
        at_end = after_following(before, stretch, model)
    elif stretch.logged.is_run:
        at_end = after_run(before, stretch, model)
    after = after_turn(at_end, stretch.logged.turn_deg, model)
    return StretchErrors(before.rectangle, at_end.rectangle, at_end.heading_half, after)


def propagate(
    first: Pose, track: Iterable[CorrectedStretch], model: ErrorModel
) -> list[StretchErrors]:
    """Carry the first pose's error along the corrected track, stretch by stretch."""
    errors: list[StretchErrors] = []
    now = at_start(first)
    for stretch in track:
        errors.append(after_stretch(now, stretch, model))
        now = errors[-1].after
    return errors
