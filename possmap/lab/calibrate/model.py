"""The error model that trials give: METHOD §1's, wide enough for what they leave open."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.calibrate.heading import LEAST, TERMS, HeadingFit, Term, fit_heading
from possmap.lab.calibrate.reml import between
from possmap.lab.calibrate.trials import UNIT_TURN_DEG, Floats, Trial, TrialTable

JOINT = 0.95
PER_AXIS = math.sqrt(JOINT)
"""Two independent axes hold 95 % together if each holds so much (METHOD §6: "joint")."""

EXCESS = 1.2
"""Ends that scatter so many times more than headings make a model wider, and it says so."""


def rectangle_factor(trials: int) -> float:
    """Return half-width over standard deviation for a *new* run of a rectangle from ``trials``.

    Mean and deviation of each axis come from the same trials, so a new run less the mean is
    ``sqrt(1 + 1/n)`` deviations wide and follows Student's t with n - 1 degrees of freedom: 2.487
    for 20 trials, and 2.236 only for endlessly many.

    Raises
    ------
    ValueError
        For fewer than two trials.
    """
    from scipy import stats

    if trials < 2:
        raise ValueError(f"trials, found {trials}, expected at least 2")
    quantile = float(stats.t.ppf((1 + PER_AXIS) / 2, trials - 1))
    return quantile * math.sqrt(1 + 1 / trials)


def limit_factor() -> float:
    """Return the factor of endlessly many trials, 2.236."""
    from scipy import stats

    return float(stats.norm.ppf((1 + PER_AXIS) / 2))


@dataclass(frozen=True, eq=False)
class ModelFit:
    """What one set of terms makes of trials.

    Attributes
    ----------
    heading
        The fit of headings.
    parameters
        METHOD §1's, those that the trials speak of.
    scale, along_sd
        True over asked length, and its deviation, per metre run; NaN without runs.
    excess
        How many times more the directions of ends scatter than the headings explain; at least 1.
    scale_of_days
        Deviation of the scale from day to day.
    days
        How many.
    """

    heading: HeadingFit
    parameters: dict[str, float]
    scale: float
    along_sd: float
    excess: float
    scale_of_days: float
    days: int

    @property
    def model(self) -> ErrorModel:
        """The paper's model with these parameters in place of its own."""
        return ErrorModel(**self.parameters)


def chord_share(drift: float, distance: Floats) -> Floats:
    """Return how much shorter a run's chord is than its arc (METHOD §1: sin(u)/u).

    drift : [deg/m], taken for half a circle where it would turn a run of ``distance`` [m] by more.
    """
    bend: Floats = np.radians(drift) * distance / 2
    # Beyond half a circle an end does not tell how often the robot went round.
    return np.sinc(np.clip(bend / np.pi, -0.5, 0.5))


def lengths(table: TrialTable, drift: float) -> Floats:
    """Return true over asked length of each run, its bend undone; shape (runs,)."""
    straight: Floats = table.stretch[table.run]
    return straight / chord_share(drift, table.distance[table.run])


def directions(table: TrialTable, fit: HeadingFit) -> tuple[Floats, Floats]:
    """Return each run's direction error less what is known [deg], and its deviation; (runs,)."""
    run = table.run
    turned, half = table.turned[run], table.distance[run] / 2
    known = fit.known(turned, table.turn[run], half)
    return table.direction[run] - known, np.sqrt(fit.spread(True, turned, half))


