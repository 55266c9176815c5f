"""Every parameter with its limits, and what trials of this number find at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from possmap.lab.calibrate.assumptions import POWER, VarianceRatio, variance_ratio
from possmap.lab.calibrate.heading import LEAST, Cause, Term
from possmap.lab.calibrate.model import ModelFit, lengths, limit_factor
from possmap.lab.calibrate.reml import CONFIDENCE, Interval
from possmap.lab.calibrate.trials import Trial, TrialTable

_SPREADS: Mapping[Cause, str] = {
    "run": "across", "turn": "turn_noise", "outing_turn": "turn_spread",
    "outing_drift": "drift_spread",
}  # fmt: skip

KNOWN: tuple[Term, ...] = ("scale", "drift", "turn_bias", "turn_gain")
"""Terms that may be nothing; turns always have some noise."""

ORDER = ("along", "across", "turn_bias", "turn_gain", "turn_spread", "turn_noise", "drift",
         "drift_spread", "scale")  # fmt: skip


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """One parameter of METHOD §1, in its units.

    Attributes
    ----------
    value, low, high
        With 95 % limits. A spread is told as a half-width of 2.236 standard deviations of what
        truly varies; without what the trials leave open.
    model
        What goes into the model: for spreads, the factor for new runs, and with what is left open.
        None: it is left out.
    trials
        How many speak of it.
    detectable
        The smallest value that so many find four times out of five; None where it is no test.
    """

    value: float
    low: float
    high: float
    model: float | None
    trials: int
    detectable: float | None = None


def estimates(full: ModelFit, chosen: ModelFit) -> dict[str, ParameterEstimate]:
    """Return what trials say of each parameter.

    full : with all terms. chosen : the model, which may leave some out.
    """
    heading, factor = full.heading, limit_factor()
    found: dict[str, ParameterEstimate] = {}

    def put(name: str, limits: Interval, trials: int, unit: float = 1.0) -> None:
        of_a_test = _detectable(limits) if name in KNOWN else None
        low, value, high = unit * limits.low, unit * limits.value, unit * limits.high
        model = chosen.parameters.get(name)
        found[name] = ParameterEstimate(value, low, high, model, trials, of_a_test)

    count: Mapping[Cause, int] = {
        "run": heading.runs, "turn": heading.turns, **heading.outings
    }  # fmt: skip
    if heading.runs >= LEAST:
        free = heading.runs - 1
        put("along", Interval.chi_square(full.along_sd / full.scale, free), heading.runs, factor)
    told = set(heading.causes)
    told -= {"outing_turn"} if "outing_gain" in told else set()  # the two are one spread
    for cause in heading.causes:
        if cause in told and _SPREADS.get(cause) in full.parameters:
            unit = factor * (math.pi / 180 if cause == "run" else 1.0)
            put(_SPREADS[cause], heading.deviation_interval(cause), count[cause], unit)
    for name in KNOWN:
        limits = known_interval(full, name)
        if limits is not None:
            put(name, limits, heading.runs if name in ("drift", "scale") else heading.turns)
    for spread, trials in (("turn_spread", heading.turns), ("drift_spread", heading.runs)):
        if spread in chosen.parameters and spread not in found:
            # Each trial an outing of its own, or too few outings: all that is left open is the
            # known part's own error.
            nan = math.nan
            found[spread] = ParameterEstimate(nan, nan, nan, chosen.parameters[spread], trials)
    return {name: found[name] for name in ORDER if name in found}


def known_interval(full: ModelFit, name: Term) -> Interval | None:
    """Return a known part with its limits; None if the fit has it not.

    What differs from day to day widens them.
    """
    if name != "scale":
        return full.heading.effect_interval(name) if name in full.heading.effects else None
    runs = full.heading.runs
    if runs < LEAST:
        return None
    own, apart = full.along_sd**2 / runs, full.scale_of_days**2 / full.days
    free = float(runs - 1)
    if apart > 0:
        free = (own + apart) ** 2 / (own**2 / free + apart**2 / (full.days - 1))
    return Interval.student(full.scale, math.sqrt(own + apart), free)


def is_clear(full: ModelFit, term: Term) -> bool:
    """Whether a known part is so clear that it matters on outings longer than the trials.

    A small drift hardly moves the end of a trial, but that of a hundred metres; so a value that
    is surely not nothing stays. Several parts share the level of one test (Bonferroni).
    """
    from scipy import stats

    found = known_interval(full, term)
    if found is None:
        return False
    parts = sum(name == "scale" or name in full.heading.effects for name in KNOWN)
    limit = float(stats.t.ppf(1 - (1 - CONFIDENCE) / parts / 2, found.df))
    return abs(found.value - (term == "scale")) > found.se * limit


def _detectable(limits: Interval) -> float:
    """Return the smallest effect that a test so exact finds four times out of five."""
    from scipy import stats

    return limits.se * float(
        stats.t.ppf((1 + CONFIDENCE) / 2, limits.df) + stats.t.ppf(POWER, limits.df)
    )


def for_tracks(fit: ModelFit, trials: Sequence[Trial]) -> tuple[ModelFit, dict[str, VarianceRatio]]:
    """Return a fit whose spreads are those of long tracks, and the ratios that say so.

    Where errors of trials that follow each other surely do not add up as independent ones do,
    spreads come nearer to what does; but none falls below the lower limit of its estimate. Where
    the truth is exact, it has no noise to take back, and nothing is changed.
    """
    if fit.heading.runs < LEAST:
        return fit, {}
    table, problem, rows = TrialTable.of(trials), fit.heading.problem, fit.heading.rows
    stretched = lengths(table, fit.heading.effect("drift")) - fit.scale
    tracks = np.array(["" if one.exact else one.track for one in trials])
    off = (problem.y - problem.x @ problem.fitted.beta)[np.argsort(rows)]
    wished = {
        "along": variance_ratio(stretched * table.distance[table.run], tracks[table.run].tolist()),
        "heading": variance_ratio(off, tracks[np.sort(rows)].tolist()),
    }
    ratios = {name: one for name, one in wished.items() if one is not None}
    factors = {"along": ratios["along"].widening} if "along" in ratios else {}
    if "heading" in ratios:
        # What is known of a drift or an over-turn comes from the same errors.
        widening = ratios["heading"].widening
        factors |= dict.fromkeys(_SPREADS.values(), widening)
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
