"""The estimator ``linear``, the paper's (METHOD §1, Propagation; the paper's §3.1).

Half-widths add up run by run and never shrink; a heading error shows as growth of the rectangle
during each run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle
from possmap.core.records import Pose


class LinearError(NamedTuple):
    """What may be wrong with a pose: two half-widths and one of the heading.

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

    @classmethod
    def at_start(cls, pose: Pose) -> LinearError:
        """Return the first pose's own error, zero unless the log says otherwise."""
        heading_half = min(RIGHT_ANGLE, math.radians(pose.error_heading_deg))
        return cls(ErrorRectangle(pose.error_x, pose.error_y), heading_half)

    def after_run(self, run: CorrectedStretch, model: ErrorModel) -> LinearError:
        """Grow by a run in free space, or past walls that were only seen."""
        spread = math.radians(model.drift_spread)
        so_far = self.run_length
        first_half = self.run_heading_half if so_far else self.heading_half
        whole = so_far + run.length
        along, across = _gained(whole, first_half, spread, model)
        if so_far:
            along_before, across_before = _gained(so_far, first_half, spread, model)
            # Both terms grow with distance; rounding must not make a half-width shrink.
            along, across = max(0.0, along - along_before), max(0.0, across - across_before)
        cos, sin = abs(run.along[0]), abs(run.along[1])
        return LinearError(
            self.rectangle.grown(cos * along + sin * across, sin * along + cos * across),
            min(RIGHT_ANGLE, first_half + spread * whole),
            first_half,
            # Without a spread of the drift growth is linear, and a run needs no memory.
            whole if spread else 0.0,
        )

    def after_following(self, run: CorrectedStretch, model: ErrorModel) -> LinearError:
        """Grow by a run along a followed wall: only along it; the heading is the wall's."""
        along = model.along * run.length
        return LinearError(
            self.rectangle.grown(abs(run.along[0]) * along, abs(run.along[1]) * along),
            min(RIGHT_ANGLE, math.radians(model.alignment_spread)),
        )

    def after_turn(self, turn_deg: float, model: ErrorModel) -> LinearError:
        """Grow the heading's half-width by a turn; a turn ends the run so far."""
        gained = math.radians(model.turn_spread * abs(turn_deg) / 45)
        heading_half = min(RIGHT_ANGLE, self.heading_half + gained)
        return LinearError(self.rectangle, heading_half, self.run_heading_half, 0.0)


def _gained(
    distance: float, first_half: float, spread: float, model: ErrorModel
) -> tuple[float, float]:
    """Return what a run adds to the half-widths along and across it [m].

    first_half : H at its start [rad]; spread: by what H grows [rad/m].
    """
    half = min(RIGHT_ANGLE, first_half + spread * distance / 2)
    return (
        model.along * distance + distance * (1 - math.cos(half)),
        model.across * distance + distance * math.sin(half),
    )