def fit_model(
    trials: Sequence[Trial], terms: Collection[Term] = TERMS, papers: bool = False
) -> ModelFit:
    """Return the model that trials of one robot give.

    A half-width is the factor for *new* runs times a deviation. What the trials leave open of a
    known part goes into its spread, since it is one unknown for all outings to come; so does what
    differs from day to day; a known part that the model may not use goes there whole.

    Parameters
    ----------
    terms
        The known parts, and ``turn_noise``, that the model may use.
    papers
        What the paper's §3 would have: a rectangle, and an over-turn to one side.
    """
    allowed = set(TERMS) - ({"turn_noise"} - set(terms))  # what is left out is known all the same
    if papers:
        terms = allowed = {"turn_bias"}
    heading = fit_heading(trials, allowed, outings=not papers)
    days = len({one.day for one in trials})
    found: dict[str, float] = {}
    scale = along_sd = math.nan
    excess, of_days = 1.0, 0.0
    if heading.runs >= LEAST:
        table = TrialTable.of(trials)
        stretched = lengths(table, heading.effect("drift"))
        free = "scale" in terms
        scale = float(stretched.mean()) if free else 1.0
        along_sd = math.sqrt(float(((stretched - scale) ** 2).sum()) / (len(stretched) - free))
        excess = _excess(*directions(table, heading))
        which = [one.day for one in trials if one.is_run]
        along_sd, of_days = _split(stretched, which, along_sd) if free else (along_sd, 0.0)
        factor = rectangle_factor(heading.runs)
        kick = math.radians(math.sqrt(heading.variance("run")))
        along = math.hypot(factor * along_sd, rectangle_factor(max(LEAST, days)) * of_days)
        found |= {"along": along / scale, "across": factor * excess * kick, "factor": factor}
        found |= {"scale": scale} if free else {}
        found |= _drift(heading, "drift" in terms)
    if heading.turns >= LEAST:
        found |= _turning(heading, terms)
        if "turn" in heading.causes and not papers:
            noise = math.sqrt(heading.variance("turn"))
            found["turn_noise"] = rectangle_factor(heading.turns) * noise
    return ModelFit(heading, found, scale, along_sd, excess, of_days, days)


def _excess(off: Floats, said: Floats) -> float:
    """Return how many times more ends scatter across than headings say; 1 where that is little."""
    if not said.min(initial=math.inf) > 0:
        return 1.0
    more = math.sqrt(float(((off / said) ** 2).sum()) / max(1, len(off) - 1))
    return more if more > EXCESS else 1.0


def _split(values: Floats, days: Sequence[str], whole: float) -> tuple[float, float]:
    """Return the deviation within days, and that from day to day."""
    each = [values[np.array(days) == day] for day in dict.fromkeys(days)]
    free = len(values) - len(each)
    if len(each) < 2 or free < LEAST:
        return whole, 0.0
    within = math.sqrt(sum(float(((one - one.mean()) ** 2).sum()) for one in each) / free)
    if not within > 0:
        return whole, 0.0
    apart = between(
        np.array([one.mean() for one in each]),
        np.array([within / math.sqrt(len(one)) for one in each]),
    )
    return (within, apart) if apart > 0 else (whole, 0.0)


def _drift(heading: HeadingFit, taken: bool) -> dict[str, float]:
    found: dict[str, float] = {}
    known, told = heading.effect("drift"), "drift" in heading.effects
    if taken and told:
        found["drift"], known = known, 0.0
    variance = heading.variance("outing_drift")
    count = heading.outings["outing_drift"] if variance else heading.runs
    if told or variance > 0:  # otherwise nobody knows
        found["drift_spread"] = _spread(variance, heading.error(drift=1.0), known, count)
    return found


def _turning(heading: HeadingFit, terms: Collection[Term]) -> dict[str, float]:
    found: dict[str, float] = {}
    names: tuple[Term, ...] = ("turn_bias", "turn_gain")
    left = {name: heading.effect(name) for name in names}
    for name in names:
        if name in terms and name in heading.effects:
            found[name], left[name] = left[name], 0.0
    of_gain = heading.variance("outing_gain") * UNIT_TURN_DEG**2
    variance = heading.variance("outing_turn") + of_gain
    count = heading.outings["outing_turn"] if variance else heading.turns
    found["turn_spread"] = max(
        _spread(
            variance,
            heading.error(turn_bias=1.0, turn_gain=side * UNIT_TURN_DEG),
            left["turn_bias"] + side * UNIT_TURN_DEG * left["turn_gain"],
            count,
        )
        for side in (1, -1)
    )
    return found


def _spread(variance: float, error: float, left: float, count: int) -> float:
    """Return the half-width of what is one unknown per outing.

    variance : from outing to outing. error : of the known part. left : what is not taken as known.
    count : trials or outings that speak of it.
    """
    # The square of an estimate is too large by that of its error.
    return rectangle_factor(max(LEAST, count)) * math.sqrt(variance + max(error**2, left**2))
