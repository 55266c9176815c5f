"""In plain words: how a robot errs, whether the paper's model fits, what is left over."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from possmap.lab.calibrate.assumptions import LEVEL, Independence, Normality, Proportionality
from possmap.lab.calibrate.heading import LEAST, Term
from possmap.lab.calibrate.held_out import Score
from possmap.lab.calibrate.model import JOINT, directions
from possmap.lab.calibrate.robots import RobotResult
from possmap.lab.calibrate.trials import TrialTable

GOOD_TURN_SPREAD = 0.5
"""The estimator heading needs robots no worse (METHOD §1)."""

RULE_M = 10.0
"""The way on which plain words tell an error."""


def plain(result: RobotResult) -> str:
    """Return how the robot errs, for somebody who has never heard of the parameters."""
    own, words = result.parameters, []
    drift = own.get("drift", 0.0)
    if drift:
        words.append(f"pulls {abs(drift):.2g}°/m to the {'left' if drift > 0 else 'right'}")
    bias, gain = own.get("turn_bias", 0.0), 45 * own.get("turn_gain", 0.0)
    if bias:
        words.append(
            f"over-turns {abs(bias):.2g}° per 45° to the {'left' if bias > 0 else 'right'}"
        )
    if gain:
        words.append(f"turns {abs(gain):.2g}° too {'far' if gain > 0 else 'little'} per 45°")
    scale = own.get("scale", 1.0)
    if scale != 1:
        less = "farther" if scale > 1 else "less far"
        words.append(f"runs {100 * abs(scale - 1):.2g} % {less} than it says")
    before = "with that taken out, " if words else ""
    words = words or ["errs to no side that would show"]
    if "across" in own:
        spread = math.radians(own.get("drift_spread", 0.0)) * RULE_M**2 / 2
        aside = math.hypot(own["across"] * RULE_M, spread)
        words.append(
            f"{before}a run of {RULE_M:g} m ends within {own['along'] * RULE_M:.2g} m "
            f"ahead and {aside:.2g} m aside"
        )
    return f"{result.robot or 'such a robot'} {'; '.join(words)}."


def findings(result: RobotResult) -> Iterator[str]:
    """Yield what a result says, a sentence or two for each matter."""
    yield _of_the_paper(result)
    yield from _terms(result)
    yield from _size(result)
    yield from _left(result)


def _of_the_paper(result: RobotResult) -> str:
    """Say what speaks against the paper's model; several tests share the level of one."""
    tests = {name: one for name, one in result.tests.items() if one is not None}
    count = sum(2 if isinstance(one, Independence) else 1 for one in tests.values())
    if not tests:
        return "The paper's model: there is too little to test it."
    level = LEVEL / count
    against = []
    for name in ("along_proportional", "across_proportional"):
        grows = tests.get(name)
        if isinstance(grows, Proportionality) and grows.p < level:
            which = name.partition("_")[0]
            against.append(
                f"the error {which} grows as distance to the power {grows.exponent:.2f}, not 1"
            )
    against += [
        f"errors {name} are not normal"
        for name in ("along", "across")
        if f"normal_{name}" in tests and tests[f"normal_{name}"].p < level
    ]
    independent = tests.get("independent")
    if isinstance(independent, Independence) and independent.p < level:
        against.append("errors along and across hang together")
    elif isinstance(independent, Independence) and independent.sizes_p < level:
        against.append("large errors along and across come together")
    lacking: tuple[Term, ...] = ("turn_gain", "drift", "scale")
    missing = [name for name in lacking if name in result.parameters and result.has(name)]
    if missing:
        against.append(f"it lacks {', '.join(missing)}, which this robot clearly has")
    bias = result.estimates.get("turn_bias")
    if bias is not None and bias.low <= 0 <= bias.high:
        gains = ", but in the turn's own direction" if "turn_gain" in missing else ""
        against.append(f"turns err to no side that would show{gains}")
    if not against:
        return (
            "The paper's model fits: nothing in these trials speaks against normal, independent "
            "errors in proportion to distance and an over-turn to one side."
        )
    return (
        f"The paper's model does not fit as it stands: {'; '.join(against)} (of {count} tests "
        f"each counts at {level:.3f})."
    )


