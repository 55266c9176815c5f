"""How many standard deviations hold 95 % of new runs, if the deviation itself comes from trials."""

from __future__ import annotations

import math

JOINT = 0.95
PER_AXIS = math.sqrt(JOINT)
"""Two independent axes hold 95 % together if each holds so much (METHOD §6: "joint")."""


def rectangle_factor(trials: int) -> float:
    """Return half-width over standard deviation for a *new* run of a rectangle from ``trials``.

    Mean and deviation of each axis come from the same trials, so a new run less the mean is
    ``sqrt(1 + 1/n)`` deviations wide and follows Student's t with n - 1 degrees of freedom: 2.487
    for 20 trials, and 2.236 only for endlessly many.

    Raises
    ------
    ValueError
        For fewer than two trials.
    """
    from scipy import stats

    if trials < 2:
        raise ValueError(f"trials, found {trials}, expected at least 2")
    quantile = float(stats.t.ppf((1 + PER_AXIS) / 2, trials - 1))
    return quantile * math.sqrt(1 + 1 / trials)


def limit_factor() -> float:
    """Return the factor of endlessly many trials, 2.236."""
    from scipy import stats

    return float(stats.norm.ppf((1 + PER_AXIS) / 2))
