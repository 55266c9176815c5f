"""In plain words: whether the paper's model fits, which terms are worth having, what is left."""

from __future__ import annotations

import math
from collections.abc import Iterator

from possmap.lab.calibrate.assumptions import LEVEL, Assumptions
from possmap.lab.calibrate.crossval import Score
from possmap.lab.calibrate.estimates import is_clear
from possmap.lab.calibrate.factor import JOINT
from possmap.lab.calibrate.heading import Term
from possmap.lab.calibrate.results import RobotResult

GOOD_TURN_SPREAD = 0.5
"""The estimator heading needs robots no worse (METHOD §1)."""


def findings(result: RobotResult) -> Iterator[str]:
    """Yield what a result says, a sentence or two for each matter."""
    yield _of_the_paper(result)
    yield from _terms(result)
    yield from _size(result)
    yield from _left(result)


def _of_the_paper(result: RobotResult) -> str:
    """Say what speaks against the paper's model; several tests share the level of one."""
    tests = result.tests
    normal = {"along": tests.along_normal, "across": tests.across_normal}
    grows = {"along": tests.along_grows, "across": tests.across_grows}
    independent = tests.independent
    ps = [one.p for one in (*normal.values(), *grows.values()) if one is not None]
    ps += [independent.p, independent.sizes_p] if independent is not None else []
    if not ps:
        return "The paper's model: there is too little to test it."
    level = LEVEL / len(ps)
    against = [
        f"the error {name} grows as distance to the power {one.exponent:.2f}, not 1"
        for name, one in grows.items()
        if one is not None and one.p < level
    ]
    against += [
        f"errors {name} are not normal"
        for name, test in normal.items()
        if test is not None and test.p < level
    ]
    if independent is not None and independent.p < level:
        against.append("errors along and across hang together")
    elif independent is not None and independent.sizes_p < level:
        against.append("large errors along and across come together")
    lacking: tuple[Term, ...] = ("turn_gain", "drift", "scale")
    missing = [name for name in lacking if name in result.parameters and _is_clear(result, name)]
    if missing:
        against.append(f"it lacks {', '.join(missing)}, which this robot clearly has")
    bias = result.estimates.get("turn_bias")
    if bias is not None and bias.low <= 0 <= bias.high:
        against.append(
            "turns err to no side that would show"
            + (", but in the turn's own direction" if "turn_gain" in missing else "")
        )
    if not against:
        return (
            "The paper's model fits: nothing in these trials speaks against normal, independent "
            "errors in proportion to distance and an over-turn to one side."
        )
    return (
        f"The paper's model does not fit as it stands: {'; '.join(against)} (of {len(ps)} tests "
        f"each counts at {level:.3f})."
    )


def _is_clear(result: RobotResult, name: Term) -> bool:
    """Whether a term is there beyond doubt: it earns its place, or is surely not nothing."""
    validation = result.validation
    if validation is not None and name in validation.worth and validation.worth[name].earned:
        return True
    return is_clear(result.fit, name)


def _terms(result: RobotResult) -> Iterator[str]:
    validation = result.validation
    if validation is None:
        what = "trials" if result.robot else "robots"
        yield f"Too few {what} to hold some of them out: all terms are in the model, unproven."
        return
    full = validation.full
    for name, worth in validation.worth.items():
        without = (
            f"without it {_share(worth.without, full)}, score {worth.gain:+.1%} ± {worth.error:.1%}"
        )
        if worth.earned:
            yield f"{name} earns its place: {without}."
        elif name in result.left_out:
            where = {"turn_noise": "across", "scale": "along", "drift": "drift_spread"}.get(
                name, "turn_spread"
            )
            yield f"{name} does not earn its place, and is left out (into {where}): {without}."
        else:
            yield (
                f"{name} makes no better rectangles at the length of these trials ({without})"
                + (", but is clearly there, and grows on longer ways: kept." if result.robot
                   else "; the pooled model keeps it.")
            )  # fmt: skip


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
    validation = result.validation
    if validation is not None and validation.heading.trials:
        paper, full = validation.paper, validation.heading
        yield (
            f"Of {full.trials} held-out ends {full.coverage:.0%} lie in the rectangles (asked: "
            f"{JOINT:.0%}), {full.size:.3f} m half-wide in the mean; under the estimator linear "
            f"{validation.linear.coverage:.0%} at {validation.linear.size:.3f} m; with the paper's "
            f"model {paper.coverage:.0%} at {paper.size:.3f} m."
        )
    if validation is not None and validation.heading.headings:
        full = validation.heading
        yield (
            f"Of {full.headings} held-out headings {full.heading_coverage:.0%} lie within "
            f"±{full.heading_half:.1f} deg in the mean (asked: 97 %)."
        )
    spread = result.parameters.get("turn_spread")
    if spread is not None and spread > GOOD_TURN_SPREAD:
        yield (
            f"turn_spread is {spread:.2f} deg: more than the {GOOD_TURN_SPREAD} that the estimator "
            "heading can do with; walls does with any."
        )


