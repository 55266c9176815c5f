"""The error model: what is known is corrected, what is unknown grows (METHOD §1, paper §3).

Errors grow here as the estimator ``linear`` says; ``heading`` has tests of its own.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.correction import CorrectedStretch, correct
from possmap.core.linear import LinearError
from possmap.core.model import ErrorModel
from possmap.core.propagation import PoseError, propagate
from possmap.core.records import Pose, Record, Wall
from possmap.core.track import stretches, waiting, wrap_degrees

PAPER = ErrorModel()
metres = st.floats(-20, 20)
degrees = st.floats(-720, 720)
models = st.builds(
    ErrorModel,
    along=st.floats(0, 0.1),
    across=st.floats(0, 0.1),
    turn_bias=st.floats(-3, 3),
    turn_gain=st.floats(-0.05, 0.05),
    turn_spread=st.floats(0, 5),
    drift=st.floats(-4, 4),
    drift_spread=st.floats(0, 2),
    scale=st.floats(0.9, 1.1),
    alignment_spread=st.floats(0, 3),
)


def poses(*places: tuple[float, float, float]) -> list[Record]:
    return [Pose(seq, None, *place) for seq, place in enumerate(places)]


@st.composite
def tracks(draw: st.DrawFn) -> list[Record]:
    """Draw runs, turns and standstills, some along followed walls."""
    records: list[Record] = []
    for x, y, heading in draw(st.lists(st.tuples(metres, metres, degrees), min_size=1)):
        if records and draw(st.booleans()):
            records.append(Wall(len(records), None, x, y, x, y, draw(st.booleans())))
        records.append(Pose(len(records), None, x, y, heading))
    return records


def run(records: list[Record], model: ErrorModel) -> tuple[list[CorrectedStretch], PoseError]:
    track = correct(stretches(records), model)
    first = records[0]
    assert isinstance(first, Pose)
    start = LinearError.at_start(first)
    errors = propagate(start, track, model)
    return track, errors[-1].after if errors else start


def test_a_known_drift_bends_a_run_into_an_arc_and_its_chord_is_shorter() -> None:
    track, _ = run(poses((0, 0, 0), (10, 0, 0)), ErrorModel(drift=1))
    assert track[0].end == pytest.approx((9.949, 0.870), abs=1e-3)
    assert track[0].heading_deg == pytest.approx(10)


@given(st.integers(1, 100), st.floats(-4, 4), st.floats(0.9, 1.1))
def test_one_run_and_many_pieces_of_it_end_at_one_place(n: int, drift: float, scale: float) -> None:
    model = ErrorModel(drift=drift, scale=scale)
    whole, _ = run(poses((0, 0, 0), (10, 0, 0)), model)
    pieces, _ = run(poses(*((10 * k / n, 0, 0) for k in range(n + 1))), model)
    assert pieces[-1].end == pytest.approx(whole[-1].end, abs=1e-9)


@given(st.integers(1, 50), st.floats(0, 2), st.floats(0, 30))
def test_one_run_and_many_pieces_of_it_end_with_one_rectangle(
    n: int, drift_spread: float, error_heading: float
) -> None:
    model = ErrorModel(drift_spread=drift_spread)
    start = Pose(0, None, 0, 0, 0, error_heading_deg=error_heading)
    _, whole = run([start, Pose(1, None, 6, 8, 0)], model)
    steps: list[Record] = [Pose(k, None, 6 * k / n, 8 * k / n, 0) for k in range(1, n + 1)]
    _, pieces = run([start, *steps], model)
    assert pieces.rectangle.half_x == pytest.approx(whole.rectangle.half_x)
    assert pieces.rectangle.half_y == pytest.approx(whole.rectangle.half_y)
    assert pieces.heading_half == pytest.approx(whole.heading_half)


def test_a_robot_biased_to_the_left_turns_47_left_and_43_right_when_asked_for_45() -> None:
    model = ErrorModel(turn_bias=2)
    left, _ = run(poses((0, 0, 0), (0, 0, 45)), model)
    right, _ = run(poses((0, 0, 0), (0, 0, -45)), model)
    assert left[-1].heading_deg == pytest.approx(47)
    assert right[-1].heading_deg == pytest.approx(-43)


def test_ten_feet_straight_grow_the_papers_rectangle() -> None:
    _, error = run(poses((0, 0, 0), (3.048, 0, 0)), PAPER)
    assert 2 * error.rectangle.half_x / 0.0254 == pytest.approx(2.5)
    assert 2 * error.rectangle.half_y / 0.0254 == pytest.approx(11)


@given(tracks(), models)
def test_half_widths_never_shrink(records: list[Record], model: ErrorModel) -> None:
    first = records[0]
    assert isinstance(first, Pose)
    start = LinearError.at_start(first)
    errors = propagate(start, correct(stretches(records), model), model)
    before = start.rectangle
    for error in errors:
        assert error.start == before
        assert error.end.half_x >= before.half_x and error.end.half_y >= before.half_y
        assert 0 <= error.heading_half <= math.pi / 2
        before = error.end


@given(st.floats(0, 3), st.floats(0, 3), st.floats(0.1, 20))
def test_along_a_followed_wall_the_error_across_it_stays(
    error_x: float, error_y: float, distance: float
) -> None:
    records: list[Record] = [
        Pose(0, None, 0, 0, 0, error_x, error_y, 20),
        Wall(1, None, 0, 0.1, distance, 0.1),
        Pose(2, None, distance, 0, 0),
    ]
    _, error = run(records, PAPER)
    assert error.rectangle.half_y == error_y
    assert error.rectangle.half_x == pytest.approx(error_x + PAPER.along * distance)
    assert error.heading_half == 0


def test_lining_up_with_a_wall_forgets_the_known_turning_error() -> None:
    records = poses((0, 0, 0), (0, 0, 90))
    records += [Wall(2, None, 0.1, 0, 0.1, 2), Pose(3, None, 0, 2, 90), Pose(4, None, 0, 4, 90)]
    track, _ = run(records, ErrorModel(turn_bias=5))
    assert track[1].along == pytest.approx((0, 1))
    assert track[2].along == pytest.approx((0, 1))


def test_at_standstill_followed_claims_nothing() -> None:
    records = poses((0, 0, 0), (0, 0, 90))
    records += [Wall(2, None, 0.1, 0, 0.1, 2), Pose(3, None, 0, 0, 90)]
    _, error = run(records, PAPER)
    assert math.degrees(error.heading_half) == pytest.approx(4)


@given(st.floats(-1e4, 1e4))
def test_turns_are_wrapped_and_a_half_turn_is_a_left_turn(angle: float) -> None:
    wrapped = wrap_degrees(angle)
    assert -180 < wrapped <= 180
    assert math.isclose(math.cos(math.radians(wrapped - angle)), 1, abs_tol=1e-9)
    assert wrap_degrees(-180 + 5e-7) == 180 == wrap_degrees(180 - 5e-7) == wrap_degrees(540)


@given(st.floats(0, 100), degrees)
def test_the_headings_half_width_stops_at_a_right_angle(spread: float, turn: float) -> None:
    error = LinearError.at_start(Pose(0, None, 0, 0, 0))
    for _ in range(50):
        error = error.after_turn(wrap_degrees(turn), ErrorModel(turn_spread=spread))
    assert error.heading_half <= math.pi / 2


def test_what_follows_the_last_pose_waits() -> None:
    wall = Wall(2, None, 0, 1, 1, 1)
    records = [*poses((0, 0, 0), (1, 0, 0)), wall]
    assert waiting(records) == [wall]
    assert [stretch.seen for stretch in stretches(records)] == [()]
    longer = stretches([*records, Pose(3, None, 2, 0, 0)])
    assert longer[-1].seen == ((2, wall),)
