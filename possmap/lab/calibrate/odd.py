"""What is odd about trials: slips, which are left out; and why a model may not be trusted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from possmap.lab.calibrate.estimates import known_interval
from possmap.lab.calibrate.heading import LEAST, Term, fit_heading
from possmap.lab.calibrate.held_out import Score
from possmap.lab.calibrate.model import JOINT, PER_AXIS, directions, lengths
from possmap.lab.calibrate.trials import FEW, Floats, Trial, TrialTable

if TYPE_CHECKING:
    from possmap.lab.calibrate.robots import RobotResult

COARSE = 5
"""Fewer different values among many trials: the ruler was coarser than the robot."""

APART = 4.0
"""Standard errors between two robots' known parts from which they are called different."""

FAR = 6.0
"""Robust deviations beyond which an error is no draw of what draws the others."""

LEAST_TRIALS = 10
"""Of fewer nobody knows what is far."""

MOST_SHARE = 0.05
"""If more lie so far off, that is how the robot errs, and none is left out."""

_ROUNDS = 5

FAR_BELOW, SURELY = 0.9, 0.01
"""A share of held-out ends so small, that chance makes so rarely, makes a model doubtful."""


def notes(result: RobotResult) -> Iterator[str]:
    """Yield what is odd about the trials, a sentence each."""
    yield from doubts(result.heading)
    yield from result.slips
    heading = result.fit.heading
    for count, what in ((heading.runs, "runs"), (heading.turns, "turns")):
        if 0 < count < FEW:
            few = "; too few for a model of it" if count < LEAST else ""
            yield (
                f"only {count} {what}, the paper had {FEW} of each kind: limits are wide, and "
                f"half-widths widened to match{few}"
            )
    if not heading.turns:
        yield "no turns: turn_bias, turn_gain and turn_noise are unknown, the defaults stay"
    elif heading.turns >= LEAST and not heading.sides:
        yield (
            "turns to one side only: the same-side part and the part in the turn's direction "
            "cannot be told apart, and stand together as turn_bias"
        )
    if heading.turns >= LEAST and heading.runs >= LEAST and "drift" not in heading.effects:
        yield (
            "all trials turned and ran alike: over-turn and drift cannot be told apart, and stand "
            "together as the over-turn; drift and drift_spread are left out; add straight runs"
        )
    if result.robot and result.fit.days == 1 and result.trials[0].day:
        yield (
            "all of one day: what differs from day to day (tyres, floor, battery) is not in the "
            "model; recordings of other days bring it in"
        )
    if heading.runs < LEAST:
        yield "too few runs: along, across, drift and scale are unknown, the defaults stay"
    runs = [one for one in result.trials if one.is_run]
    for name in ("along", "across"):
        values = Counter(round(getattr(one, name), 9) for one in runs)
        if len(runs) >= 2 * COARSE and len(values) < COARSE:
            yield (
                f"{name} takes only {len(values)} values in {len(runs)} trials: the ruler is "
                "coarser than the robot, and spreads are too small or too large"
            )
    if result.fit.excess > 1:
        yield f"ends scatter {result.fit.excess:.1f} times more across than the headings explain"


def of_robots(robots: Sequence[RobotResult]) -> Iterator[str]:
    """Yield in what robots differ beyond what their trials leave open, and whether they are few."""
    names: tuple[Term, ...] = ("turn_bias", "turn_gain", "drift", "scale")
    for name in names:
        told = ((one.robot, known_interval(one.fit, name)) for one in robots)
        known = sorted((own.value, own.se, robot) for robot, own in told if own is not None)
        if len(known) < 2:
            continue
        (low, error, least), (high, other, most) = known[0], known[-1]
        if high - low > APART * math.hypot(error, other) > 0:
            yield (
                f"robots differ in {name}: {least} {low:.3g}, {most} {high:.3g}; their own models "
                "are better than the pooled one"
            )
    if len(robots) < LEAST:
        yield (
            f"{len(robots)} robots say little of how robots differ: the pooled spreads are wide to "
            "match"
        )


