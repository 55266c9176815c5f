"""Trials that stand twice in tables: copies would make spreads too small."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from possmap.lab.calibrate.trials import Trial

MOST, MOST_SHARE = 3, 0.1
"""So many trials, or this share of all, may be like an earlier one."""

CHANCE = 0.001


def repeated(trials: Sequence[Trial]) -> list[tuple[Trial, Trial]]:
    """Return trials that repeat an earlier one in all numbers, each behind that one.

    Empty if they are few, or if a coarse ruler explains them: values along, and those across or of
    headings, drawn independently, would then repeat as often.
    """
    from scipy import stats

    first: dict[tuple[object, ...], Trial] = {}
    found: list[tuple[Trial, Trial]] = []
    groups: dict[tuple[object, ...], list[tuple[str, str, str]]] = {}
    for one in trials:
        asked = (one.robot, one.manoeuvre, one.distance, one.turn)
        # As text, since NaN is not like itself.
        errors = (repr(one.along), repr(one.across), repr(one.heading))
        groups.setdefault(asked, []).append(errors)
        if (*asked, *errors) in first:
            found.append((first[*asked, *errors], one))
        else:
            first[*asked, *errors] = one
    if len(found) <= MOST and len(found) <= MOST_SHARE * len(trials):
        return []
    pairs, expected = 0, 0.0
    for rows in groups.values():
        every = math.comb(len(rows), 2)
        if every:
            pairs += _alike(rows)
            along, across, heading = (_alike(column) / every for column in zip(*rows, strict=True))
            # The same error of heading makes the same across: the two count as one.
            expected += every * along * min(across, heading)
    return found if float(stats.poisson.sf(pairs - 1, expected)) < CHANCE else []


def _alike(values: Sequence[object]) -> int:
    return sum(math.comb(count, 2) for count in Counter(values).values())
