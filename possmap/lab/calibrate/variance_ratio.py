"""The variance ratio of errors along tracks: noise of the truth is taken back, errors add up.

A truth that is itself noisy makes each trial look worse, but takes back in the next what it gave in
the one before: errors of trials that follow each other then add up to less than independent ones.
Errors that hang together add up to more. Either matters for whole tracks, and hardly for trials.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from possmap.lab.calibrate.estimates import estimates
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import Fit, lengths
from possmap.lab.calibrate.reml import CONFIDENCE
from possmap.lab.calibrate.trials import Floats, Trial, TrialTable

BLOCK = 10
"""Trials that are added up."""

LEAST_BLOCKS = 20
"""Fewer sums say too little of their variance."""

CHANCE = 0.001
"""So rarely independent errors look otherwise; only then is a model changed."""


@dataclass(frozen=True, slots=True)
class VarianceRatio:
    """Variance of sums of errors over the sum of their variances: 1 if they are independent.

    share, low, high : with its 95 % limits. p : how often independent errors have one so far off.
    blocks : how many sums.
    """

    share: float
    low: float
    high: float
    p: float
    blocks: int

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
    df = len(sums)
    low, high = stats.chi2.ppf([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2], df)
    below = float(stats.chi2.cdf(share * df, df))
    p = min(1.0, 2 * min(below, 1 - below))
    return VarianceRatio(share, share * df / low, share * df / high, p, df)


_OF_HEADING = ("across", "turn_noise", "turn_spread", "drift_spread")


def for_tracks(fit: Fit, trials: Sequence[Trial]) -> tuple[Fit, dict[str, VarianceRatio]]:
    """Return a fit whose spreads are those of long tracks, and the ratios that say so.

    Where errors of trials that follow each other surely do not add up as independent ones do,
    spreads come nearer to what does; but none falls below the lower limit of its estimate. Where
    the truth is exact, it has no noise to take back, and nothing is changed.
    """
    if fit.heading.runs < LEAST:
        return fit, {}
    table = TrialTable.of(trials)
    stretched = lengths(table, fit.heading.effect("drift")) - fit.scale
    tracks = np.array(["" if one.exact else one.track for one in trials])
    problem = fit.heading.problem
    off: Floats = problem.y - problem.x @ problem.at(problem.variances).beta
    wished = {
        "along": variance_ratio(stretched * table.distance[table.run], tracks[table.run].tolist()),
        "heading": variance_ratio(off, tracks[table.told | table.run].tolist()),
    }
    ratios = {name: one for name, one in wished.items() if one is not None}
    factors = {"along": ratios["along"].widening} if "along" in ratios else {}
    if "heading" in ratios:
        # What is known of a drift or an over-turn comes from the same errors.
        widening = ratios["heading"].widening
        factors |= dict.fromkeys(_OF_HEADING, widening)
        if widening < 1:  # what scatters ends, but not for good, is no heading
            factors["across"] /= fit.excess
    factors = {name: by for name, by in factors.items() if by != 1.0 and name in fit.parameters}
    told = estimates(fit, fit) if factors else {}
    found = dict(fit.parameters)
    for name, by in factors.items():
        changed = by * found[name]
        if by < 1 and name in told and not math.isnan(told[name].low):
            changed = min(found[name], max(changed, told[name].low))
        found[name] = changed
    return replace(fit, parameters=found), ratios
