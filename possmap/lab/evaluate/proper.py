"""Proper scores of probabilities, each split into miscalibration and what remains."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from possmap.core.views import EDGE
from possmap.lab.evaluate.raster import Flags, Floats

BINS = 20
"""Bins of equal width in which probabilities are held against frequencies."""


class Split(NamedTuple):
    """A score, the lower the better, and its two parts, which add up to it.

    calibration : what is lost because probabilities differ from the frequencies of their bin.
    refinement : what remains, even if every bin said its frequency (Murphy).
    """

    score: float
    calibration: float
    refinement: float


def brier(probability: Floats, wall: Flags) -> Split:
    """Return the mean squared difference of probability and truth, 0 or 1."""
    score = float(np.mean((probability - wall) ** 2))
    count, mean, frequency = _binned(probability, wall)
    calibration = float((count * (mean - frequency) ** 2).sum() / count.sum())
    return Split(score, calibration, score - calibration)


def log_score(probability: Floats, wall: Flags) -> Split:
    """Return the mean of -ln of the probability given to what is true, in nats.

    Probabilities are kept e⁻¹⁶ away from 0 and 1, so that one certain mistake does not cost all.
    """
    p = np.clip(probability, EDGE, 1 - EDGE)
    score = float(-np.mean(np.log(np.where(wall, p, 1 - p))))
    count, mean, frequency = _binned(p, wall)
    cost = _times_log(frequency, mean) + _times_log(1 - frequency, 1 - mean)
    least = _times_log(frequency, frequency) + _times_log(1 - frequency, 1 - frequency)
    calibration = float((count * (least - cost)).sum() / count.sum())
    return Split(score, calibration, score - calibration)


def _times_log(share: Floats, value: Floats) -> Floats:
    """Return share·ln(value), 0 where the share is."""
    logs = np.log(np.maximum(value, math.ulp(0.0)))
    found: Floats = np.where(share > 0, share * logs, 0.0)
    return found


def _binned(probability: Floats, wall: Flags) -> tuple[Floats, Floats, Floats]:
    """Return the count, mean probability and frequency of walls of each bin that holds any."""
    which = np.minimum((probability * BINS).astype(np.int64), BINS - 1)
    count = np.bincount(which, minlength=BINS).astype(np.float64)
    some = count > 0
    mean = np.bincount(which, probability, BINS)[some] / count[some]
    frequency = np.bincount(which, wall, BINS)[some] / count[some]
    return count[some], mean, frequency


def calibration_bins(probability: Floats, wall: Flags) -> tuple[tuple[float, float, int], ...]:
    """Return mean probability, share of walls and count of each bin that holds cells."""
    count, mean, frequency = _binned(probability, wall)
    return tuple(
        (float(said), float(true), int(cells))
        for cells, said, true in zip(count, mean, frequency, strict=True)
    )
