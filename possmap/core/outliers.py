"""How far a value stands out from others that should be like it (docs/audit.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FEWEST = 5
"""So many values are needed to say how far values spread."""

LEAST_SPREAD = 0.02
"""No spread is taken for smaller: where nobody contradicts anybody, a trifle would stand out."""

_NORMAL = 1.4826
"""What makes a median absolute deviation a standard deviation, for a normal distribution."""


def spread(values: Sequence[float]) -> float | None:
    """Return the robust standard deviation of values; None if they are fewer than FEWEST."""
    if len(values) < FEWEST:
        return None
    apart = np.abs(np.array(values) - np.median(values))
    return max(LEAST_SPREAD, _NORMAL * float(np.median(apart)))


def above(value: float, others: Sequence[float], unit: float | None) -> float | None:
    """Return how far a value lies above the median of others, in units; None without a unit.

    None also where there are fewer than two others: of two values, neither stands out.
    """
    if unit is None or len(others) < 2:
        return None
    return float(value - np.median(others)) / unit
