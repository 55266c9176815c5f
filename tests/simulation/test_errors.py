"""The true motion errs as the paper measured. Every bound holds by chance with p < 1e-4."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from troupes import Bench, Floats, drive, hall

from possmap.lab.simulate.body import Faults, draw_faults
from possmap.lab.simulate.settings import MissionSettings

INCH, FOOT = 0.0254, 0.3048
SOUND = Faults(turn_bias=0.0, drift=0.0, scale=1.0)
FACTOR = MissionSettings().factor
SURE = 4.0
"""Standard deviations: |z| > 4 has p = 6e-5."""


def within(hits: int, tries: int, share: float) -> bool:
    """Whether a count of hits is one that a share explains: two binomial tails of 5e-5 each."""

    def at_most(count: int, p: float) -> float:
        terms = (math.comb(tries, k) * p**k * (1 - p) ** (tries - k) for k in range(count + 1))
        return math.fsum(terms)

    return at_most(hits, share) > 5e-5 and at_most(tries - hits, 1 - share) > 5e-5


def has_sd(values: Floats, sd: float) -> bool:
    """Whether normal values about 0 have a standard deviation (Wilson and Hilferty's chi2)."""
    n = len(values)
    ratio = float(np.square(values / sd).sum()) / n
    return bool(abs(ratio ** (1 / 3) - (1 - 2 / (9 * n))) < SURE * math.sqrt(2 / (9 * n)))


def ends_of_runs(distance: float, robots: int) -> Floats:
    """Return where a straight run ends, of each robot: true minus logged, along and across."""
    ends: list[tuple[float, float]] = []
    for seed in range(robots):
        bench = Bench(seed, SOUND)
        bench.run(distance)
        ends.append(bench.missed())
    return np.array(ends)


def test_95_percent_of_runs_of_10_feet_end_within_two_and_a_half_by_eleven_inches() -> None:
    ends = ends_of_runs(10 * FOOT, 400)
    half = np.array([2.5, 11]) / 2 * INCH
    inside = int((np.abs(ends) <= half).all(axis=1).sum())
    joint = math.erf(FACTOR / math.sqrt(2)) ** 2
    assert joint == pytest.approx(0.95, abs=1e-3)
    assert within(inside, 400, joint)
    for axis in (0, 1):
        assert has_sd(ends[:, axis], half[axis] / FACTOR)
        assert abs(ends[:, axis].mean()) < SURE * half[axis] / FACTOR / math.sqrt(400)
    along, across = (ends / half * FACTOR).T
    assert abs((along * across).mean()) < SURE / math.sqrt(400), "one says nothing of the other"


def test_a_heading_error_stays_from_run_to_run() -> None:
    sideways = []
    for seed in range(300):
        bench = Bench(seed, SOUND)
        bench.run(2.0)
        heading = bench.heading_deg
        first = bench.missed()[1]
        bench.run(2.0)
        assert heading != 0
        assert first == pytest.approx(2.0 * math.sin(math.radians(heading)), abs=1e-9)
        sideways.append(bench.missed()[1])
    # The first run's error acts twice: sd (1 + 2^2)^(1/2); forgotten between runs, it were 2^(1/2).
    assert has_sd(np.array(sideways), 2.0 * 5.5 / 120 / FACTOR * math.sqrt(5))


def test_a_robot_over_turns_to_one_side_whichever_way_it_turns() -> None:
    """200 turns of each of 30 robots: the mean over-turn is the robot's own, noise is the rest."""
    sides = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        faults = draw_faults(MissionSettings(), rng)
        bench = Bench(seed, faults)
        over: dict[float, list[float]] = {-90: [], -45: [], 45: [], 90: []}
        for asked in rng.choice(list(over), 200).tolist():
            before = bench.heading_deg
            bench.turn(asked)
            over[asked].append(bench.heading_deg - before - asked)
        for asked, found in over.items():
            parts = abs(asked) / 45
            left = np.array(found) - faults.turn_bias * parts
            sd = 0.3 * math.sqrt(parts)
            assert abs(left.mean()) < (SURE + 1) * sd / math.sqrt(len(found))
            assert np.abs(left).max() < 6 * sd
            assert has_sd(left, sd) or len(found) < 30
        sides.append(faults.turn_bias)
    assert min(sides) < 0 < max(sides)


def test_what_is_believed_of_a_turn_is_what_was_asked_for() -> None:
    bench = Bench(1, Faults(turn_bias=2.0, drift=0.0, scale=1.0), turn_noise=0.0)
    for asked, logged, true in ((45, 45, 47), (-45, 0, 4), (90, 90, 98), (-90, 0, 12)):
        bench.turn(asked)
        assert bench.steering.book.belief.logged.heading_deg == logged
        assert bench.heading_deg == pytest.approx(true)


def test_over_turns_are_about_2_degrees_a_side_drawn_per_robot() -> None:
    biases = np.array(
        [draw_faults(MissionSettings(), np.random.default_rng(k)).turn_bias for k in range(400)]
    )
    assert within(int((biases > 0).sum()), 400, 0.5)
    assert has_sd(np.abs(biases) - 2.0, 0.3)
    none = draw_faults(MissionSettings(turn_bias=0.0), np.random.default_rng(1))
    assert none.turn_bias == 0


def test_lining_up_with_a_wall_takes_the_heading_error_away() -> None:
    """Home is (0, 0); a wall lies 0.2 m to the right of the x axis."""
    room = hall(40, 10)
    room.walls[:, [0, 2]] -= 1.0
    room.walls[:, [1, 3]] -= 0.2
    for seed in range(20):
        bench = Bench(seed, Faults(2.0, 0.0, 1.0), room)
        bench.turn(45)
        bench.turn(-45)
        assert abs(bench.heading_deg) > 1
        bench.do(bench.steering.line_up(0.0))
        side = bench.missed()[1]
        bench.do(bench.steering.run(3.0, lined_up=True, wall_side=-1))
        bench.do(bench.steering.run(3.0, lined_up=True, wall_side=-1))
        assert bench.heading_deg == 0
        assert bench.missed()[1] == side, "nothing moves it sideways"
        belief = bench.steering.book.belief
        assert (belief.logged.heading_deg, belief.heading) == (0, 0)
        walls = [r for r in bench.steering.book.own.records if r["kind"] == "wall"]
        assert [wall["followed"] for wall in walls] == [True, True]


def test_a_robot_lines_up_as_far_off_a_wall_as_the_mission_says_and_its_wheels_count_it() -> None:
    room = hall(40, 10)
    room.walls[:, [0, 2]] -= 1.0
    room.walls[:, [1, 3]] -= 0.2
    off, counted = [], []
    for seed in range(100):
        bench = Bench(seed, SOUND, room, alignment_spread=4.0, turn_noise=0.0)
        bench.do(bench.steering.line_up(0.0))
        counted.append(bench.steering.book.belief.logged.heading_deg)
        for _ in range(2):
            bench.do(bench.steering.run(3.0, lined_up=True, wall_side=-1))
            assert bench.missed()[1] == pytest.approx(0, abs=1e-9), "it goes where the wall goes"
            assert bench.heading_deg == pytest.approx(counted[-1], abs=0.006)
        assert bench.steering.book.belief.heading == 0
        off.append(bench.heading_deg)
        bench.run(2.0)
        assert bench.missed()[1] != 0
    assert has_sd(np.array(off), 4.0 / 2.236)


def test_drift_bends_a_run_and_ends_where_the_method_says() -> None:
    exact: dict[str, Any] = {"along": 0.0, "across": 0.0, "odometry_step": 1e-6}
    bench = Bench(1, Faults(turn_bias=0.0, drift=1.0, scale=1.0), **exact)
    bench.run(10.0)
    place = bench.body.place
    assert (place.x, place.y) == pytest.approx((9.949, 0.870), abs=5e-4)
    assert bench.heading_deg == pytest.approx(10)
    pieces = Bench(1, Faults(turn_bias=0.0, drift=1.0, scale=1.0), **exact)
    for _ in range(100):
        pieces.run(0.1)
    assert (pieces.body.place.x, pieces.body.place.y) == pytest.approx((place.x, place.y))


def test_who_stops_and_goes_on_straight_is_still_on_one_run() -> None:
    """So METHOD §1 has it: a new heading error comes with a turn, or with leaving a wall."""
    bench = Bench(5, SOUND)
    bench.run(1.0)
    set_out = bench.heading_deg
    assert set_out != 0
    bench.run(1.0)
    assert bench.heading_deg == set_out
    bench.turn(90)
    turned = bench.heading_deg
    bench.run(1.0)
    assert bench.heading_deg != turned


def test_a_robot_with_a_wrong_scale_logs_too_short_or_too_long() -> None:
    bench = Bench(1, Faults(turn_bias=0.0, drift=0.0, scale=1.25), along=0.0, across=0.0)
    bench.run(5.0)
    assert bench.body.place.x == pytest.approx(5.0)
    assert bench.steering.book.belief.logged.x == pytest.approx(4.0)
    settings = MissionSettings(scale_sd=0.02)
    scales = [draw_faults(settings, np.random.default_rng(k)).scale for k in range(400)]
    assert has_sd(np.array(scales) - 1, 0.02)


def test_calibrated_robots_log_their_measured_bias_and_others_nothing() -> None:
    errors = []
    for seed in range(200):
        mission = drive(hall(4, 4), robots=1, minutes=0.01, seed=seed)
        (outing,) = mission.robots[0].excursions
        model = outing.book.as_log()["model"]
        assert set(model) == {"turn_bias", "turn_spread", "turn_noise", "sensor"}
        assert model["turn_spread"] == 0.5
        assert model["turn_noise"] == pytest.approx(0.3 * 2.236, abs=1e-3)  # a half-width
        errors.append(model["turn_bias"] - mission.robots[0].faults.turn_bias)
    assert has_sd(np.array(errors), 0.19)
    wild = drive(hall(4, 4), robots=1, minutes=0.01, calibrated=False)
    assert "model" not in wild.robots[0].excursions[0].book.as_log()
    more = drive(hall(4, 4), robots=1, minutes=0.01, drift=2.0, scale_sd=0.02, along=0.02)
    model = more.robots[0].excursions[0].book.as_log()["model"]
    faults = more.robots[0].faults
    assert (model["drift"], model["scale"], model["along"]) == (
        pytest.approx(faults.drift, abs=1e-3), pytest.approx(faults.scale, abs=1e-5), 0.02,
    )  # fmt: skip
