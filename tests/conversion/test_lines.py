"""Walls fitted to what beams saw: outliers do not bend them, gaps and corners end them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conversion.drives import SIDES, drive, samples
from hypothesis import given, settings
from hypothesis import strategies as st

from possmap.lab.convert.corners import corners
from possmap.lab.convert.hits import hits, without_echoes
from possmap.lab.convert.lines import FittedWall, fitted, walls_of
from possmap.lab.convert.samples import Floats, Ints, Mount, Samples, off_segment
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.convert.tally import Tally

SETTINGS = ConvertSettings()
RIGHT, AHEAD, LEFT = 0, 1, 2


def walls_in(track: Samples, beam: int) -> tuple[list[FittedWall], Ints]:
    return walls_of(hits(track, SIDES, SETTINGS.reach)[beam], track, SETTINGS)


def all_walls(track: Samples) -> list[FittedWall]:
    return [wall for beam in range(len(SIDES)) for wall in walls_in(track, beam)[0]]


def past(ranges: Floats) -> Samples:
    """Return a run along +x whose left beam reads the given ranges, every 5 cm."""
    read = np.full((len(ranges), 3), np.nan)
    read[:, LEFT] = ranges
    return samples(
        0.05 * np.arange(len(ranges)), np.zeros(len(ranges)), np.zeros(len(ranges)), read
    )


@settings(deadline=None)  # the first fit imports scipy
@given(
    st.floats(-math.pi, math.pi),
    st.lists(st.floats(-0.02, 0.02), min_size=7, max_size=30),
    st.data(),
)
def test_a_line_keeps_to_its_points_though_a_third_of_them_lie_far_off(
    angle: float, noise: list[float], data: st.DataObject
) -> None:
    count = len(noise)
    along, off = 0.1 * np.arange(count), np.array(noise)
    far = data.draw(st.lists(st.integers(1, count - 2), max_size=(count - 1) // 3, unique=True))
    off[far] = 0.8
    cos, sin = math.cos(angle), math.sin(angle)
    points = np.column_stack([along * cos - off * sin, along * sin + off * cos])
    line = fitted(points)
    good = np.setdiff1d(np.arange(count), far)
    assert line.off(points[good]).max() < 0.16
    assert line.dx * cos + line.dy * sin > 0.9


def test_a_wall_to_the_left_is_found_as_long_as_it_was_seen() -> None:
    (wall,), loose = walls_in(past(np.full(41, 0.7)), LEFT)
    assert wall.point(wall.along[0]) == pytest.approx((0, 0.7)) and wall.end == pytest.approx(
        (2, 0.7)
    )
    assert not len(loose)


def test_single_wild_readings_stay_beams_and_do_not_end_the_wall() -> None:
    ranges = np.full(41, 0.7)
    ranges[[10, 20, 21]] = 1.6, 0.3, 1.9
    (wall,), loose = walls_in(past(ranges), LEFT)
    assert wall.length == pytest.approx(2) and abs(wall.angle) < 0.01
    assert loose.tolist() == [10, 20, 21]


def test_a_door_splits_the_wall_and_both_pieces_end_at_its_jambs() -> None:
    ranges = np.full(81, 0.7)
    ranges[30:50] = -np.inf
    first, second = walls_in(past(ranges), LEFT)[0]
    assert first.end == pytest.approx((1.45, 0.7)) and second.point(
        second.along[0]
    ) == pytest.approx((2.5, 0.7))
    assert first.stops


def test_scattered_readings_are_no_wall() -> None:
    rng = np.random.default_rng(5)
    walls, loose = walls_in(past(rng.uniform(0.3, 1.9, 60)), LEFT)
    assert sum(len(wall.index) for wall in walls) < 15
    assert len(loose) > 45


def test_a_wall_ahead_that_one_drives_at_is_no_line() -> None:
    read = np.full((40, 3), np.nan)
    read[:, AHEAD] = 2.2 - 0.05 * np.arange(40)
    track = samples(0.05 * np.arange(40), np.zeros(40), np.zeros(40), read)
    walls, loose = walls_in(track, AHEAD)
    assert not walls and len(loose) == 36  # four were out of reach


ROOM = [(0.0, 0.0, 4.0, 0.0), (4.0, 0.0, 4.0, 4.0)]
"""A wall below, and one to the right: a room's corner."""


def test_the_corner_of_a_room_is_concave_and_where_its_walls_meet() -> None:
    found = corners(all_walls(drive([(0.5, 0.7), (3.3, 0.7), (3.3, 3.5)], ROOM)), track_of(ROOM))
    assert [corner.kind for corner in found] == ["concave"]
    assert (found[0].x, found[0].y) == pytest.approx((4, 0), abs=0.02)


def track_of(walls: list[tuple[float, float, float, float]]) -> Samples:
    return drive([(0.5, 0.7), (3.3, 0.7), (3.3, 3.5)], walls)


def test_a_pillar_that_one_goes_around_has_a_convex_corner() -> None:
    pillar = [(0.0, 1.0, 2.0, 1.0), (2.0, 1.0, 2.0, 3.0)]
    track = drive([(0.2, 0.4), (2.6, 0.4), (2.6, 2.6)], pillar)
    (corner,) = corners(all_walls(track), track)
    assert corner.kind == "convex"
    assert (corner.x, corner.y) == pytest.approx((2, 1), abs=0.05)


def test_a_wall_that_stops_in_the_open_has_an_end() -> None:
    track = drive([(0.0, 0.0), (4.0, 0.0)], [(0.0, 0.7, 2.0, 0.7)])
    (corner,) = corners(all_walls(track), track)
    assert corner.kind == "end"
    assert (corner.x, corner.y) == pytest.approx((2, 0.7), abs=0.06)


def test_a_beam_mounted_off_the_middle_starts_where_its_sensor_is() -> None:
    read = np.array([[1.0], [1.0]])
    track = samples([0, 0], [0, 0], [90, 90], read)
    (seen,) = hits(track, [Mount(math.pi / 2, 0.1, 0.05)], 2.0)
    assert seen.start[0] == pytest.approx((-0.05, 0.1))
    assert seen.end[0] == pytest.approx((-1.05, 0.1))


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)), min_size=2, max_size=80),
    st.floats(0.3, 2),
    st.floats(-3, 3),
)
def test_echoes_are_those_of_a_literal_search(
    moves: list[tuple[float, float]], length: float, angle: float
) -> None:
    x, y = (np.cumsum([0.0] + [move[k] for move in moves]) for k in (0, 1))
    count = len(x)
    track = samples(x, y, np.zeros(count), np.full((count, 1), length), t=0.5 * np.arange(count))
    (seen,) = hits(track, [Mount(angle)], 2.0)
    left = set(without_echoes(seen, track.t[seen.index], track, 0.25, 6.0, Tally()).index.tolist())
    ends = np.minimum(np.arange(count) + 1, count - 1)
    for number, index in enumerate(seen.index.tolist()):
        px, py = seen.end[number]
        apart = off_segment(np.full(count, px), np.full(count, py), x, y, x[ends], y[ends])
        soon = np.abs(track.t - track.t[index])
        # Of what lies ahead, only what the robot has passed: it may drive up to a wall.
        way = seen.end[number] - seen.start[number]
        beyond = ((x - px) * way[0] + (y - py) * way[1]) / length
        front = abs(angle) < math.radians(45)
        if (apart[soon <= 5.4].min() < 0.22) and not front:  # but for the thinning of the track
            assert index not in left
        if apart[soon <= 7.1].min() > 0.28 or (front and beyond[soon <= 7.1].max() < -0.05):
            assert index in left
