"""Whether the paper's assumptions hold: normal, independent errors in proportion to distance.

Beside each test stands what one of its size finds four times out of five: a test that finds
nothing with few trials has not shown that there is nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from possmap.lab.calibrate.reml import CONFIDENCE
from possmap.lab.calibrate.trials import Floats

LEVEL = 0.05
POWER = 0.8
LEAST_NORMAL, LEAST = 4, 5
LEAST_SPREAD = 0.1
"""Deviation of the logarithms of distances below which they are all one distance."""

_DRAWS, _POWER_DRAWS, _NUMBERS = 10_000, 1_000, 2_000_000


@dataclass(frozen=True, slots=True)
class Normality:
    """What Lilliefors' test says, for a mean and a deviation that come from the same trials.

    The paper used Kolmogorov's test, whose table holds for a mean and a deviation known beforehand:
    at 20 trials its true size is 0.0001, not 0.05 (METHOD §6).

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


def normality(errors: Floats, rng: np.random.Generator) -> Normality | None:
    """Test finite errors, shape (n,); None for fewer than four, or without variance."""
    from scipy import stats

    count = len(errors)
    if count < LEAST_NORMAL or not errors.std() > 1e-12 * max(1.0, float(np.abs(errors).max())):
        return None
    draws = max(200, min(_DRAWS, _NUMBERS // count))
    found = stats.goodness_of_fit(
        stats.norm, errors, statistic="ks", n_mc_samples=draws, random_state=rng
    )
    limit = float(np.quantile(found.null_distribution, 1 - LEVEL))

    def power(draw: Callable[[tuple[int, int]], Floats]) -> float:
        samples = draw((min(_POWER_DRAWS, draws), count))
        return float((gap(samples) > limit).mean())

    return Normality(
        distance=float(found.statistic),
        p=float(found.pvalue),
        trials=count,
        power_tails=power(lambda shape: rng.standard_t(3, shape)),
        power_mixture=power(
            lambda shape: np.where(rng.random(shape) < 0.1, 3.0, 1.0) * rng.standard_normal(shape)
        ),
    )


def gap(samples: Floats) -> Floats:
    """Return Kolmogorov's distance of samples, (..., n), from the normal one fitted to each."""
    from scipy import special

    count = samples.shape[-1]
    middle = samples.mean(axis=-1, keepdims=True)
    deviation = samples.std(axis=-1, ddof=1, keepdims=True)
    share = special.ndtr(np.sort((samples - middle) / deviation, axis=-1))
    steps = np.arange(count + 1) / count
    found: Floats = np.maximum((steps[1:] - share).max(axis=-1), (share - steps[:-1]).max(axis=-1))
    return found


@dataclass(frozen=True, slots=True)
class Independence:
    """Correlation of along and across.

    Attributes
    ----------
    correlation, low, high, p
        Pearson's, its limits (Fisher's), and how often independent errors have one so large.
    sizes, sizes_p
        Spearman's correlation of their sizes: large with large, whatever the sign.
    trials
        How many.
    detectable
        The smallest correlation that so many trials find four times out of five.
    """

    correlation: float
    low: float
    high: float
    p: float
    sizes: float
    sizes_p: float
    trials: int
    detectable: float


def independence(along: Floats, across: Floats) -> Independence | None:
    """Test two columns of errors, shape (n,); None for fewer than five, or without variance."""
    from scipy import stats

    count = len(along)
    if count < LEAST or not (along.std() > 0 and across.std() > 0):
        return None
    r, p = (float(one) for one in stats.pearsonr(along, across))
    r = min(max(r, -1 + 1e-12), 1 - 1e-12)
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2))
    half = z / math.sqrt(max(1, count - 3))
    sizes, sizes_p = 0.0, 1.0
    if np.ptp(np.abs(along)) > 0 and np.ptp(np.abs(across)) > 0:
        sizes, sizes_p = (float(one) for one in stats.spearmanr(np.abs(along), np.abs(across)))
    found = (z + float(stats.norm.ppf(POWER))) / math.sqrt(max(1, count - 3))
    return Independence(
        r, math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half), p,
        sizes, sizes_p, count, math.tanh(found),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Proportionality:
    """The power of distance with which an error's deviation grows: 1 in the paper.

    Attributes
    ----------
    exponent, low, high, p
        With its limits, and how often an exponent of 1 looks so unlike 1.
    p_root
        The same for 0.5: errors that are drawn anew with every metre.
    trials
        How many.
    detectable
        The smallest difference of an exponent from 1 that they find four times out of five.
    """

    exponent: float
    low: float
    high: float
    p: float
    p_root: float
    trials: int
    detectable: float


def proportionality(errors: Floats, distance: Floats) -> Proportionality | None:
    """Fit ``deviation = s * distance**exponent`` to errors [m], shape (n,).

    None for fewer than five trials, or if all ran about one distance.
    """
    from scipy import optimize, stats

    logs = np.log(distance)
    if len(errors) < LEAST or not logs.std() > LEAST_SPREAD or not np.abs(errors).max() > 0:
        return None
    logs = logs - logs.mean()
    # In units of about their own size, so that no power over- or underflows.
    errors = errors / np.exp(logs) / float(np.sqrt(((errors / np.exp(logs)) ** 2).mean()))

    def deviance(exponent: float) -> float:
        scaled = errors * np.exp((1 - exponent) * logs)
        return len(errors) * math.log(float((scaled**2).mean()))

    done = optimize.minimize_scalar(deviance, bounds=(-6, 8), method="bounded")
    best, least = float(done.x), float(done.fun)
    allowed = least + float(stats.chi2.ppf(CONFIDENCE, 1))

    def over(exponent: float) -> float:
        return deviance(exponent) - allowed

    low = float(optimize.brentq(over, best - 30, best)) if over(best - 30) > 0 else -math.inf
    high = float(optimize.brentq(over, best, best + 30)) if over(best + 30) > 0 else math.inf
    p, p_root = (float(stats.chi2.sf(max(0.0, deviance(value) - least), 1)) for value in (1.0, 0.5))
    # Fisher's information about the exponent is twice the sum of squares of the logarithms.
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2) + stats.norm.ppf(POWER))
    found = z / math.sqrt(2 * float((logs**2).sum()))
    return Proportionality(best, low, high, p, p_root, len(errors), found)


@dataclass(frozen=True, slots=True)
class Assumptions:
    """What was tested; None where there is too little to test."""

    along_normal: Normality | None = None
    across_normal: Normality | None = None
    independent: Independence | None = None
    along_grows: Proportionality | None = None
    across_grows: Proportionality | None = None
