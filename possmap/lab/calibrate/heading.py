"""What trials say of a robot's heading: over-turn, drift, and what nobody can know of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.lab.calibrate.reml import Interval, Problem
from possmap.lab.calibrate.trials import UNIT_TURN_DEG, Flags, Floats, Trial, TrialTable

Term: TypeAlias = Literal["scale", "drift", "turn_bias", "turn_gain", "turn_noise"]
TERMS: tuple[Term, ...] = ("scale", "drift", "turn_bias", "turn_gain", "turn_noise")
"""What a model may leave out; the rest is always there."""

Cause: TypeAlias = Literal["run", "turn", "outing_turn", "outing_gain", "outing_drift"]

LEAST = 3
"""Fewest trials, or outings, of which anything can be estimated."""

LEAST_DAYS, LEAST_OF_A_SIDE = 2, 2


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
    runs, turns
        How many trials speak of each.
    outings
        How many outings, or days if there are several, speak of each cause drawn once for each.
    sides
        Whether turns to both sides were made.
    rows
        Which trials are the problem's rows.
    """

    effects: tuple[Term, ...]
    causes: tuple[Cause, ...]
    problem: Problem
    told: bool
    runs: int
    turns: int
    outings: Mapping[Cause, int]
    sides: bool
    rows: NDArray[np.intp]

    def effect(self, name: Term) -> float:
        """Return a mean effect, 0 if the fit has none."""
        if name not in self.effects:
            return 0.0
        return float(self.problem.fitted.beta[self.effects.index(name)])

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
            + self.variance("outing_gain") * (turned * UNIT_TURN_DEG) ** 2
            + self.variance("outing_drift") * reach**2
        )
        return found

    def error(self, **weights: float) -> float:
        """Return the standard error of a combination of effects."""
        which = np.array([weights.get(name, 0.0) for name in self.effects])
        return math.sqrt(max(0.0, float(which @ self.problem.fitted.covariance @ which)))

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
    trials: Sequence[Trial], terms: Collection[Term] = TERMS, outings: bool = True
) -> HeadingFit:
    """Fit over-turn, drift and their spreads to trials of one robot.

    The heading error at the end speaks where it was measured; where it was not, the direction in
    which the trial truly ended, to which a drift adds only half. Of trials of several days, each
    day is an outing: what differs from day to day is what the next outing will differ by.

    Parameters
    ----------
    terms
        What the model may use.
    outings
        Whether what is drawn once per outing is estimated, if there are enough of them.
    """
    table = TrialTable.of(trials)
    days = len({one.day for one in trials}) > 1
    names = np.array([one.day if days else one.outing for one in trials])
    rows = np.flatnonzero(table.told | table.run)
    rows = rows[np.argsort(names[rows], kind="stable")]
    run, is_turn = table.run[rows], table.turns[rows]
    turned, net, reach = table.turned_told[rows], table.turn_told[rows], table.reach[rows]
    turns, runs = int(is_turn.sum()), int(run.sum())
    left, right = int((is_turn & (net > 0)).sum()), int((is_turn & (net < 0)).sum())
    sides = min(left, right) >= LEAST_OF_A_SIDE
    wished: dict[Term, Floats] = {}
    if turns >= LEAST and "turn_bias" in terms:
        wished["turn_bias"] = turned
    if turns >= LEAST and "turn_gain" in terms and sides:
        wished["turn_gain"] = net
    if runs >= LEAST and "drift" in terms:
        wished["drift"] = reach
    columns = _told_apart(wished)
    own: dict[Cause, Floats] = {}
    if runs:
        own["run"] = run.astype(np.float64)
    spins = bool((~run & (turned > 0)).any())  # without noise of turns they had none
    if turns >= LEAST and ("turn_noise" in terms or spins):
        own["turn"] = turned
        if np.linalg.matrix_rank(np.column_stack(list(own.values())), tol=1e-6) < len(own):
            del own["turn"]  # each trial ran and turned alike
    if not own:
        own["turn"] = np.maximum(turned, 1e-6)
    outing = np.unique(names[rows], return_inverse=True)[1].astype(np.intp)
    shared: dict[Cause, Floats] = {}
    counts: dict[Cause, int] = {}
    wanted: tuple[tuple[Cause, Flags, Floats], ...] = (
        ("outing_turn", is_turn, turned),
        ("outing_gain", is_turn & days & sides, net),
        ("outing_drift", run, reach),
    )
    for cause, which, column in wanted:
        each = np.bincount(outing[which], minlength=1)
        counts[cause] = int((each > 0).sum())
        if outings and int((each >= 2).sum()) >= (LEAST_DAYS if days else LEAST):
            shared[cause] = column
    problem = Problem(
        _stacked(columns, len(rows)), table.angle[rows], _stacked(own, len(rows)),
        _stacked(shared, len(rows)), outing,
    )  # fmt: skip
    return HeadingFit(
        tuple(columns), (*own, *shared), problem, bool(table.told[rows][run].any()),
        runs, turns, counts, sides, rows,
    )  # fmt: skip


def _told_apart(wished: Mapping[Term, Floats]) -> dict[Term, Floats]:
    """Return the columns that trials tell apart: if all turned and ran alike, not all of them."""
    columns: dict[Term, Floats] = {}
    for name, column in wished.items():
        more = np.column_stack([*columns.values(), column])
        more = more / np.maximum(np.abs(more).max(axis=0), 1e-12)
        if np.linalg.matrix_rank(more, tol=1e-6 * math.sqrt(len(more))) == more.shape[1]:
            columns[name] = column
    return columns


def _stacked(columns: Mapping[Term, Floats] | Mapping[Cause, Floats], size: int) -> Floats:
    return np.column_stack(list(columns.values())) if columns else np.empty((size, 0))
