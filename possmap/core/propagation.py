"""How far off the robot may be along its track: what all estimators share (METHOD §1).

The estimators of ``core/linear.py`` and ``core/heading.py`` are kinds of ``CarriedError``: a value
that tells its rectangle and carries itself along a track that is corrected already. That of
``core/walls.py`` corrects the track itself. By name they are in ``core/estimators.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel

RIGHT_ANGLE = math.pi / 2
"""No heading's half-width is larger [rad]."""


class ErrorRectangle(NamedTuple):
    """Where the robot may really be: a world-aligned box centred on its corrected place.

    half_x, half_y : half-widths [m], both >= 0.
    """

    half_x: float
    half_y: float

    def towards(self, other: ErrorRectangle, share: float) -> ErrorRectangle:
        """Return the rectangle at ``share`` of the way to ``other``, linearly (METHOD §2)."""
        return ErrorRectangle(
            self.half_x + share * (other.half_x - self.half_x),
            self.half_y + share * (other.half_y - self.half_y),
        )

    def grown(self, by_x: float, by_y: float) -> ErrorRectangle:
        """Return the rectangle with its half-widths increased [m]."""
        return ErrorRectangle(self.half_x + by_x, self.half_y + by_y)


class PoseError(Protocol):
    """What may be wrong with a pose."""

    @property
    def rectangle(self) -> ErrorRectangle:
        """Around the corrected place."""

    @property
    def heading_half(self) -> float:
        """Half-width H of the heading [rad], at most a right angle."""


class FilteredError(NamedTuple):
    """The same as a value, of an estimator that corrects the track itself."""

    rectangle: ErrorRectangle
    heading_half: float


class CarriedError(PoseError, Protocol):
    """The same as one estimator carries it along the track; a step returns a new value."""

    def after_run(self, run: CorrectedStretch, model: ErrorModel) -> CarriedError:
        """Carry it along a run in free space, or past walls that were only seen."""

    def after_following(self, run: CorrectedStretch, model: ErrorModel) -> CarriedError:
        """Carry it along a followed wall, with which the robot has lined up."""

    def after_turn(self, turn_deg: float, model: ErrorModel) -> CarriedError:
        """Carry it through a turn, which is not 0 [deg]."""


class StretchErrors(NamedTuple):
    """The errors along one stretch, before the turn that ends it.

    start, end : rectangles; between them the rectangle is taken linearly.
    heading_half : H at the end of the run [rad]; at standstill that of the place.
    after : the pose error after the turn.
    """

    start: ErrorRectangle
    end: ErrorRectangle
    heading_half: float
    after: PoseError


def after_stretch(
    before: CarriedError, stretch: CorrectedStretch, model: ErrorModel
) -> tuple[CarriedError, StretchErrors]:
    """Carry a pose's error along one stretch: first the run, then the turn that ends it."""
    logged, at_end = stretch.logged, before
    if logged.is_followed:
        at_end = before.after_following(stretch, model)
    elif logged.is_run:
        at_end = before.after_run(stretch, model)
    after = at_end.after_turn(logged.turn_deg, model) if logged.turn_deg else at_end
    return after, StretchErrors(before.rectangle, at_end.rectangle, at_end.heading_half, after)


def propagate(
    start: CarriedError, track: Iterable[CorrectedStretch], model: ErrorModel
) -> list[StretchErrors]:
    """Carry the first pose's error along the corrected track, stretch by stretch."""
    errors: list[StretchErrors] = []
    now = start
    for stretch in track:
        now, found = after_stretch(now, stretch, model)
        errors.append(found)
    return errors
