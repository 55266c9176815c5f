"""One robot's trials, from first look to model: odd ones, terms, limits, tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from possmap.lab.calibrate.checks import (
    Proportionality,
    independence,
    proportionality,
)
from possmap.lab.calibrate.crossval import Validation, cross_validate, written
from possmap.lab.calibrate.estimates import estimates, is_clear
from possmap.lab.calibrate.heading import LEAST, TERMS, Term
from possmap.lab.calibrate.model import Fit, directions, fit_model, lengths, paper_model
from possmap.lab.calibrate.normality import normality
from possmap.lab.calibrate.oddities import FEW, leftover, notes, stays
from possmap.lab.calibrate.results import RobotResult
from possmap.lab.calibrate.slips import without_slips
from possmap.lab.calibrate.tracks import for_tracks
from possmap.lab.calibrate.trials import Floats, Table, Trial

HALF_CIRCLE_DEG = 180.0

NOTHING = 1e-6
"""Scatter so small, in metres per metre or degrees, is none: nobody measures it."""


class Unusable(Exception):
    """Trials of which no model can be made; the message says why."""


def calibrate_robot(
    robot: str, trials: Sequence[Trial], rng: np.random.Generator, fleet: bool = False
) -> RobotResult:
    """Return all that the trials of one robot say.

    Parameters
    ----------
    rng
        Draws folds, and the tables of Lilliefors' test.
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
    if not fleet:  # of several robots it would be their differences that stay
        plain, chosen = chosen, for_tracks(chosen, trials)
        factors = {
            name: value / plain.parameters[name]
            for name, value in chosen.parameters.items()
            if value != plain.parameters[name]
        }
        if validation is not None and (left_out or factors):
            validation = written(validation, trials, terms, factors)
    table = Table.of(trials)
    result = RobotResult(
        robot=robot,
        trials=tuple(trials),
        fit=full,
        parameters=chosen.parameters,
        estimates=estimates(full, chosen),
        left_out=left_out,
        paper=paper_model(trials),
        along_normal=None,
        across_normal=None,
        independent=None,
        along_grows=None,
        across_grows=None,
        validation=validation,
        leftover=leftover(full, trials) | stays(chosen),
        notes=(*notes(trials, full), *slips),
    )
    if full.heading.runs < LEAST:
        return result
    distance = table.distance[table.run]
    stretched = lengths(table, full.heading.effect("drift")) - full.scale
    off, said = directions(table, full.heading)
    standard = off / said if said.min() > 0 else off
    aside = np.radians(off) * distance
    return replace(
        result,
        along_normal=normality(stretched, rng),
        across_normal=normality(standard, rng),
        independent=independence(stretched, standard),
        along_grows=proportionality(stretched * distance, distance),
        across_grows=_of_straight_runs(table, aside, distance),
    )


def _of_straight_runs(table: Table, aside: Floats, distance: Floats) -> Proportionality | None:
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
