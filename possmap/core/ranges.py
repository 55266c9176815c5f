"""The numbers that logs, models and settings may hold: each bound stands here, and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

LARGEST = 1e6
"""No coordinate, angle, error or parameter lies beyond this."""

LARGEST_TIME = 1e12
"""No time lies beyond this [s]: differences of two are finite."""

LARGEST_SEQ = 2**53 - 1
"""No seq lies beyond this: a double holds it exactly."""


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
