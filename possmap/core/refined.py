"""A track as ``possmap refine`` left it: each stretch from one refined pose to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from possmap.core.correction import CorrectedStretch
from possmap.core.propagation import ErrorRectangle, FilteredError, StretchErrors
from possmap.core.track import Stretch


class RefinedPose(NamedTuple):
    """Where a pose was found to have been.

    x, y, half_x, half_y : [m].
    heading_error, heading_half : true minus logged heading after the pose's turn, and H of the run
        that ends there [rad].
    """

    x: float
    y: float
    half_x: float
    half_y: float
    heading_error: float
    heading_half: float

    @property
    def rectangle(self) -> ErrorRectangle:
        """Half-widths around the place."""
        return ErrorRectangle(self.half_x, self.half_y)


RefinedTrack: TypeAlias = Sequence[RefinedPose]
"""One of each pose record of an excursion."""


def lay_refined(
    track: Sequence[Stretch], poses: RefinedTrack
) -> tuple[list[CorrectedStretch], list[StretchErrors]]:
    """Lay each stretch from a refined pose to the next, as METHOD §7 lays smoothed ones.

    Raises
    ------
    ValueError
        If there is not one pose for each end of a stretch.
    """
    if len(poses) != len(track) + 1:
        raise ValueError(f"{len(poses)} refined poses, expected {len(track) + 1}")
    laid, errors = [], []
    for logged, start, end in zip(track, poses, poses[1:], strict=False):
        heading_deg = logged.end.heading_deg + math.degrees(end.heading_error)
        laid.append(
            CorrectedStretch.along_chord(
                logged, start[:2], end[:2], start.heading_error, heading_deg
            )
        )
        after = FilteredError(end.rectangle, end.heading_half)
        errors.append(StretchErrors(start.rectangle, end.rectangle, end.heading_half, after))
    return laid, errors
