"""A first guess of the error model, by the covariances that odometry publishes of itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.convert.samples import Samples, joined

LEAST_WAY_M = 1.0
"""A shorter way tells nothing of what grows along it [m]."""

LARGEST = 1e3
"""Of a larger variance its publisher knows nothing: 1e6 is the usual way to say so [m^2, rad^2]."""


class Guess:
    """Follows how far a robot drives."""

    def __init__(self) -> None:
        self._way = 0.0
        self._last: Samples | None = None

    def drive(self, samples: Samples) -> None:
        """Take in the next samples."""
        whole = samples if self._last is None else joined([self._last, samples])
        self._way += float(np.hypot(np.diff(whole.x), np.diff(whole.y)).sum())
        self._last = samples.part(-1)

    def words(self, first: Any, last: Any) -> str:
        """Return what the covariances of the first and last message suggest; empty for nothing.

        They grow with the way, or tell nothing: many drivers publish a constant.
        """
        before, after = _variances(first), _variances(last)
        if before is None or after is None or self._way < LEAST_WAY_M:
            return ""
        grown = [b - a for a, b in zip(before, after, strict=True)]
        if not all(0 < one < LARGEST for one in grown):
            return ""
        across, turned = math.sqrt(max(grown[:2])), math.degrees(math.sqrt(grown[2]))
        factor = ErrorModel().factor
        per_metre = factor * across / self._way, factor * turned / self._way
        return (
            f"its covariance grows to {across:.2g} m and {turned:.2g} deg (one sigma) over "
            f"{self._way:.0f} m; a first guess by it, not used: --set along={per_metre[0]:.2g} "
            f"--set across={per_metre[0]:.2g} --set drift_spread={per_metre[1]:.2g}"
        )


def _variances(message: Any) -> list[float] | None:
    """Return the variances of x, y [m^2] and the heading [rad^2]; None where there are none."""
    told = getattr(getattr(message, "pose", None), "covariance", None)
    if told is None or len(told) != 36:
        return None
    return [float(told[index]) for index in (0, 7, 35)]
