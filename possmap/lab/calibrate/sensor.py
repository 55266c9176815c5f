"""What known walls say: how wrong the range sensor is, and how well robots line up."""

from __future__ import annotations

import math

from possmap.lab.calibrate.estimates import ParameterEstimate
from possmap.lab.calibrate.factor import limit_factor, rectangle_factor
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.reml import CONFIDENCE
from possmap.lab.calibrate.trials import Floats
from possmap.lab.evaluate.frame import distances

FARTHEST_M = 0.3
"""What is seen farther from every wall is of something else."""

ROUNDED_DEG = 0.02
"""Logs and truths are written to 0.01°: less is nothing."""


def sensor(ends: Floats, walls: Floats) -> ParameterEstimate | None:
    """Return the sensor's half-width: of ends of walls seen, (m, 2), laid at the true poses [m]."""
    apart = distances(ends, walls)
    return half_width(apart[apart <= FARTHEST_M])


def alignment(off: Floats) -> ParameterEstimate | None:
    """Return the half-width of headings along followed walls: true less logged [deg], shape (n,).

    What is rounding of the files counts as nothing.
    """
    found = half_width(off)
    if found is not None and found.value < ROUNDED_DEG:
        return ParameterEstimate(0.0, 0.0, found.high, 0.0, found.trials)
    return found


def half_width(errors: Floats) -> ParameterEstimate | None:
    """Return the half-width of errors about 0, with limits by chi-square; None for too few."""
    from scipy import stats

    count = len(errors)
    if count < LEAST:
        return None
    deviation = math.sqrt(float((errors**2).mean()))
    value = limit_factor() * deviation
    low, high = stats.chi2.ppf([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2], count)
    return ParameterEstimate(
        value, value * math.sqrt(count / low), value * math.sqrt(count / high),
        rectangle_factor(count) * deviation, count,
    )  # fmt: skip
