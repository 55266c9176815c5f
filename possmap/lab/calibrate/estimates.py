"""Every parameter with its limits, and what trials of this number find at all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from possmap.lab.calibrate.assumptions import POWER
from possmap.lab.calibrate.factor import limit_factor
from possmap.lab.calibrate.heading import LEAST, Cause, Term
from possmap.lab.calibrate.model import Fit
from possmap.lab.calibrate.reml import CONFIDENCE, Interval

_HALF_WIDTHS: Mapping[Cause, str] = {
    "run": "across", "turn": "turn_noise", "outing_turn": "turn_spread",
    "outing_drift": "drift_spread",
}  # fmt: skip

KNOWN: tuple[Term, ...] = ("scale", "drift", "turn_bias", "turn_gain")
"""Terms that may be nothing; turns always have some noise."""


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


def estimates(full: Fit, chosen: Fit) -> dict[str, ParameterEstimate]:
    """Return what trials say of each parameter.

    full : with all terms. chosen : the model, which may leave some out.
    """
    heading, factor = full.heading, limit_factor()
    found: dict[str, ParameterEstimate] = {}

    def put(name: str, limits: Interval, trials: int, detectable: float | None = None) -> None:
        model = chosen.parameters.get(name)
        found[name] = ParameterEstimate(*limits[:3], model, trials, detectable)

    if heading.runs >= LEAST:
        put("along", _along(full, factor), heading.runs)
    for cause in heading.causes:
        unit = math.pi / 180 if cause == "run" else 1.0
        limits = heading.deviation_interval(cause)
        trials = {
            "run": heading.runs, "turn": heading.turns,
            "outing_turn": heading.turning_outings, "outing_drift": heading.running_outings,
        }[cause]  # fmt: skip
        if _HALF_WIDTHS[cause] in full.parameters:
            put(
                _HALF_WIDTHS[cause],
                Interval(*(factor * unit * one for one in limits[:3])),
                trials,
            )
    for name in heading.effects:
        limits = heading.effect_interval(name)
        count = heading.runs if name == "drift" else heading.turns
        put(name, limits, count, _detectable(limits))
    if heading.runs >= LEAST:
        limits = scale_interval(full)
        put("scale", limits, heading.runs, _detectable(limits))
    order = ("along", "across", "turn_bias", "turn_gain", "turn_spread", "turn_noise", "drift",
             "drift_spread", "scale")  # fmt: skip
    for spread in ("turn_spread", "drift_spread"):
        if spread in chosen.parameters and spread not in found:
            # Each trial an outing of its own, or too few outings: all that is left open is the
            # known part's own error.
            nan = math.nan
            count = heading.turns if spread == "turn_spread" else heading.runs
            found[spread] = ParameterEstimate(nan, nan, nan, chosen.parameters[spread], count)
    return {name: found[name] for name in order if name in found}


def _along(full: Fit, factor: float) -> Interval:
    """Return the half-width along with limits by chi-square: exact for normal errors."""
    from scipy import stats

    df = full.heading.runs - 1
    value = factor * full.along_sd / full.scale
    low, high = stats.chi2.ppf([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2], df)
    return Interval(value, value * math.sqrt(df / low), value * math.sqrt(df / high), df)


def scale_interval(full: Fit) -> Interval:
    """Return true over asked length with its limits; of a fleet, those of robots' mean."""
    from scipy import stats

    df = full.heading.runs - 1
    error = full.along_sd / math.sqrt(full.heading.runs)
    if full.robots > 1:
        df, error = full.robots - 1, full.between / math.sqrt(full.robots)
    half = float(stats.t.ppf((1 + CONFIDENCE) / 2, df)) * error
    return Interval(full.scale, full.scale - half, full.scale + half, df, error)


def is_clear(full: Fit, term: Term) -> bool:
    """Whether a known part is so clear that it matters on outings longer than the trials.

    A small drift hardly moves the end of a trial, but that of a hundred metres; so a value that
    is surely not nothing stays. Several parts share the level of one test (Bonferroni).
    """
    from scipy import stats

    known = [name for name in KNOWN if name == "scale" or name in full.heading.effects]
    if term not in known or (term == "scale" and full.heading.runs < LEAST):
        return False
    if term == "scale":
        found, nothing = scale_interval(full), 1.0
    else:
        found, nothing = full.heading.effect_interval(term), 0.0
    level = (1 - CONFIDENCE) / len(known)
    return abs(found.value - nothing) > found.se * float(stats.t.ppf(1 - level / 2, found.df))


def _detectable(limits: Interval) -> float:
    """Return the smallest effect that a test so exact finds four times out of five."""
    from scipy import stats

    return limits.se * float(
        stats.t.ppf((1 + CONFIDENCE) / 2, limits.df) + stats.t.ppf(POWER, limits.df)
    )