def doubts(score: Score | None) -> Iterator[str]:
    """Yield why a model is not to be trusted that fared so on trials it has not seen."""
    from scipy import stats

    if score is None:
        return
    for what, share, count, asked in (
        ("ends", score.coverage, score.trials, JOINT),
        ("headings", score.heading_coverage, score.headings, PER_AXIS),
    ):
        if count and share < FAR_BELOW:
            chance = float(stats.binom.cdf(round(share * count), count, asked))
            if chance < SURELY:
                yield (
                    f"WARNING: only {share:.0%} of {count} held-out {what} lie where the model "
                    f"says, far below {asked:.0%}: do not trust it before you know why (slips, too "
                    "few days, another robot or floor, a noisy truth)"
                )


def without_slips(trials: Sequence[Trial]) -> tuple[list[Trial], list[str]]:
    """Return trials without slips, and notes that name them.

    A slip is found in the heading, in the direction of the end, or in the distance to it. One may
    hide behind a larger one, so it is asked again without those found.
    """
    kept = list(trials)
    found: dict[Trial, str] = {}
    for _ in range(_ROUNDS):
        far = {k: told for k, told in enumerate(_far(kept)) if told is not None}
        if not far:
            break
        found |= {kept[k]: told for k, told in far.items()}
        kept = [one for k, one in enumerate(kept) if k not in far]
    few = len(found) <= max(1, MOST_SHARE * len(trials))
    names = [f"{one.place or one.manoeuvre or 'one'} ({told})" for one, told in found.items()]
    if not names:
        return kept, []
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    note = (
        f"{len(names)} of {len(trials)} trials far off all others: {', '.join(names[:3])}{more}: "
    )
    if few:
        return kept, [note + "slips, or something unlogged; left out (--keep-slips keeps them)"]
    return list(trials), [note + "too many for slips, this is how the robot errs; kept"]


def _far(trials: Sequence[Trial]) -> list[str | None]:
    """Tell of each trial what of it lies how far off; None: nothing."""
    told: list[str | None] = [None] * len(trials)
    table = TrialTable.of(trials)
    fit = fit_heading(trials)
    turned = table.turned_told
    known = fit.known(turned, table.turn_told, table.distance)
    said = np.sqrt(fit.spread(table.run, turned, table.distance))
    off = table.heading - known
    ones = np.ones(len(trials))
    groups = [("heading", table.told & ~table.run & table.turns, table.heading, off, said, "deg")]
    if fit.runs >= LEAST:
        ends, of_ends = (np.full(len(trials), np.nan) for _ in range(2))
        ends[table.run], of_ends[table.run] = directions(table, fit)
        stretched = np.full(len(trials), np.nan)
        stretched[table.run] = lengths(table, fit.effect("drift"))
        groups += [
            ("heading", table.told & table.run, table.heading, off, said, "deg"),
            ("end aside", table.run, table.direction, ends, of_ends, "deg"),
            ("distance", table.run, 100 * table.stretch - 100, stretched, ones, "%"),
        ]
    for what, which, raw, values, deviation, unit in groups:
        at = np.flatnonzero(which)
        if len(at) >= LEAST_TRIALS:
            far = _robust(values[at], deviation[at])
            for k in np.flatnonzero(far > FAR):
                told[at[k]] = told[at[k]] or f"{what} {raw[at[k]]:+.3g} {unit}"
    return told


def _robust(values: Floats, deviation: Floats) -> Floats:
    """Return how many robust deviations each lies off; 0 where all agree."""
    scaled = values / deviation if deviation.min() > 0 else values
    middle = float(np.median(scaled))
    apart = np.abs(scaled - middle)
    spread = 1.4826 * float(np.median(apart))
    return apart / spread if spread > 0 else np.zeros(len(values))
