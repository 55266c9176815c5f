"""Which numbers a field may hold, said beside its type: ``along: NotNegative = 0.01``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

LARGEST = 1e6
"""No parameter, coordinate or error may lie beyond this (the log format's bound)."""
LARGEST_COUNT = 10**15 - 1


@dataclass(frozen=True, slots=True)
class Bounds:
    """A range of numbers.

    least, most : the ends, which belong to it.
    above, below : ends that do not.
    """

    least: float = -LARGEST
    most: float = LARGEST
    above: float = -math.inf
    below: float = math.inf

    def fault(self, value: float) -> str | None:
        """Return what was expected instead of a number; None if it lies within."""
        if self.least <= value <= self.most and self.above < value < self.below:
            return None
        # Phrased so that NaN is refused too.
        beyond = self.most == LARGEST and not -LARGEST <= value <= LARGEST
        return Bounds().expected("a number") if beyond else self.expected("a number")

    def expected(self, what: str) -> str:
        """Return what to tell whoever gave another value: ``expected a number > 0``."""
        if self.above > -math.inf and self.below < math.inf:
            return f"expected {what} between {self.above:g} and {self.below:g}"
        if self.above > -math.inf:
            return f"expected {what} > {self.above:g}"
        if self.least == -self.most:
            return f"expected {what} within ±{_short(self.most)}"
        if self.most in (LARGEST, LARGEST_COUNT):
            return f"expected {what} >= {_short(self.least)}"
        return f"expected {what}, {self.least:g} to {self.most:g}"


def _short(value: float) -> str:
    """Return a number as people write it: 1e6, not 1e+06."""
    return f"{value:g}".replace("e+0", "e").replace("e-0", "e-")


Number: TypeAlias = Annotated[float, Bounds()]
NotNegative: TypeAlias = Annotated[float, Bounds(least=0)]
Positive: TypeAlias = Annotated[float, Bounds(above=0)]
Probability: TypeAlias = Annotated[float, Bounds(0, 1)]
Count: TypeAlias = Annotated[int, Bounds(1, LARGEST_COUNT)]
