"""What stays of errors from run to run: noise of the truth does not, a robot's error does.

A truth that is itself noisy makes each trial look worse, but takes back in the next what it gave in
the one before: errors of trials that follow each other then add up to less than independent ones.
Errors that hang together add up to more. Either matters for whole tracks, and hardly for trials.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from possmap.lab.calibrate.reml import CONFIDENCE
from possmap.lab.calibrate.trials import Floats

BLOCK = 10
"""Trials that are added up."""

LEAST_BLOCKS = 20
"""Fewer sums say too little of their variance."""

CHANCE = 0.001
"""So rarely independent errors look otherwise; only then is a model changed."""


@dataclass(frozen=True, slots=True)
class Persistence:
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


def persistence(errors: Floats, tracks: Sequence[str]) -> Persistence | None:
    """Return what stays of errors, in the order in which they happened.

    Parameters
    ----------
    errors
        Shape (n,), without what is known.
    tracks
        Of which track each is; empty: of none.

    Returns
    -------
    Persistence or None
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
    return Persistence(share, share * df / low, share * df / high, p, df)
