"""What trials say of a robot's heading: over-turn, drift, and what nobody can know of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from possmap.lab.calibrate.reml import Interval, Problem
from possmap.lab.calibrate.trials import Flags, Floats, Trial, TrialTable

Term: TypeAlias = Literal["scale", "drift", "turn_bias", "turn_gain", "turn_noise"]
TERMS: tuple[Term, ...] = ("scale", "drift", "turn_bias", "turn_gain", "turn_noise")
"""What a model may leave out; the rest is always there."""

Cause: TypeAlias = Literal["run", "turn", "outing_turn", "outing_drift"]

LEAST = 3
"""Fewest trials, or outings, of which anything can be estimated."""

LEAST_OF_A_SIDE = 2


@dataclass(frozen=True, eq=False)
class HeadingFit:
    """The fit of one robot's headings.

    Attributes
    ----------
    effects, causes
        The mean effects and the variances, in the order of the problem's columns.
    problem
        Its data; degrees.
    told
        Whether headings were measured; otherwise directions of ends stand for them.
    runs, turns, turning_outings, running_outings
        How many trials and outings speak of each.
    sides
        Whether turns to both sides were made.
    """

    effects: tuple[Term, ...]
    causes: tuple[Cause, ...]
    problem: Problem
    told: bool
    runs: int
    turns: int
    turning_outings: int
    running_outings: int
    sides: bool

    def effect(self, name: Term) -> float:
        """Return a mean effect, 0 if the fit has none."""
        if name not in self.effects:
            return 0.0
        fitted = self.problem.at(self.problem.variances)
        return float(fitted.beta[self.effects.index(name)])

    def known(self, turned: Floats, turn: Floats, reach: Floats) -> Floats:
        """Return the known part of heading errors [deg].

        Parameters
        ----------
        turned, turn, reach
            How far each turned either way, in units of 45°; to the left [deg]; and ran [m].
        """
        found: Floats = (
            self.effect("turn_bias") * turned
            + self.effect("turn_gain") * turn
            + self.effect("drift") * reach
        )
        return found

    def spread(self, run: Flags | bool, turned: Floats, reach: Floats) -> Floats:
        """Return the variance about the known part [deg²]."""
        found: Floats = (
            self.variance("run") * np.asarray(run, dtype=np.float64)
            + self.variance("turn") * turned
            + self.variance("outing_turn") * turned**2
            + self.variance("outing_drift") * reach**2
        )
        return found

    def error(self, **weights: float) -> float:
        """Return the standard error of a combination of effects."""
        which = np.array([weights.get(name, 0.0) for name in self.effects])
        covariance = self.problem.at(self.problem.variances).covariance
        return math.sqrt(max(0.0, float(which @ covariance @ which)))

    def effect_interval(self, name: Term) -> Interval:
        """Return a mean effect with its limits."""
        return self.problem.effect(np.array([float(one == name) for one in self.effects]))

    def variance(self, cause: Cause) -> float:
        """Return a variance [deg²], 0 if the fit has none."""
        if cause not in self.causes:
            return 0.0
        return float(self.problem.variances[self.causes.index(cause)])

    def deviation_interval(self, cause: Cause) -> Interval:
        """Return a standard deviation with its limits [deg]."""
        found = self.problem.interval(self.causes.index(cause))
        return Interval(*(math.sqrt(value) for value in found[:3]))


def fit_heading(
    trials: Sequence[Trial], terms: Collection[Term] = TERMS, least_outings: int | None = LEAST
) -> HeadingFit:
    """Fit over-turn, drift and their spreads to trials of one robot (or of a fleet).

    The heading error at the end speaks where it was measured; where it was not, the direction in
    which the trial truly ended, to which a drift adds only half.

    Parameters
    ----------
    terms
        What the model may use.
    least_outings
        Of how many outings what is drawn once per outing is estimated; None: never.
    """
    table = TrialTable.of(trials)
    use = table.told | table.run
    turned, net, reach, y = table.turned_told, table.turn_told, table.reach, table.angle
    is_turn = use & np.array([one.is_turn for one in trials], dtype=np.bool_)
    turns, runs = int(is_turn.sum()), int((use & table.run).sum())
    left, right = int((is_turn & (net > 0)).sum()), int((is_turn & (net < 0)).sum())
    sides = min(left, right) >= LEAST_OF_A_SIDE
    wished: dict[Term, Floats] = {}
    if turns >= LEAST:
        if "turn_bias" in terms:
            wished["turn_bias"] = turned
        if "turn_gain" in terms and sides:
            wished["turn_gain"] = net
    if "drift" in terms and runs >= LEAST:
        wished["drift"] = reach
    columns = _told_apart(wished, use)
    own: dict[Cause, Floats] = {}
    if runs:
        own["run"] = table.run.astype(np.float64)
    spins = bool((use & ~table.run & (turned > 0)).any())  # without noise of turns they had none
    if turns >= LEAST and ("turn_noise" in terms or spins):
        own["turn"] = turned
        pair = np.column_stack([own[cause][use] for cause in own])
        if np.linalg.matrix_rank(pair, tol=1e-6) < len(own):  # each trial ran and turned alike
            del own["turn"]
    if not own:
        own["turn"] = np.maximum(turned, 1e-6)
    names = [one.outing for one in trials]
    outing = np.unique(names, return_inverse=True)[1].astype(np.intp)
    shared: dict[Cause, Floats] = {}
    counts: dict[Cause, int] = {"outing_turn": 0, "outing_drift": 0}
    wanted: tuple[tuple[Cause, Flags, Floats], ...] = (
        ("outing_turn", is_turn, turned),
        ("outing_drift", use & table.run, reach),
    )
    for cause, which, column in wanted:
        each = np.bincount(outing[which], minlength=1)
        counts[cause] = int((each > 0).sum())
        repeated = int((each >= 2).sum())
        if least_outings is not None and repeated >= least_outings:
            shared[cause] = column
    size = int(use.sum())
    problem = Problem(
        _stacked(columns, use, size), y[use], _stacked(own, use, size),
        _stacked(shared, use, size), np.unique(outing[use], return_inverse=True)[1],
    )  # fmt: skip
    return HeadingFit(
        tuple(columns), (*own, *shared), problem, bool(table.told[use & table.run].any()),
        runs, turns, counts["outing_turn"], counts["outing_drift"], sides,
    )  # fmt: skip


def _told_apart(wished: dict[Term, Floats], use: Flags) -> dict[Term, Floats]:
    """Return the columns that trials tell apart: if all turned and ran alike, not all of them."""
    columns: dict[Term, Floats] = {}
    for name, column in wished.items():
        more = np.column_stack([*(one[use] for one in columns.values()), column[use]])
        more = more / np.maximum(np.abs(more).max(axis=0), 1e-12)
        if np.linalg.matrix_rank(more, tol=1e-6 * math.sqrt(len(more))) == more.shape[1]:
            columns[name] = column
    return columns


def _stacked(columns: dict[Term, Floats] | dict[Cause, Floats], use: Flags, size: int) -> Floats:
    if not columns:
        return np.empty((size, 0))
    return np.column_stack([column[use] for column in columns.values()])
