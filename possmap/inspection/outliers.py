"""How far a value stands out from others that should be like it (docs/audit.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from possmap.core.pyramid import Floats

FEWEST = 5
"""So many values are needed to say how far values spread."""

LEAST_SPREAD = 0.02
"""No spread is taken for smaller: where nobody contradicts anybody, a trifle would stand out."""

_NORMAL = 1.4826
"""What makes a median absolute deviation a standard deviation, for a normal distribution."""


class Others:
    """Values that belong to somebody, of which any one's own can be left out.

    They are sorted once, not for everybody again: a hostile site has thousands of robots.
    """

    def __init__(self, values: Sequence[float], owners: Sequence[str]) -> None:
        self._sorted = np.sort(np.array(values, dtype=np.float64))
        own: dict[str, list[float]] = {}
        for value, owner in zip(values, owners, strict=True):
            own.setdefault(owner, []).append(value)
        self._own = {owner: np.sort(np.array(some)) for owner, some in own.items()}
        self._apart: dict[float, Floats] = {}

    def owners_without(self, owner: str) -> int:
        """Return how many others own values."""
        return len(self._own) - (owner in self._own)

    def median_without(self, owner: str) -> float | None:
        """Return the median of the others' values; None if there are fewer than two.

        Of two values, neither stands out.
        """
        own = self._own_of(owner)
        return _median_without(self._sorted, own) if len(self._sorted) - len(own) >= 2 else None

    def spread_without(self, owner: str) -> float | None:
        """Return the robust standard deviation of the others' values; None below FEWEST."""
        own = self._own_of(owner)
        if len(self._sorted) - len(own) < FEWEST:
            return None
        median = _median_without(self._sorted, own)
        # Without this one or that one, the median is one of few values.
        if median not in self._apart:
            self._apart[median] = np.sort(np.abs(self._sorted - median))
        apart = _median_without(self._apart[median], np.sort(np.abs(own - median)))
        return max(LEAST_SPREAD, _NORMAL * apart)

    def _own_of(self, owner: str) -> Floats:
        return self._own.get(owner, np.empty(0))


def _median_without(values: Floats, left_out: Floats) -> float:
    """Return the median of sorted values, of which some, sorted too, are left out."""
    ties = np.arange(len(left_out)) - np.searchsorted(left_out, left_out)
    places = np.searchsorted(values, left_out) + ties
    count = len(values) - len(left_out)
    middle = np.array([(count - 1) // 2, count // 2])
    # Of those left out, so many stand before the n-th of the rest.
    before = np.searchsorted(places - np.arange(len(places)), middle, side="right")
    return float(values[middle + before].mean())


def above(value: float, median: float | None, unit: float | None) -> float | None:
    """Return how far a value lies above a median, in units; None without either."""
    return None if median is None or unit is None else (value - median) / unit
