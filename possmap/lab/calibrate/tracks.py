"""Models for whole tracks: errors of trials that follow each other may not add up as usual."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from possmap.lab.calibrate.estimates import estimates
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import Fit, lengths
from possmap.lab.calibrate.persistence import persistence
from possmap.lab.calibrate.trials import Floats, Table, Trial

_OF_HEADING = ("across", "turn_noise", "turn_spread", "drift_spread")


def for_tracks(fit: Fit, trials: Sequence[Trial]) -> Fit:
    """Return a fit whose spreads are those of long tracks (``persistence.py``).

    Where errors of trials that follow each other surely do not add up as independent ones do,
    spreads come nearer to what does; but none falls below the lower limit of its estimate. Where
    the truth is exact, it has no noise to take back, and nothing is changed.
    """
    if fit.heading.runs < LEAST:
        return fit
    table = Table.of(trials)
    stretched = lengths(table, fit.heading.effect("drift")) - fit.scale
    tracks = np.array(["" if one.exact else one.track for one in trials])
    along = persistence(stretched * table.distance[table.run], tracks[table.run].tolist())
    use = table.told | table.run
    problem = fit.heading.problem
    off: Floats = problem.y - problem.x @ problem.at(problem.variances).beta
    heading = persistence(off, tracks[use].tolist())
    # What is known of a drift or an over-turn comes from the same errors.
    factors = {} if along is None else {"along": along.widening}
    if heading is not None:
        factors |= dict.fromkeys(_OF_HEADING, heading.widening)
        if heading.widening < 1:  # what scatters ends, but not for good, is no heading
            factors["across"] /= fit.excess
    factors = {name: by for name, by in factors.items() if by != 1.0 and name in fit.parameters}
    if not factors:
        return replace(fit, stays_along=along, stays_heading=heading)
    told = estimates(fit, fit)
    found = dict(fit.parameters)
    for name, by in factors.items():
        changed = by * found[name]
        least = told[name].low if name in told else math.nan
        if by < 1 and not math.isnan(least):
            changed = min(found[name], max(changed, least))
        found[name] = changed
    return replace(fit, parameters=found, stays_along=along, stays_heading=heading)
