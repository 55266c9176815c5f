"""Which of the numbers of a recording mean something: ranges that are none, clocks that jump."""

from __future__ import annotations

import numpy as np

from possmap.lab.convert.samples import Flags, Floats
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Readable


def readable(ranges: Floats, rule: Readable, worth: float, tally: Tally) -> Floats:
    """Return readings in metres, NaN where there is none, infinity where nothing was in sight."""
    metres = ranges * worth
    nothing = (metres > rule.nothing_above) | np.isposinf(metres) | np.isin(ranges, rule.nothing)
    missing = np.isnan(metres)  # no reading is no fault: not every row has one of every beam
    invalid = (metres > rule.invalid_above) | (metres <= rule.invalid_below)
    invalid |= np.isin(ranges, rule.invalid)
    invalid &= ~nothing & ~missing
    tally.add("readings that mean nothing, dropped", count=int(invalid.sum()))
    return np.where(nothing, np.inf, np.where(invalid, np.nan, metres))


def spikes(t: Floats) -> Flags:
    """Return which times are later than those of all the next three rows, which go on as before.

    One stamp far in the future must not put every row behind it into the past.
    """
    found = np.zeros(len(t), dtype=np.bool_)
    if len(t) > 4:
        following = np.stack([t[2:-2], t[3:-1], t[4:]])
        with np.errstate(invalid="ignore"):
            found[1:-3] = (t[1:-3] > following.max(axis=0)) & (following.min(axis=0) >= t[:-4])
    return found
