"""The numbers that logs, models and settings may hold: each bound stands here, and nowhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

LARGEST = 1e6
"""No coordinate, angle, error or parameter lies beyond this."""

LARGEST_TIME = 1e12
"""No time lies beyond this [s]: differences of two are finite."""

LARGEST_SEQ = 2**53 - 1
"""No seq lies beyond this: a double holds it exactly."""

LARGEST_COUNT = 10**15 - 1
"""No whole number of a setting lies beyond this."""


@dataclass(frozen=True, slots=True)
class Range:
    """The numbers from ``least`` to ``most``; ``expected`` says it in a message.

    least, most : are among them, but for ``least`` if it ``is_open``.
    """

    expected: str
    least: float = -LARGEST
    most: float = LARGEST
    is_open: bool = False

    def __contains__(self, value: float) -> bool:
        """Whether a number is among them; NaN never is."""
        above = self.least < value if self.is_open else self.least <= value
        return above and value <= self.most

    def expected_for(self, value: float) -> str:
        """Return what was expected in place of a number that is not among them."""
        return self.expected if abs(value) <= self.most or self.most != LARGEST else WITHIN.expected


WITHIN = Range("a number within ±1e6")
NOT_NEGATIVE = Range("a number >= 0", least=0)
POSITIVE = Range("a number > 0", least=0, is_open=True)
HALF_WIDTH = Range("a half-width >= 0", least=0)
TIME = Range("a number within ±1e12", -LARGEST_TIME, LARGEST_TIME)
SEQ = Range("0 to 2^53 - 1", 0, LARGEST_SEQ)
WHOLE = Range("a whole number", -LARGEST_COUNT, LARGEST_COUNT)
PROBABILITY = Range("a number between 0 and 1", 0, math.nextafter(1, 0), is_open=True)


def at_least(least: float) -> Range:
    """Return the numbers from ``least`` on."""
    return Range(f"a number >= {least:g}", least)


def between(least: float, most: float) -> Range:
    """Return the numbers from one to another, both among them."""
    return Range(f"a number, {least:g} to {most:g}", least, most)


def whole(least: int, most: int = LARGEST_COUNT) -> Range:
    """Return the whole numbers from one to another, both among them."""
    upto = "" if most == LARGEST_COUNT else f", at most {most}"
    return Range(f"a whole number >= {least}{upto}", least, most)


Number: TypeAlias = Annotated[float, WITHIN]
NotNegative: TypeAlias = Annotated[float, NOT_NEGATIVE]
Positive: TypeAlias = Annotated[float, POSITIVE]
Share: TypeAlias = Annotated[float, between(0, 1)]
Count: TypeAlias = Annotated[int, whole(1)]
"""Fields of dataclasses that settings, missions and mappings fill (``settings.binder``)."""