def _left(result: RobotResult) -> Iterator[str]:
    left = result.leftover
    apart = left.get("heading_minus_direction_deg")
    if apart is not None and apart > 0.1:
        both = left.get("direction_and_heading", math.nan)
        yield (
            f"Left over: ends and headings disagree by {apart:.1f} deg (deviation; correlation "
            f"{both:.2f}; the model says 0 and 1): noise of the truth, or turning during the run."
        )
    for name, what in (("along", "along"), ("heading", "of heading")):
        share = left.get(f"stays_{name}")
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
    moved = left.get("turn_moves_m")
    if moved is not None and moved > 0.01:
        yield (
            f"Left over: a turn on the spot moves the truth by {moved:.3f} m: what was tracked is "
            "not the point about which the robot turns. No parameter stands for it."
        )
    mount = left.get("mount_deg")
    if mount:
        yield (
            f"Left over: the truth's heading lies {mount:+.2f} deg from the way driven; taken out."
        )
    if result.legs:
        told = [
            f"{leg.length:g} m: {leg.coverage:.0%} of {leg.poses} poses and {leg.end_coverage:.0%} "
            f"of {leg.legs} ends inside, {leg.half_width:.2f} m half-wide"
            for leg in result.legs
            if leg.estimator == "heading"
        ]
        yield f"Legs held against a model of the other half of the way: {'; '.join(told)}."
    for leg in result.legs:
        if leg.estimator == "heading" and leg.legs >= 5 and leg.end_coverage < 0.85:
            yield (
                f"Left over: on legs of {leg.length:g} m only {leg.end_coverage:.0%} of the ends "
                "lie inside: errors hang together from run to run in a way that no parameter tells."
            )


def test_words(tests: Assumptions) -> Iterator[tuple[str, str]]:
    """Yield name and outcome of each test, with what one of its size finds."""
    for name, normal in (("along", tests.along_normal), ("across", tests.across_normal)):
        if normal is None:
            continue
        yield (
            f"normal {name}",
            f"{_p(normal.p)} (Lilliefors, D = {normal.distance:.3f}, n = {normal.trials}); would "
            f"find t(3) tails {normal.power_tails:.0%} of the time, slips in a tenth of the trials "
            f"{normal.power_mixture:.0%}",
        )
    independent = tests.independent
    if independent is not None:
        yield (
            "independent",
            f"{_p(independent.p)}, r = {independent.correlation:+.2f} [{independent.low:+.2f}, "
            f"{independent.high:+.2f}]; sizes {_p(independent.sizes_p)}; would find |r| >= "
            f"{independent.detectable:.2f} 80% of the time",
        )
    for name, grows in (("along", tests.along_grows), ("across", tests.across_grows)):
        if grows is None:
            yield f"{name} ~ distance", "not tested: about one distance only, or too few trials"
            continue
        yield (
            f"{name} ~ distance",
            f"{_p(grows.p)}, exponent {grows.exponent:.2f} [{grows.low:.2f}, {grows.high:.2f}] "
            f"(paper: 1; 0.5: {_p(grows.p_root)}); would find 1 ± {grows.detectable:.2f} "
            "80% of the time",
        )


def _p(value: float) -> str:
    return f"p = {value:.3f}" if value >= 0.001 else "p < 0.001"
