"""Robots calibrated: each by itself, and together as one that stands for a robot not yet known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from possmap.lab.calibrate.assumptions import (
    Independence,
    Normality,
    Proportionality,
    independence,
    normality,
    proportionality,
)
from possmap.lab.calibrate.estimates import (
    ParameterEstimate,
    estimates,
    for_tracks,
    is_clear,
)
from possmap.lab.calibrate.heading import LEAST, TERMS, Term
from possmap.lab.calibrate.held_out import (
    LEAST_DAYS,
    LegScore,
    Score,
    Validation,
    cross_validate,
    hold,
    left_out,
)
from possmap.lab.calibrate.model import ModelFit, directions, fit_model, lengths
from possmap.lab.calibrate.odd import without_slips
from possmap.lab.calibrate.trials import FEW, Trial, TrialTable

HALF_CIRCLE_DEG = 180.0

NOTHING = 1e-6
"""Scatter so small, in metres per metre or degrees, is none: nobody measures it."""

Test: TypeAlias = Normality | Independence | Proportionality


class Unusable(Exception):
    """Trials of which no model can be made; the message says why."""


@dataclass(frozen=True, eq=False)
class RobotResult:
    """What the trials of one robot say, or of all robots together.

    Attributes
    ----------
    robot
        Its name; empty: of all together.
    trials
        Those used.
    fit
        The model with all terms, before any is left out.
    parameters
        The model: METHOD §1's parameters.
    estimates
        By parameter.
    dropped
        Terms that are not in the model though they could be estimated.
    tests
        Of the paper's assumptions; None where there is too little to test.
    validation
        None for too few trials.
    heading, linear
        Scores of the model as it is written, under each estimator, on trials held out.
    slips
        What lay far off, a sentence each.
    legs
        Held-out legs, of recordings.
    mount
        Angle between the truth's heading and the way driven [deg].
    stays
        How errors of trials that follow each other add up, where not like independent ones.
    """

    robot: str
    trials: Sequence[Trial]
    fit: ModelFit
    parameters: Mapping[str, float]
    estimates: Mapping[str, ParameterEstimate]
    dropped: tuple[Term, ...]
    tests: Mapping[str, Test | None]
    validation: Validation | None
    heading: Score | None
    linear: Score | None
    slips: tuple[str, ...] = ()
    legs: tuple[LegScore, ...] = ()
    mount: float = 0.0
    stays: Mapping[str, float] = field(default_factory=dict)

    def has(self, name: Term) -> bool:
        """Whether a term is there beyond doubt: it earns its place, or is surely not nothing."""
        worth = self.validation.worth if self.validation is not None else {}
        return (name in worth and worth[name].earned) or is_clear(self.fit, name)


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a call found out.

    robots : one each. pooled : of all together; None for a single robot.
    refused : robots without a model, and why. notes : about the input.
    """

    robots: tuple[RobotResult, ...]
    pooled: RobotResult | None
    refused: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def everyone(self) -> tuple[RobotResult, ...]:
        """The robots, and behind them all together."""
        return self.robots if self.pooled is None else (*self.robots, self.pooled)


def calibrate(
    trials: Sequence[Trial], rng: np.random.Generator, pool: bool = True, keep_slips: bool = False
) -> Calibration:
    """Calibrate each robot of some trials, and all together if they may be pooled.

    Pooled, each robot counts as a day of one robot: so spreads hold what differs from robot to
    robot.
    """
    by_robot: dict[str, list[Trial]] = {}
    for trial in trials:
        by_robot.setdefault(trial.robot, []).append(trial)
    found: list[RobotResult] = []
    refused: dict[str, str] = {}
    for robot, own in sorted(by_robot.items()):
        try:
            found.append(calibrate_robot(robot, own, rng, keep_slips))
        except Unusable as reason:
            refused[robot] = str(reason)
    pooled, notes = None, []
    if pool and len(found) > 1:
        together = [replace(one, day=robot.robot) for robot in found for one in robot.trials]
        try:
            pooled = calibrate_robot("", together, rng)
        except Unusable as reason:
            notes.append(f"all together: {reason}")
    return Calibration(tuple(found), pooled, refused, tuple(notes))


