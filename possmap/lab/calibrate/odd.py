"""What is odd about trials, and why a model may not be trusted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from possmap.lab.calibrate.estimates import known_interval
from possmap.lab.calibrate.heading import LEAST, Term
from possmap.lab.calibrate.held_out import Score
from possmap.lab.calibrate.model import JOINT, PER_AXIS
from possmap.lab.calibrate.robots import FEW, RobotResult

COARSE = 5
"""Fewer different values among many trials: the ruler was coarser than the robot."""

APART = 4.0
"""Standard errors between two robots' known parts from which they are called different."""

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
