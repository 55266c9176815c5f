"""The error model that trials give: METHOD §1's, wide enough for what they leave open."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.calibrate.factor import rectangle_factor
from possmap.lab.calibrate.heading import LEAST, TERMS, HeadingFit, Term, fit_heading
from possmap.lab.calibrate.trials import UNIT_TURN_DEG, Floats, Trial, TrialTable

EXCESS = 1.2
"""Ends that scatter so many times more than headings make a model wider, and it says so."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What one set of terms makes of trials.

    Attributes
    ----------
    terms
        Those that it may use.
    heading
        The fit of headings.
    parameters
        METHOD §1's, those that the trials speak of.
    scale, along_sd
        True over asked length, and its deviation, per metre run; NaN without runs.
    excess
        How many times more the directions of ends scatter than the headings explain; at least 1.
    between, robots
        Of a fleet: deviation of the robots' scales, and how many; 0 and 1 within one robot.
    """

    terms: frozenset[Term]
    heading: HeadingFit
    parameters: dict[str, float]
    scale: float
    along_sd: float
    excess: float
    between: float = 0.0
    robots: int = 1

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


def fit_model(trials: Sequence[Trial], terms: Collection[Term] = TERMS, fleet: bool = False) -> Fit:
    """Return the model that trials of one robot give.

    A half-width is the factor for *new* runs times a deviation (``factor.py``). What the trials
    leave open of a known part goes into its spread, since it is one unknown for all outings to
    come; a known part that the model may not use goes there whole.

    Parameters
    ----------
    terms
        The known parts, and ``turn_noise``, that the model may use.
    fleet
        Whether each outing is another robot: then two suffice to see that robots differ, and
        their scales differ as well.
    """
    allowed = set(TERMS) if "turn_noise" in terms else set(TERMS) - {"turn_noise"}
    heading = fit_heading(trials, allowed, 2 if fleet else LEAST)
    found: dict[str, float] = {}
    ends = _Ends.of(trials, heading, "scale" in terms, fleet)
    if heading.runs >= LEAST:
        known = heading.effect("drift")
        found |= ends.parameters(heading)
        if "drift" in terms and "drift" in heading.effects:
            found["drift"], known = known, 0.0
        variance = heading.variance("outing_drift")
        count = heading.running_outings if variance else heading.runs
        if "drift" in heading.effects or variance > 0:  # otherwise nobody knows
            found["drift_spread"] = _spread(variance, heading.error(drift=1.0), known, count)
    if heading.turns >= LEAST:
        left = {name: heading.effect(name) for name in _TURNING}
        for name in _TURNING:
            if name in terms and name in heading.effects:
                found[name], left[name] = left[name], 0.0
        variance = heading.variance("outing_turn")
        count = heading.turning_outings if variance else heading.turns
        found["turn_spread"] = max(
            _spread(
                variance,
                heading.error(turn_bias=1.0, turn_gain=side * UNIT_TURN_DEG),
                left["turn_bias"] + side * UNIT_TURN_DEG * left["turn_gain"],
                count,
            )
            for side in (1, -1)
        )
        if "turn" in heading.causes:
            noise = math.sqrt(heading.variance("turn"))
            found["turn_noise"] = rectangle_factor(heading.turns) * noise
    return Fit(
        frozenset(terms), heading, found, ends.scale, ends.along_sd, ends.excess, ends.between,
        ends.robots,
    )  # fmt: skip


def paper_model(trials: Sequence[Trial]) -> Fit:
    """Return what the paper's §3 would have: a rectangle, and an over-turn to one side."""
    heading = fit_heading(trials, {"turn_bias"}, least_outings=None)
    ends = _Ends.of(trials, heading, free=False)
    found: dict[str, float] = {}
    if heading.runs >= LEAST:
        found |= ends.parameters(heading)
    if heading.turns >= LEAST:
        found["turn_bias"] = heading.effect("turn_bias")
        error = heading.error(turn_bias=1.0)
        found["turn_spread"] = _spread(0.0, error, 0.0, heading.turns)
    return Fit(frozenset({"turn_bias"}), heading, found, ends.scale, ends.along_sd, ends.excess)


_TURNING: tuple[Term, ...] = ("turn_bias", "turn_gain")


@dataclass(frozen=True, slots=True)
class _Ends:
    """What the places of ends say; NaN without runs.

    between, robots : deviation of robots' scales, of how many; 0 within one robot.
    """

    scale: float
    along_sd: float
    excess: float
    free: bool
    between: float = 0.0
    robots: int = 1

    @classmethod
    def of(
        cls, trials: Sequence[Trial], heading: HeadingFit, free: bool, fleet: bool = False
    ) -> _Ends:
        if heading.runs < LEAST:
            return cls(math.nan, math.nan, 1.0, free)
        table = TrialTable.of(trials)
        shares = lengths(table, heading.effect("drift"))
        scale = float(shares.mean()) if free else 1.0
        square = float(((shares - scale) ** 2).sum()) / (len(shares) - free)
        between, robots = 0.0, 1
        names = np.array([one.outing for one in trials])[table.run]
        if fleet and free and len(set(names)) > 1:
            each = {name: shares[names == name] for name in set(names)}
            middles = np.array([one.mean() for one in each.values()])
            robots, scale, between = len(each), float(middles.mean()), float(middles.std(ddof=1))
            within = sum(float(((one - one.mean()) ** 2).sum()) for one in each.values())
            square = within / max(1, len(shares) - robots)
        off, said = directions(table, heading)
        excess = 1.0
        if said.min(initial=math.inf) > 0:
            more = math.sqrt(float(((off / said) ** 2).sum()) / max(1, len(off) - 1))
            excess = more if more > EXCESS else 1.0
        return cls(scale, math.sqrt(square), excess, free, between, robots)

    def parameters(self, heading: HeadingFit) -> dict[str, float]:
        factor = rectangle_factor(heading.runs)
        kick = math.radians(math.sqrt(heading.variance("run")))
        along = factor * self.along_sd
        if self.robots > 1:
            along = math.hypot(along, rectangle_factor(max(LEAST, self.robots)) * self.between)
        found = {
            "along": along / self.scale,
            "across": factor * self.excess * kick,
            "factor": factor,
        }
        return found | ({"scale": self.scale} if self.free else {})


def _spread(variance: float, error: float, left: float, count: int) -> float:
    """Return the half-width of what is one unknown per outing.

    variance : from outing to outing. error : of the known part. left : what is not taken as known.
    count : trials or outings that speak of it.
    """
    # The square of an estimate is too large by that of its error.
    return rectangle_factor(max(LEAST, count)) * math.sqrt(variance + max(error**2, left**2))