def calibrate_robot(
    robot: str, trials: Sequence[Trial], rng: np.random.Generator, keep_slips: bool = False
) -> RobotResult:
    """Return all that the trials of one robot say.

    Parameters
    ----------
    robot
        Its name; empty for many robots, each a day: all terms then stay in the model, since each
        robot differs.
    rng
        Draws folds, and the null distribution of Lilliefors' test.
    keep_slips
        Whether trials far off all others count like any.

    Raises
    ------
    Unusable
        For too few trials, errors without variance, or a drift that cannot be told.
    """
    _refuse(trials)
    slips: list[str] = []
    if robot and not keep_slips:  # those of several robots have lost theirs
        trials, slips = without_slips(trials)
    full = fit_model(trials)
    _refuse_circles(full, trials)
    validation = None
    if robot or full.days >= LEAST_DAYS:
        validation = cross_validate(trials, rng)
    worth = validation.worth if validation is not None else {}
    dropped: tuple[Term, ...] = ()
    if robot:
        dropped = tuple(k for k, one in worth.items() if not one.earned and not is_clear(full, k))
    terms = frozenset(TERMS) - set(dropped)
    plain = fit_model(trials, terms) if dropped else full
    # Of several robots it would be their differences that stay.
    chosen, ratios = for_tracks(plain, trials) if robot else (plain, {})
    factors = {k: v / plain.parameters[k] if v else 1.0 for k, v in chosen.parameters.items()}
    scores: list[Score] = []
    if validation is not None:
        # The same fits of the other trials, changed by what the whole changed.
        def written(some: list[Trial]) -> ModelFit:
            made = fit_model(some, terms)
            own = {k: v * factors.get(k, 1.0) for k, v in made.parameters.items()}
            return replace(made, parameters=own)

        models = left_out(trials, validation.fold, written) or []
        scores = [hold(trials, models, "heading").score, hold(trials, models, "linear").score]
    return RobotResult(
        robot=robot,
        trials=tuple(trials),
        fit=full,
        parameters=chosen.parameters,
        estimates=estimates(full, chosen),
        dropped=dropped,
        tests=_tests(full, trials, rng),
        validation=validation,
        heading=scores[0] if scores else None,
        linear=scores[1] if scores else None,
        slips=tuple(slips),
        stays={name: one.share for name, one in ratios.items() if one.widening != 1.0},
    )


def _tests(
    full: ModelFit, trials: Sequence[Trial], rng: np.random.Generator
) -> dict[str, Test | None]:
    """Test what the paper takes for granted, as far as there are runs."""
    if full.heading.runs < LEAST:
        return {}
    table = TrialTable.of(trials)
    distance = table.distance[table.run]
    stretched = lengths(table, full.heading.effect("drift")) - full.scale
    off, said = directions(table, full.heading)
    standard = off / said if said.min() > 0 else off
    straight = table.turned[table.run] == 0  # how errors across grow, tell runs without a turn
    if straight.sum() < FEW // 2:
        straight[:] = True
    return {
        "normal_along": normality(stretched, rng),
        "normal_across": normality(standard, rng),
        "independent": independence(stretched, standard),
        "along_proportional": proportionality(stretched * distance, distance),
        "across_proportional": proportionality(
            (np.radians(off) * distance)[straight], distance[straight]
        ),
    }


def _refuse(trials: Sequence[Trial]) -> None:
    runs = [one for one in trials if one.is_run]
    turns = [one for one in trials if one.is_turn]
    if len(runs) < LEAST and len(turns) < LEAST:
        raise Unusable(
            f"found {len(runs)} runs and {len(turns)} turns, expected at least {LEAST} of one "
            f"of them, better {FEW}"
        )
    for name, some, values in (
        ("along", runs, [one.along / one.distance for one in runs]),
        ("across", runs, [one.across / one.distance for one in runs]),
        ("heading", turns, [one.heading for one in turns if not math.isnan(one.heading)]),
    ):
        if len(values) >= LEAST and np.ptp(values) <= NOTHING:
            place = f" (first: {some[0].place})" if some[0].place else ""
            why = "was the ruler too coarse, or the trials copied?"
            if some[0].track:
                why = "is the truth the odometry itself?"
            raise Unusable(
                f"{name}, found no variance in {len(values)} trials, expected ends that "
                f"differ{place}: {why}"
            )


def _refuse_circles(full: ModelFit, trials: Sequence[Trial]) -> None:
    """Refuse a drift that goes round more than half a circle in one run: ends do not tell it."""
    longest = max((one.distance for one in trials if one.is_run), default=0.0)
    drift = full.heading.effect("drift")
    if abs(drift) * longest > HALF_CIRCLE_DEG:
        raise Unusable(
            f"drift, found {drift:.3g} deg/m, which turns the robot by more than half a circle in "
            f"its run of {longest:g} m: such a drift cannot be told; expected shorter runs, or "
            "headings in degrees"
        )
