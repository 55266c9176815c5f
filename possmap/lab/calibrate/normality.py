"""Lilliefors' test of normality, for a mean and a deviation that come from the same trials.

The paper used Kolmogorov's test, whose table holds for a mean and a deviation known beforehand.
With fitted ones it almost never rejects: at 20 trials its true size is 0.0001, not 0.05 (METHOD
§6). H. W. Lilliefors (JASA 62, 1967) drew the right table by lot; so does this module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from possmap.lab.calibrate.trials import Floats

LEVEL = 0.05
LEAST = 4
_DRAWS, _POWER_DRAWS, _CELLS = 10_000, 1000, 2_000_000


@dataclass(frozen=True, slots=True)
class Normality:
    """What the test says.

    Attributes
    ----------
    distance
        Largest gap between the errors' distribution and the fitted normal one.
    p
        How often normal errors have a gap so large.
    trials
        How many errors.
    power_tails
        How often this test, with so many trials, finds errors that are not normal but of Student's
        t with 3 degrees of freedom (now and then a large one).
    power_mixture
        The same where every tenth trial scatters three times as much (slips).
    """

    distance: float
    p: float
    trials: int
    power_tails: float
    power_mixture: float


def gap(samples: Floats) -> Floats:
    """Return Kolmogorov's distance of samples from the normal distribution fitted to each.

    Parameters
    ----------
    samples
        Shape (..., n), n >= 2; each of some variance.
    """
    from scipy import special

    count = samples.shape[-1]
    middle = samples.mean(axis=-1, keepdims=True)
    deviation = samples.std(axis=-1, ddof=1, keepdims=True)
    share = special.ndtr(np.sort((samples - middle) / deviation, axis=-1))
    steps = np.arange(count + 1) / count
    above = (steps[1:] - share).max(axis=-1)
    below = (share - steps[:-1]).max(axis=-1)
    found: Floats = np.maximum(above, below)
    return found


def null_gaps(count: int, rng: np.random.Generator, draws: int = _DRAWS) -> Floats:
    """Return the gaps of so many samples that are normal, sorted."""
    return np.sort(_gaps(count, draws, lambda shape: rng.standard_normal(shape)))


def normality(errors: Floats, rng: np.random.Generator) -> Normality | None:
    """Test errors, shape (n,); None for fewer than four, or without variance.

    Raises
    ------
    ValueError
        If an error is not finite.
    """
    count = len(errors)
    if not np.isfinite(errors).all():
        raise ValueError("errors, found one that is not finite, expected numbers")
    if count < LEAST or not errors.std() > 1e-12 * max(1.0, float(np.abs(errors).max())):
        return None
    null = null_gaps(count, rng)
    found = float(gap(errors))
    p = (1 + int((null >= found).sum())) / (1 + len(null))
    limit = float(np.quantile(null, 1 - LEVEL))

    def mixture(shape: tuple[int, ...]) -> Floats:
        slips = np.where(rng.random(shape) < 0.1, 3.0, 1.0)
        drawn: Floats = rng.standard_normal(shape) * slips
        return drawn

    tails = _gaps(count, _POWER_DRAWS, lambda shape: rng.standard_t(3, shape))
    slips = _gaps(count, _POWER_DRAWS, mixture)
    return Normality(found, p, count, float((tails > limit).mean()), float((slips > limit).mean()))


def _gaps(count: int, draws: int, draw: Callable[[tuple[int, ...]], Floats]) -> Floats:
    """Return the gaps of drawn samples, a few at a time where they are long."""
    draws = max(200, min(draws, _CELLS // count))
    at_once = max(1, _CELLS // (8 * count))
    parts = [gap(draw((min(at_once, draws - k), count))) for k in range(0, draws, at_once)]
    return np.concatenate(parts)
