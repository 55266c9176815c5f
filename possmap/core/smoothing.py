"""Looking back over an excursion that holds a fix (METHOD §7, Fixes, and looking back).

The backward pass of Bryson and Frazier, modified by Bierman (1973): it needs no inverse of P, so
that variances of zero are fine. Its λ and Λ tell what is still to come; going back over the steps
of the filter, at each mark m - P·λ and P - P·Λ·P are what all observations together say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.correction import CorrectedStretch
from possmap.core.kalman import Mark, Mixed, Observed, Reset, Row, Step
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle, FilteredError, StretchErrors

Floats: TypeAlias = NDArray[np.float64]


class Smoothed(NamedTuple):
    """What is known at a mark, looking back.

    place : corrected [m]. heading : c, true minus logged [rad]; heading_half : its H [rad].
    """

    place: tuple[float, float]
    rectangle: ErrorRectangle
    heading: float
    heading_half: float


def smoothed(steps: Sequence[Step]) -> list[Smoothed]:
    """Return what is known at each mark, in the order of the marks."""
    marks: list[Mark] = []
    lams: list[Row] = []  # λ, and Λ row by row, at each of them
    bigs: list[Row] = []
    size = next(len(one.mean) for one in steps if isinstance(one, Mark))
    lam, big = [0.0] * size, [[0.0] * size for _ in range(size)]
    for step in reversed(steps):
        match step:
            case Mark():
                marks.append(step)
                lams.append(lam[:])
                bigs.append([value for row in big for value in row])
            case Mixed(state, shares):  # λ ← Fᵀλ, Λ ← FᵀΛF
                for other, share in shares:
                    lam[other] += share * lam[state]
                    for row in big:
                        row[other] += share * row[state]
                taken = big[state]
                for other, share in shares:
                    big[other] = [a + share * b for a, b in zip(big[other], taken, strict=True)]
            case Reset(state):
                lam[state], big[state] = 0.0, [0.0] * size
                for row in big:
                    row[state] = 0.0
            case Observed():
                _through(step, lam, big)
    return _looked_back(marks, np.array(lams), np.array(bigs).reshape(-1, size, size))[::-1]


def _through(step: Observed, lam: Row, big: list[Row]) -> None:
    """Go back through an observation: λ ← Aᵀλ - HᵀV⁻¹r, Λ ← AᵀΛA + HᵀV⁻¹H, A = I - K·H."""
    seen = ((step.state, 1.0), (step.other, step.share))  # H
    gain = step.gain
    pulled = sum(k * value for k, value in zip(gain, lam, strict=True))
    for state, share in seen:
        lam[state] -= share * (pulled + step.residual / step.variance)
    u = [sum(k * value for k, value in zip(gain, row, strict=True)) for row in big]  # Λ·K
    s = sum(k * value for k, value in zip(gain, u, strict=True)) + 1 / step.variance
    for state, share in seen:
        for row, value in zip(big, u, strict=True):
            row[state] -= share * value
    for state, share in seen:
        big[state] = [a - share * b for a, b in zip(big[state], u, strict=True)]
        for other, also in seen:
            big[state][other] += share * also * s


def _looked_back(marks: Sequence[Mark], lam: Floats, big: Floats) -> list[Smoothed]:
    """Return m - P·λ, and P - P·Λ·P of the place and the heading, at all marks together.

    lam, big : λ and Λ at each, shapes (marks, 6) and (marks, 6, 6). Sums are taken term by term,
    so that no library decides on their last bit.
    """
    means, p = np.array([one.mean for one in marks]), np.array([one.rows for one in marks])
    states, halves = range(lam.shape[1]), []
    for state in range(p.shape[1]):
        row = p[:, state].T
        means[:, state] -= sum(row[k] * lam[:, k] for k in states)
        taken = sum(row[k] * sum(row[i] * big[:, k, i] for i in states) for k in states)
        halves.append(np.sqrt(np.maximum(0.0, row[state] - taken)))
    halves[-1] = np.minimum(RIGHT_ANGLE, halves[-1])
    return [
        Smoothed((x, y), ErrorRectangle(half_x, half_y), heading, heading_half)
        for (x, y, heading), (half_x, half_y, heading_half) in zip(
            means[:, :3].tolist(), np.column_stack(halves).tolist(), strict=True
        )
    ]


def lay_smoothed(
    filtered: Sequence[CorrectedStretch], known: Sequence[Smoothed]
) -> tuple[list[CorrectedStretch], list[StretchErrors]]:
    """Lay each stretch from its smoothed start to its smoothed end.

    known : at the start and at the end of each stretch, and after the turn that ends it.
    """
    laid, errors = [], []
    for number, one in enumerate(filtered):
        start, end, after = known[3 * number : 3 * number + 3]
        heading_deg = one.logged.end.heading_deg + math.degrees(after.heading)
        laid.append(
            CorrectedStretch.along_chord(
                one.logged, start.place, end.place, start.heading, heading_deg
            )
        )
        turned = FilteredError(end.rectangle, after.heading_half)
        errors.append(StretchErrors(start.rectangle, end.rectangle, end.heading_half, turned))
    return laid, errors
