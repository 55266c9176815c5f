"""Robots calibrated: each by itself, and together as one that stands for a robot not yet known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from possmap.lab.calibrate.assumptions import (
    Assumptions,
    Proportionality,
    independence,
    normality,
    proportionality,
)
from possmap.lab.calibrate.crossval import Validation, cross_validate, written
from possmap.lab.calibrate.diagnostics import FEW, leftover, notes
from possmap.lab.calibrate.estimates import estimates, is_clear
from possmap.lab.calibrate.heading import LEAST, TERMS, Term
from possmap.lab.calibrate.model import Fit, directions, fit_model, lengths
from possmap.lab.calibrate.outliers import without_slips
from possmap.lab.calibrate.results import Calibration, RobotResult
from possmap.lab.calibrate.trials import Floats, Trial, TrialTable
from possmap.lab.calibrate.variance_ratio import for_tracks

APART = 4.0
"""Standard errors between two robots' known parts from which they are called different."""


HALF_CIRCLE_DEG = 180.0

NOTHING = 1e-6
"""Scatter so small, in metres per metre or degrees, is none: nobody measures it."""


class Unusable(Exception):
    """Trials of which no model can be made; the message says why."""


def calibrate(
    trials: Sequence[Trial],
    rng: np.random.Generator,
    remarks: Sequence[str] = (),
    pool: bool = True,
) -> Calibration:
    """Calibrate each robot of some trials, and all together if they may be pooled.

    Pooled, each robot counts as an outing of one robot: so spreads hold what differs from robot to
    robot.
    """
    by_robot: dict[str, list[Trial]] = {}
    for trial in trials:
        by_robot.setdefault(trial.robot, []).append(trial)
    found: list[RobotResult] = []
    refused: dict[str, str] = {}
    for robot, own in sorted(by_robot.items()):
        try:
            found.append(calibrate_robot(robot, own, rng))
        except Unusable as reason:
            refused[robot] = str(reason)
    pooled = None
    if pool and len(found) > 1:
        together = [replace(one, outing=robot.robot) for robot in found for one in robot.trials]
        try:
            pooled = calibrate_robot("", together, rng, fleet=True)
        except Unusable as reason:
            remarks = (*remarks, f"all together: {reason}")
    if pooled is not None:
        words = list(_differences(found))
        if len(found) < LEAST:
            words.append(
                f"{len(found)} robots say little of how robots differ: the pooled spreads are wide "
                "to match"
            )
        pooled = replace(pooled, notes=(*pooled.notes, *words))
    return Calibration(tuple(found), pooled, refused, tuple(remarks))


def _differences(robots: Sequence[RobotResult]) -> Iterator[str]:
    """Yield which known parts differ between robots beyond what their trials leave open."""
    for name in ("turn_bias", "turn_gain", "drift", "scale"):
        known: Mapping[str, tuple[float, float]] = {
            one.robot: (found.value, (found.high - found.low) / 3.92)
            for one in robots
            if (found := one.estimates.get(name)) is not None
        }
        if len(known) < 2:
            continue
        least = min(known, key=lambda robot: known[robot][0])
        most = max(known, key=lambda robot: known[robot][0])
        gap = known[most][0] - known[least][0]
        error = math.hypot(known[most][1], known[least][1])
        if error > 0 and gap > APART * error:
            yield (
                f"robots differ in {name}: {least} {known[least][0]:.3g}, {most} "
                f"{known[most][0]:.3g}; their own models are better than the pooled one"
            )


def calibrate_robot(
    robot: str, trials: Sequence[Trial], rng: np.random.Generator, fleet: bool = False
) -> RobotResult:
    """Return all that the trials of one robot say.

    Parameters
    ----------
    rng
        Draws folds, and the null distribution of Lilliefors' test.
    fleet
        Whether they are of many robots, each an outing: all terms then stay in the model, since
        each robot differs.

    Raises
    ------
    Unusable
        For too few trials, errors without variance, or a drift that cannot be told.
    """
    _refuse(trials)
    slips: list[str] = []
    if not fleet:  # those of several robots have lost theirs
        trials, slips = without_slips(trials)
    full = fit_model(trials, fleet=fleet)
    _refuse_circles(full, trials)
    validation = cross_validate(trials, rng, fleet)
    left_out = () if fleet else _not_earned(full, validation)
    terms = frozenset(TERMS) - set(left_out)
    chosen = fit_model(trials, terms) if left_out else full
    stays: dict[str, float] = {}
    if not fleet:  # of several robots it would be their differences that stay
        plain, (chosen, ratios) = chosen.parameters, for_tracks(chosen, trials)
        stays = {f"stays_{k}": one.share for k, one in ratios.items() if one.widening != 1.0}
        factors = {k: v / plain[k] for k, v in chosen.parameters.items() if v != plain[k]}
        if validation is not None and (left_out or factors):
            validation = written(validation, trials, terms, factors)
    return RobotResult(
        robot=robot,
        trials=tuple(trials),
        fit=full,
        parameters=chosen.parameters,
        estimates=estimates(full, chosen),
        left_out=left_out,
        tests=_tests(full, trials, rng),
        validation=validation,
        leftover=leftover(full, trials) | stays,
        notes=(*notes(trials, full), *slips),
    )


def _tests(full: Fit, trials: Sequence[Trial], rng: np.random.Generator) -> Assumptions:
    """Test what the paper takes for granted, as far as there are runs."""
    if full.heading.runs < LEAST:
        return Assumptions()
    table = TrialTable.of(trials)
    distance = table.distance[table.run]
    stretched = lengths(table, full.heading.effect("drift")) - full.scale
    off, said = directions(table, full.heading)
    standard = off / said if said.min() > 0 else off
    return Assumptions(
        along_normal=normality(stretched, rng),
        across_normal=normality(standard, rng),
        independent=independence(stretched, standard),
        along_grows=proportionality(stretched * distance, distance),
        across_grows=_of_straight_runs(table, np.radians(off) * distance, distance),
    )


def _of_straight_runs(table: TrialTable, aside: Floats, distance: Floats) -> Proportionality | None:
    """Test how the error across grows: of runs without a turn before, if there are enough."""
    straight = table.turned[table.run] == 0
    if straight.sum() >= FEW // 2:
        return proportionality(aside[straight], distance[straight])
    return proportionality(aside, distance)


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
            raise Unusable(
                f"{name}, found no variance in {len(values)} trials, expected ends that "
                f"differ{place}: "
                + (
                    "is the truth the odometry itself?"
                    if some[0].track
                    else "was the ruler too coarse, or the trials copied?"
                )
            )


def _refuse_circles(full: Fit, trials: Sequence[Trial]) -> None:
    """Refuse a drift that goes round more than half a circle in one run: ends do not tell it."""
    longest = max((one.distance for one in trials if one.is_run), default=0.0)
    drift = full.heading.effect("drift")
    if abs(drift) * longest > HALF_CIRCLE_DEG:
        raise Unusable(
            f"drift, found {drift:.3g} deg/m, which turns the robot by more than half a circle in "
            f"its run of {longest:g} m: such a drift cannot be told; expected shorter runs, or "
            "headings in degrees"
        )


def _not_earned(full: Fit, validation: Validation | None) -> tuple[Term, ...]:
    """Return the terms that do not make held-out rectangles better; none if that is unknown."""
    if validation is None:
        return ()
    return tuple(
        term
        for term in TERMS
        if term in validation.worth
        and not validation.worth[term].earned
        and not is_clear(full, term)
    )
