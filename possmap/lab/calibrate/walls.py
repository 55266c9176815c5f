"""What known walls say: how wrong the range sensor is, and how well robots line up."""

from __future__ import annotations

import math

import numpy as np

from possmap.lab.calibrate.factor import limit_factor, rectangle_factor
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.reml import CONFIDENCE
from possmap.lab.calibrate.results import Estimate
from possmap.lab.calibrate.trials import Floats

FARTHEST_M = 0.3
"""What is seen farther from every wall is of something else."""

ROUNDED_DEG = 0.02
"""Logs and truths are written to 0.01°: less is nothing."""

_AT_ONCE = 2_000_000


def distances(points: Floats, walls: Floats) -> Floats:
    """Return how far points, shape (m, 2), lie from the nearest wall, shape (w, 4) [m]; (m,)."""
    found = np.full(len(points), np.inf)
    step = max(1, _AT_ONCE // max(1, len(walls)))
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    square = np.maximum((along**2).sum(axis=1), 1e-18)
    for k in range(0, len(points), step):
        off = points[k : k + step, None, :] - start[None]
        share = np.clip((off * along).sum(axis=2) / square, 0.0, 1.0)
        apart = np.hypot(*np.moveaxis(off - share[:, :, None] * along, 2, 0))
        found[k : k + step] = apart.min(axis=1, initial=np.inf)
    return found


def sensor(ends: Floats, walls: Floats) -> Estimate | None:
    """Return the sensor's half-width: of ends of walls seen, laid at the true poses [m].

    ends : shape (m, 2).
    """
    apart = distances(ends, walls)
    return half_width(apart[apart <= FARTHEST_M])


def alignment(off: Floats) -> Estimate | None:
    """Return the half-width of headings along followed walls: true less logged [deg], shape (n,).

    What is rounding of the files counts as nothing.
    """
    found = half_width(off)
    if found is not None and found.value < ROUNDED_DEG:
        return Estimate(0.0, 0.0, found.high, 0.0, found.trials)
    return found


def half_width(errors: Floats) -> Estimate | None:
    """Return the half-width of errors about 0, with limits by chi-square; None for too few."""
    from scipy import stats

    count = len(errors)
    if count < LEAST:
        return None
    deviation = math.sqrt(float((errors**2).mean()))
    value = limit_factor() * deviation
    low, high = stats.chi2.ppf([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2], count)
    return Estimate(
        value, value * math.sqrt(count / low), value * math.sqrt(count / high),
        rectangle_factor(count) * deviation, count,
    )  # fmt: skip