def _terms(result: RobotResult) -> Iterator[str]:
    validation = result.validation
    if validation is None:
        what = "trials" if result.robot else "robots"
        yield f"Too few {what} to hold some of them out: all terms are in the model, unproven."
        return
    for name, worth in validation.worth.items():
        without = (
            f"without it {_share(worth.without, validation.full)}, score {worth.gain:+.1%} ± "
            f"{worth.error:.1%}"
        )
        if worth.earned:
            yield f"{name} earns its place: {without}."
        elif name in result.dropped:
            where = {"turn_noise": "across", "scale": "along", "drift": "drift_spread"}
            into = where.get(name, "turn_spread")
            yield f"{name} does not earn its place, and is left out (into {into}): {without}."
        else:
            kept = "; the pooled model keeps it."
            if result.robot:
                kept = ", but is clearly there, and grows on longer ways: kept."
            yield (
                f"{name} makes no better rectangles at the length of these trials ({without}){kept}"
            )


def _share(score: Score, full: Score) -> str:
    """Say how large rectangles are, beside those of the full model, and how often they hold."""
    parts = []
    if score.trials:
        parts.append(
            f"rectangles {score.size / full.size - 1:+.0%}, holding {score.coverage:.0%} "
            f"(with it {full.coverage:.0%})"
        )
    if score.headings and full.heading_half > 0:
        parts.append(f"headings {score.heading_half / full.heading_half - 1:+.0%}")
    return ", ".join(parts)


def _size(result: RobotResult) -> Iterator[str]:
    validation, own, linear = result.validation, result.heading, result.linear
    if validation is not None and own is not None and linear is not None:
        days = ", of whole days each," if validation.by_day and result.robot else ""
        if own.trials:
            yield (
                f"Of {own.trials} held-out ends{days} {own.coverage:.0%} lie in the rectangles "
                f"(asked: {JOINT:.0%}), {own.size:.3f} m half-wide in the mean; under the "
                f"estimator linear {linear.coverage:.0%} at {linear.size:.3f} m; with the paper's "
                f"model {validation.paper.coverage:.0%} at {validation.paper.size:.3f} m."
            )
        if own.headings:
            yield (
                f"Of {own.headings} held-out headings {own.heading_coverage:.0%} lie within "
                f"±{own.heading_half:.1f} deg in the mean (asked: 97 %)."
            )
    spread = result.parameters.get("turn_spread")
    if spread is not None and spread > GOOD_TURN_SPREAD:
        yield (
            f"turn_spread is {spread:.2f} deg: more than the {GOOD_TURN_SPREAD} that the estimator "
            "heading can do with; walls does with any."
        )


def leftover(result: RobotResult) -> dict[str, float]:
    """Return what no parameter stands for: how far ends and headings disagree, and the like."""
    found: dict[str, float] = {}
    full, table = result.fit, TrialTable.of(result.trials)
    both = table.run & table.told
    if both.sum() >= LEAST and full.heading.runs >= LEAST:
        off = directions(table, full.heading)[0][both[table.run]]
        known = full.heading.known(table.turned_told, table.turn_told, table.distance)
        rest = (table.heading - known)[both]
        found["heading_minus_direction_deg"] = float((off - rest).std(ddof=1))
        if (off - rest).std() > 0 and rest.std() > 0 and off.std() > 0:
            found["direction_and_heading"] = float(np.corrcoef(off, rest)[0, 1])
    if full.excess > 1:
        found["ends_scatter_times"] = full.excess
    spins = [one for one in result.trials if one.is_turn and not one.distance]
    moved = [math.hypot(one.along, one.across) for one in spins if not math.isnan(one.along)]
    if len(moved) >= LEAST:
        found["turn_moves_m"] = float(np.median(moved))
    if result.mount:
        found["mount_deg"] = result.mount
    return found | {f"stays_{name}": share for name, share in result.stays.items()}


