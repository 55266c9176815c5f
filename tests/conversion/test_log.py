"""Headings of the log: the direction of travel, and every turn that the body made."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from possmap.core.track import wrap_degrees
from possmap.lab.convert.log import LogBuilder


def poses(halts: Sequence[tuple[float, float, float]], **given: Any) -> list[dict[str, Any]]:
    builder = LogBuilder(**given)
    found = []
    for t, (x, y, yaw) in enumerate(halts):
        found += list(builder.pose(float(t), x, y, yaw, []))
    return found + list(builder.finish())


def turning(records: Sequence[dict[str, Any]]) -> float:
    headings = [record["heading"] for record in records]
    return sum(wrap_degrees(b - a) for a, b in itertools.pairwise(headings))


def test_the_heading_is_the_direction_of_travel_and_the_body_looks_aside() -> None:
    found = poses([(0, 0, 90), (1, 0, 90), (1, 2, 90), (0, 2, 90)])
    assert [record["heading"] for record in found] == [0, 90, 180, 180]
    assert {record["x_yaw"] for record in found} == {90}


def test_a_robot_that_backs_away_does_not_turn_round() -> None:
    found = poses([(0, 0, 0), (1, 0, 0), (0.5, 0, 0), (0.5, 0, 90), (0.5, -1, 90), (0.5, 1, 90)])
    assert [record["heading"] for record in found] == [0, 0, 0, 90, 90, 90]
    flown = poses([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 0)])  # always looking east
    assert [record["heading"] for record in flown] == [0, 90, 0, 90, 90]


def test_a_full_turn_on_the_spot_between_two_runs_is_told() -> None:
    halts = [(0, 0, 0), (1, 0, 0), (1, 0, 90), (1, 0, 180), (1, 0, 270), (1, 0, 360), (2, 0, 360)]
    assert round(turning(poses(halts)), 6) == 360
    back = [(x, y, -yaw) for x, y, yaw in halts]
    assert round(turning(poses(back)), 6) == -360


def test_a_spin_before_the_first_run_and_after_the_last_is_told() -> None:
    before = [(0, 0, -180), (0, 0, -90), (0, 0, 0), (1, 0, 0)]
    assert [record["heading"] for record in poses(before)] == [180, -90, 0, 0]
    after = [(0, 0, 0), (1, 0, 0), (1, 0, 90), (1, 0, 180)]
    assert [record["heading"] for record in poses(after)] == [0, 0, 90, 180]


@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3), st.integers(-720, 720))))
def test_every_pose_is_written_once_in_order_and_runs_go_along_where_the_pose_before_looks(
    halts: list[tuple[int, int, int]],
) -> None:
    found = poses([(float(x), float(y), float(yaw)) for x, y, yaw in halts])
    assert [(record["x"], record["y"]) for record in found] == [(x, y) for x, y, _ in halts]
    assert [record["seq"] for record in found] == list(range(len(halts)))
    for one, other in itertools.pairwise(found):
        dx, dy = other["x"] - one["x"], other["y"] - one["y"]
        if dx or dy:
            direction = math.degrees(math.atan2(dy, dx))
            assert abs(math.remainder(one["heading"] - direction, 180)) < 0.011


def test_the_first_pose_has_the_errors_of_the_start_and_no_other() -> None:
    found = poses([(0, 0, 0), (1, 0, 0)], errors=(0.1, 0.0, 3.0))
    assert (found[0]["error_x"], found[0]["error_heading"]) == (0.1, 3.0)
    assert "error_y" not in found[0] and "error_x" not in found[1]
