"""A Gaussian state carried step by step: mean, covariance, and the steps that smoothing goes back.

The filter of ``core/walls.py`` is made of three kinds of steps: a state takes in shares of others
(F·P·Fᵀ), is forgotten, or is observed. Plain lists, since matrices of NumPy take several times as
long for six rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

Row: TypeAlias = list[float]
Shares: TypeAlias = Sequence[tuple[int, float]]
"""States, and how much of each."""


class Mixed(NamedTuple):
    """F, the identity but for the row of one state, which takes in shares of others."""

    state: int
    shares: Shares


class Reset(NamedTuple):
    """F, the identity but for a zero: a state has nothing to do any more with what it was."""

    state: int


class Observed(NamedTuple):
    """An observation with H = e_state + share·e_other.

    gain, variance, residual : METHOD's K, V and r.
    """

    state: int
    other: int
    share: float
    gain: Row
    variance: float
    residual: float


class Mark(NamedTuple):
    """What the filter knew at a moment that is asked for again, looking back.

    mean : m. rows : those of P that belong to the first three states.
    """

    mean: Row
    rows: list[Row]


Step: TypeAlias = Mixed | Reset | Observed | Mark


class Gaussian:
    """A mean m and a covariance P, changed in place.

    Parameters
    ----------
    mean, half_widths
        At the start, with no covariance between any two.
    keeps_steps
        Whether ``steps`` is filled, for somebody to look back.

    Attributes
    ----------
    mean, covariance
        m and P.
    steps
        What has changed them, and the marks set in between.
    """

    def __init__(self, mean: Row, half_widths: Row, keeps_steps: bool = False) -> None:
        self.mean = mean
        self.covariance: list[Row] = [
            [half**2 if row == column else 0.0 for column in range(len(mean))]
            for row, half in enumerate(half_widths)
        ]
        self.steps: list[Step] = []
        self._keeps_steps = keeps_steps

    def half_width(self, state: int) -> float:
        """Return the root of a variance, which rounding may leave a hair below 0."""
        return math.sqrt(max(0.0, self.covariance[state][state]))

    def forget(self, state: int, variance: float) -> None:
        """Forget what a state was and what it has to do with the others."""
        for row in self.covariance:
            row[state] = 0.0
        self.covariance[state] = [0.0] * len(self.mean)
        self.covariance[state][state] = variance
        if self._keeps_steps:
            self.steps.append(Reset(state))

    def mix(self, state: int, shares: Shares) -> None:
        """Add shares of other states to one, of P alone: F·P·Fᵀ."""
        p = self.covariance
        row = p[state]
        for other, share in shares:
            for column, value in enumerate(p[other]):
                row[column] += share * value
        for each in p:
            each[state] += sum([share * each[other] for other, share in shares])
        if self._keeps_steps:
            self.steps.append(Mixed(state, shares))

    def forecast(self, state: int, other: int, share: float, noise: float) -> tuple[Row, float]:
        """Return P·Hᵀ and V of an observation with H = e_state + share·e_other.

        noise : its own variance, METHOD's R.
        """
        column = [row[state] + share * row[other] for row in self.covariance]
        return column, column[state] + share * column[other] + noise

    def learn(
        self, state: int, other: int, share: float, column: Row, variance: float, residual: float
    ) -> None:
        """Update m and P by an observation, as it was forecast."""
        if not variance > 0:
            return  # both are known without any error: there is nothing to learn
        gains = [gained / variance for gained in column]
        for at, (row, gain) in enumerate(zip(self.covariance, gains, strict=True)):
            self.mean[at] += gain * residual
            for other_at in range(len(row)):
                row[other_at] -= gain * column[other_at]
        if self._keeps_steps:
            self.steps.append(Observed(state, other, share, gains, variance, residual))

    def mark(self) -> None:
        """Remember what is known now."""
        if self._keeps_steps:
            self.steps.append(Mark(self.mean[:], [row[:] for row in self.covariance[:3]]))