def _left(result: RobotResult) -> Iterator[str]:
    left = leftover(result)
    apart = left.get("heading_minus_direction_deg", 0.0)
    if apart > 0.1:
        both = left.get("direction_and_heading", math.nan)
        yield (
            f"Left over: ends and headings disagree by {apart:.1f} deg (deviation; correlation "
            f"{both:.2f}; the model says 0 and 1): noise of the truth, or turning during the run."
        )
    for name, what in (("along", "along"), ("heading", "of heading")):
        share = result.stays.get(name)
        if share is not None and share < 1:
            yield (
                f"Of errors {what}, {share:.0%} of the variance stays from trial to trial (p < "
                "0.001); the rest is taken back, as noise of the truth is. The model is for whole "
                "tracks, and narrowed towards what stays as far as that is beyond doubt; single "
                "ends, as the truth has them, scatter more."
            )
        elif share is not None:
            yield (
                f"Errors {what} hang together from trial to trial: sums vary {share:.1f} times as "
                "much as those of independent ones (p < 0.001). The model is widened as far as "
                "that is beyond doubt."
            )
    if left.get("turn_moves_m", 0.0) > 0.01:
        yield (
            f"Left over: a turn on the spot moves the truth by {left['turn_moves_m']:.3f} m: what "
            "was tracked is not the point about which the robot turns. No parameter stands for it."
        )
    if result.mount:
        yield (
            f"Left over: the truth's heading lies {result.mount:+.2f} deg from the way driven; "
            "taken out."
        )
    legs = [leg for leg in result.legs if leg.estimator == "heading"]
    if legs:
        told = [
            f"{leg.length:g} m: {leg.coverage:.0%} of {leg.poses} poses and {leg.end_coverage:.0%} "
            f"of {leg.legs} ends inside, {leg.half_width:.2f} m half-wide"
            for leg in legs
        ]
        yield f"Legs held against a model of the other half of the way: {'; '.join(told)}."
    for leg in legs:
        if leg.legs >= 5 and leg.end_coverage < 0.85:
            yield (
                f"Left over: on legs of {leg.length:g} m only {leg.end_coverage:.0%} of the ends "
                "lie inside: errors hang together from run to run in a way that no parameter tells."
            )


def test_words(result: RobotResult) -> Iterator[tuple[str, str]]:
    """Yield name and outcome of each test, with what one of its size finds."""
    for name, one in result.tests.items():
        first, _, last = name.partition("_")
        if isinstance(one, Normality):
            yield (
                f"normal {last}",
                f"{_p(one.p)} (Lilliefors, D = {one.distance:.3f}, n = {one.trials}); would find "
                f"t(3) tails {one.power_tails:.0%} of the time, slips in a tenth of the trials "
                f"{one.power_mixture:.0%}",
            )
        elif isinstance(one, Independence):
            yield (
                "independent",
                f"{_p(one.p)}, r = {one.correlation:+.2f} [{one.low:+.2f}, {one.high:+.2f}]; sizes "
                f"{_p(one.sizes_p)}; would find |r| >= {one.detectable:.2f} 80% of the time",
            )
        elif isinstance(one, Proportionality):
            yield (
                f"{first} ~ distance",
                f"{_p(one.p)}, exponent {one.exponent:.2f} [{one.low:.2f}, {one.high:.2f}] (paper: "
                f"1; 0.5: {_p(one.p_root)}); would find 1 ± {one.detectable:.2f} 80% of the time",
            )
        elif last == "proportional":
            yield f"{first} ~ distance", "not tested: about one distance only, or too few trials"


def _p(value: float) -> str:
    return f"p = {value:.3f}" if value >= 0.001 else "p < 0.001"
