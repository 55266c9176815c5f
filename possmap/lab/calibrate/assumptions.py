"""Whether the paper's assumptions hold: normal, independent errors in proportion to distance.

Beside each test stands what one of its size finds four times out of five: a test that finds
nothing with few trials has not shown that there is nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from possmap.lab.calibrate.reml import CONFIDENCE, Interval
from possmap.lab.calibrate.trials import Floats

LEVEL = 0.05
POWER = 0.8
LEAST_NORMAL, LEAST = 4, 5
LEAST_SPREAD = 0.1
"""Deviation of the logarithms of distances below which they are all one distance."""

BLOCK, LEAST_BLOCKS = 10, 20
"""Trials of a track that are added up, and the fewest sums that say something of their variance."""

CHANCE = 0.001
"""So rarely independent errors look otherwise; only then is a model changed."""

_DRAWS, _POWER_DRAWS, _NUMBERS = 10_000, 1_000, 2_000_000


class Normality(NamedTuple):
    """What Lilliefors' test says, for a mean and a deviation that come from the same trials.

    The paper used Kolmogorov's test, whose table holds for a mean and a deviation known beforehand:
    at 20 trials its true size is 0.0001, not 0.05 (METHOD §6).

    distance : largest gap between the errors' distribution and the fitted normal one. p : how often
    normal errors have one so large. power_tails : how often so many trials find errors of Student's
    t with 3 degrees of freedom (now and then a large one). power_mixture : the same where every
    tenth trial scatters three times as much (slips).
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

    tails = power(lambda shape: rng.standard_t(3, shape))
    mixture = power(
        lambda shape: np.where(rng.random(shape) < 0.1, 3.0, 1.0) * rng.standard_normal(shape)
    )
    return Normality(float(found.statistic), float(found.pvalue), count, tails, mixture)


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


class Independence(NamedTuple):
    """Correlation of along and across.

    correlation, low, high, p : Pearson's, its limits (Fisher's), and how often independent errors
    have one so large. sizes, sizes_p : Spearman's of their sizes: large with large, whatever the
    sign. detectable : the smallest correlation that so many trials find four times out of five.
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
    found = stats.pearsonr(along, across)
    low, high = found.confidence_interval(CONFIDENCE)
    sizes, sizes_p = 0.0, 1.0
    if np.ptp(np.abs(along)) > 0 and np.ptp(np.abs(across)) > 0:
        sizes, sizes_p = (float(one) for one in stats.spearmanr(np.abs(along), np.abs(across)))
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2) + stats.norm.ppf(POWER))
    return Independence(
        float(found.statistic), float(low), float(high), float(found.pvalue), sizes, sizes_p,
        count, math.tanh(z / math.sqrt(count - 3)),
    )  # fmt: skip


class Proportionality(NamedTuple):
    """The power of distance with which an error's deviation grows: 1 in the paper.

    exponent, low, high, p : with its limits, and how often an exponent of 1 looks so unlike 1.
    p_root : the same for 0.5: errors that are drawn anew with every metre. detectable : the
    smallest difference of an exponent from 1 that so many find four times out of five.
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

    def end(side: int) -> float:
        there = best + 30 * side
        if deviance(there) <= allowed:
            return side * math.inf
        return float(optimize.brentq(lambda x: deviance(x) - allowed, best, there))

    p, p_root = (float(stats.chi2.sf(max(0.0, deviance(value) - least), 1)) for value in (1.0, 0.5))
    # Fisher's information about the exponent is twice the sum of squares of the logarithms.
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2) + stats.norm.ppf(POWER))
    found = z / math.sqrt(2 * float((logs**2).sum()))
    return Proportionality(best, end(-1), end(1), p, p_root, len(errors), found)


class VarianceRatio(NamedTuple):
    """Variance of sums of errors over the sum of their variances: 1 if they are independent.

    A truth that is itself noisy makes each trial look worse, but takes back in the next what it
    gave in the one before: the sums vary less. Errors that hang together add up to more. Either
    matters for whole tracks, and hardly for trials.

    share, low, high : with its 95 % limits. p : how often independent errors have one so far off.
    """

    share: float
    low: float
    high: float
    p: float

    @property
    def widening(self) -> float:
        """What deviations are to be multiplied by: by the limit nearer to 1, which is beyond doubt.

        1 unless independence is all but excluded.
        """
        if self.p >= CHANCE or self.low <= 1 <= self.high:
            return 1.0
        return math.sqrt(self.high if self.share < 1 else self.low)


def variance_ratio(errors: Floats, tracks: Sequence[str]) -> VarianceRatio | None:
    """Return what stays of errors, in the order in which they happened.

    Parameters
    ----------
    errors
        Shape (n,), without what is known.
    tracks
        Of which track each is; empty: of none.

    Returns
    -------
    VarianceRatio or None
        None for fewer than twenty blocks of ten.
    """
    from scipy import stats

    sums: list[float] = []
    square = 0.0
    for track, which in groupby(range(len(errors)), key=lambda k: tracks[k]):
        own = errors[list(which)]
        count = len(own) // BLOCK
        if track and count:
            blocks = own[: count * BLOCK].reshape(count, BLOCK)
            sums += blocks.sum(axis=1).tolist()
            square += float((blocks**2).sum())
    if len(sums) < LEAST_BLOCKS or not square > 0:
        return None
    share = float((np.array(sums) ** 2).sum()) / square
    limits = Interval.chi_square(math.sqrt(share), len(sums))
    below = float(stats.chi2.cdf(share * len(sums), len(sums)))
    p = min(1.0, 2 * min(below, 1 - below))
    return VarianceRatio(share, limits.low**2, limits.high**2, p)
