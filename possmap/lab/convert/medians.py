"""Lines by repeated medians: up to half of the points may lie anywhere (Siegel 1982)."""

from __future__ import annotations

import numpy as np

from possmap.lab.convert.samples import Floats

MOST = 1024
"""Through so many points at most, evenly chosen: every one is paired with every other."""


def median(values: Floats) -> Floats:
    """Return the medians along the first axis, of (n, ...) values; quicker than NumPy on few."""
    ordered = np.sort(values, axis=0)
    found: Floats = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return found


def repeated_medians(x: Floats, y: Floats) -> tuple[float, float]:
    """Return slope and height at x = 0 of the line through points.

    The slope is the median, over the points, of the median slope from each to all others. Of
    points that have all one x it is 0.

    Parameters
    ----------
    x, y
        (n,); of more than MOST points some stand for all.
    """
    if len(x) > MOST:
        some = np.linspace(0, len(x) - 1, MOST).round().astype(np.int64)
        x, y = x[some], y[some]
    run, rise = x[:, None] - x, y[:, None] - y
    apart = run != 0
    # Points of one x say nothing of the slope: they go behind all others.
    slopes = np.divide(rise, run, out=np.full(run.shape, np.inf), where=apart)
    slopes.sort(axis=1)
    count = apart.sum(axis=1)
    if not count.any():
        return 0.0, float(median(y))
    row = np.arange(len(x))
    slope = float(median((slopes[row, (count - 1) // 2] + slopes[row, count // 2]) / 2))
    return slope, float(median(y - slope * x))
