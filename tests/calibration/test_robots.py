"""From trials to a model: what is in it, what is said of it, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from calibrated import PAPER, SPINS, Faults, trials

from possmap.lab.calibrate.cutting import TrueTrack, cut, without_mount
from possmap.lab.calibrate.inputs import alignment, sensor
from possmap.lab.calibrate.odd import doubts, notes, of_robots
from possmap.lab.calibrate.robots import Unusable, calibrate, calibrate_robot
from possmap.lab.calibrate.trials import Trial
from possmap.lab.calibrate.words import findings, plain
from possmap.lab.evaluate.frame import distances

pytestmark = pytest.mark.thorough

PAPERS = Faults(turn_gain=0.0, drift=0.0, scale=1.0)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_the_papers_robot_fits_the_papers_model() -> None:
    result = calibrate_robot("r1", trials(PAPERS, rng(2)), rng())
    words = " ".join(findings(result))
    assert words.startswith("The paper's model fits: ")
    assert "turn_bias earns its place" in words
    assert {"drift", "turn_gain", "scale"} <= set(result.dropped)
    assert result.validation is not None
    assert 0.88 <= result.heading.coverage <= 1


def test_a_robot_with_unequal_wheels_needs_more_than_the_paper_has() -> None:
    faults = Faults(drift=1.0, scale=0.96, turn_gain=0.03)
    result = calibrate_robot("r1", trials(faults, rng(3)), rng())
    first, *rest = findings(result)
    assert "does not fit" in first and "drift" in first and "scale" in first
    assert any(line.startswith("drift earns its place") for line in rest)
    assert result.validation is not None
    paper, own = result.validation.paper, result.heading
    assert own.size < 0.7 * paper.size and own.coverage > 0.88


def test_robots_that_differ_are_told_apart_and_the_pooled_spread_holds_their_difference() -> None:
    some = [
        trial
        for k, bias in enumerate((-2.0, 2.2, 1.5))
        for trial in trials(Faults(turn_bias=bias), rng(k), robot=f"r{k}")
    ]
    found = calibrate(some, rng())
    assert [one.robot for one in found.robots] == ["r0", "r1", "r2"]
    assert found.pooled is not None
    assert found.pooled.parameters["turn_spread"] > 3
    assert any("robots differ in turn_bias" in note for note in of_robots(found.robots))
    assert all(one.parameters["turn_spread"] < 1 for one in found.robots)


def test_a_single_robot_is_not_pooled() -> None:
    assert calibrate(trials(Faults(), rng(), 5), rng()).pooled is None


@pytest.mark.parametrize(
    ("some", "words"),
    [
        (trials(Faults(), rng(), 1)[:2], "found 2 runs and 0 turns, expected at least 3"),
        ([Trial("r", str(k), 3.0, 0.0, 0.01, 0.02, 0.1, place=f"a.csv:{k}") for k in range(9)],
         "along, found no variance in 9 trials, expected ends that differ (first: a.csv:0)"),
        ([Trial("r", str(k), 3.0, 0.0, 0.01 * k, 0.0, 0.1) for k in range(9)],
         "across, found no variance in 9 trials"),
        ([Trial("r", str(k), 0.0, 90.0, heading=1.0) for k in range(9)],
         "heading, found no variance in 9 trials"),
    ],
)  # fmt: skip
def test_trials_that_no_model_comes_of_are_refused(some: list[Trial], words: str) -> None:
    with pytest.raises(Unusable) as raised:
        calibrate_robot("r", some, rng())
    assert words in str(raised.value)


def test_few_trials_are_said_to_be_few_and_the_factor_grows() -> None:
    result = calibrate_robot("r1", trials(Faults(), rng(6), 1), rng())
    assert result.fit.heading.runs == 4 and result.parameters["factor"] > 4
    assert any("only 4 runs" in note for note in notes(result))
    assert any("too little to test it" in line or "no" in line for line in findings(result))


def test_a_model_whose_held_out_ends_lie_elsewhere_is_doubted() -> None:
    score = calibrate_robot("r1", trials(PAPERS, rng(7)), rng()).heading
    assert score is not None and not list(doubts(score))
    (doubt,) = doubts(score._replace(coverage=0.8))
    assert doubt.startswith("WARNING: only 80% of 80 held-out ends lie where the model says")
    assert not list(doubts(score._replace(coverage=0.8, trials=5))), "chance does that"


def test_plain_words_come_first() -> None:
    turns = replace(Trial("r", "", 2.0, 0.0), day="")
    some = [
        replace(turns, outing=str(k), along=0.02 * a, across=-2 * math.radians(18) + 0.02 * b,
                heading=-36 + c)
        for k, (a, b, c) in enumerate(rng(12).standard_normal((30, 3)).tolist())
    ]  # fmt: skip
    assert plain(calibrate_robot("r", some, rng())).startswith("r pulls 18°/m to the right; ")


def test_a_ruler_too_coarse_is_named() -> None:
    some = [replace(one, along=round(one.along, 1) + 0.0) for one in trials(PAPERS, rng(8))]
    some[0] = replace(some[0], along=0.1)
    result = calibrate_robot("r1", some, rng())
    assert any("values in 80 trials: the ruler is coarser" in note for note in notes(result))


def test_a_robot_that_only_turned_has_a_model_of_its_turns() -> None:
    result = calibrate_robot("r1", trials(Faults(), rng(9), 10, SPINS), rng())
    assert "across" not in result.parameters and "turn_bias" in result.parameters
    assert any("too few runs: along, across, drift and scale" in note for note in notes(result))


def test_a_robot_that_never_turned_keeps_the_default_over_turn() -> None:
    result = calibrate_robot("r1", trials(Faults(), rng(10), plan=PAPER[:2]), rng())
    assert "turn_spread" not in result.parameters and "across" in result.parameters
    assert any("no turns" in note for note in notes(result))


def track(drift: float, mount: float, seed: int = 3, legs: int = 60) -> TrueTrack:
    """Return a track of turns and runs, seen by someone whose idea of ahead is off [deg]."""
    draw = rng(seed)
    logged, true = [(0.0, 0.0, 0.0)], [(5.0, -2.0, 30.0)]
    for k in range(legs):
        turn, distance = (90.0 if k % 3 else -45.0), float(draw.uniform(1, 4))
        x, y, heading = logged[-1]
        logged.append((x, y, heading + turn))
        heading += turn
        logged.append(
            (x + distance * math.cos(math.radians(heading)),
             y + distance * math.sin(math.radians(heading)), heading)
        )  # fmt: skip
        x, y, heading = true[-1]
        true.append((x, y, heading + turn))
        heading += turn + 0.5 * float(draw.standard_normal())
        way = math.radians(heading + drift * distance / 2)
        distance *= 1 + 0.01 * float(draw.standard_normal())
        true.append(
            (x + distance * math.cos(way), y + distance * math.sin(way), heading + drift * distance)
        )
    seen = np.array(true)
    seen[:, 2] += mount
    return TrueTrack("r1", "a", np.array(logged), seen, np.zeros(2 * legs, dtype=np.bool_))


def test_a_track_is_cut_into_its_turns_and_runs() -> None:
    found = list(cut(track(0.0, 0.0)))
    assert len(found) == 120
    assert {one.turn for one in found if not one.distance} == {90.0, -45.0}
    assert all(abs(one.along) < 0.05 * one.distance for one in found if one.distance)
    assert len({one.outing for one in found}) > 4, "legs of 20 m are outings"


def test_the_angle_at_which_the_truth_was_mounted_is_found_and_taken_out() -> None:
    straight, none = without_mount(list(cut(track(0.6, 0.0))))
    turned, mount = without_mount(list(cut(track(0.6, 4.0))))
    assert none == 0.0
    assert mount == pytest.approx(-4.0, abs=0.3)
    across = [np.std([one.across for one in some if one.distance]) for some in (straight, turned)]
    assert across[1] == pytest.approx(across[0], rel=0.1)


def test_runs_along_walls_and_the_turns_before_them_are_no_trials() -> None:
    whole = track(0.0, 0.0, legs=10)
    followed = np.zeros(20, dtype=np.bool_)
    followed[7] = True
    found = list(cut(replace(whole, followed=followed)))
    assert len(found) == 18


def test_known_walls_tell_the_sensor_and_how_robots_line_up() -> None:
    walls = np.array([[0.0, 0.0, 10.0, 0.0], [0.0, 0.0, 0.0, 5.0]])
    points = np.array([[3.0, 0.02], [0.03, 4.0], [12.0, 0.0]])
    assert distances(points, walls) == pytest.approx([0.02, 0.03, 2.0])
    draw = rng(11)
    ends = np.column_stack([draw.uniform(1, 9, 500), 0.01 * draw.standard_normal(500)])
    told = sensor(np.vstack([ends, [[50.0, 50.0]]]), walls)
    assert told is not None and told.trials == 500
    assert told.low <= 0.02236 <= told.high
    lined = alignment(0.005 * draw.standard_normal(50))
    assert lined is not None and lined.value == 0.0, "rounding is no error"
    assert sensor(ends[:2], walls) is None
