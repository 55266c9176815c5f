"""Looking back over an excursion that holds a fix (METHOD §7, Fixes, and looking back).

The backward pass of Bryson and Frazier, modified by Bierman (1973): it needs no inverse of P, so
that variances of zero are fine. Its λ and Λ tell what is still to come; going back over the steps
of the filter, at each mark m - P·λ and P - P·Λ·P are what all observations together say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from possmap.core.correction import CorrectedStretch
from possmap.core.kalman import Forgotten, Mark, Mixed, Observed, Row, Step
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle, FilteredError, StretchErrors


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
    found: list[Smoothed] = []
    size = next(len(one.mean) for one in steps if isinstance(one, Mark))
    lam, big = [0.0] * size, [[0.0] * size for _ in range(size)]  # λ and Λ
    for step in reversed(steps):
        match step:
            case Mark(mean, rows):
                found.append(_looked_back(mean, rows, lam, big))
            case Mixed(state, shares):  # λ ← Fᵀλ, Λ ← FᵀΛF
                for other, share in shares:
                    lam[other] += share * lam[state]
                    for row in big:
                        row[other] += share * row[state]
                for other, share in shares:
                    big[other] = [
                        a + share * b for a, b in zip(big[other], big[state], strict=True)
                    ]
            case Forgotten(state):
                lam[state], big[state] = 0.0, [0.0] * size
                for row in big:
                    row[state] = 0.0
            case Observed():
                _through(step, lam, big)
    return found[::-1]


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


def _looked_back(mean: Row, rows: list[Row], lam: Row, big: list[Row]) -> Smoothed:
    """Return m - P·λ, and P - P·Λ·P of the place and the heading."""
    at: list[float] = []
    halves: list[float] = []
    for state, row in enumerate(rows):
        at.append(mean[state] - sum(p * value for p, value in zip(row, lam, strict=True)))
        taken = sum(
            p * sum(q * value for q, value in zip(row, line, strict=True))
            for p, line in zip(row, big, strict=True)
        )
        halves.append(math.sqrt(max(0.0, row[state] - taken)))
    (x, y, heading), (half_x, half_y, heading_half) = at, halves
    rectangle = ErrorRectangle(half_x, half_y)
    return Smoothed((x, y), rectangle, heading, min(RIGHT_ANGLE, heading_half))


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
