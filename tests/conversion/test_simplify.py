"""The simplified track: never farther off than it may be, and nothing driven is lost."""

from __future__ import annotations

import math

import numpy as np
from conversion.drives import samples
from hypothesis import given
from hypothesis import strategies as st

from possmap.lab.convert.samples import Samples
from possmap.lab.convert.simplify import outline

WIDE = math.radians(1e6)

steps = st.lists(
    st.tuples(
        st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-170, 170), st.sampled_from([1, 1, 0])
    ),
    min_size=1,
    max_size=60,
)


def wandering(moves: list[tuple[float, float, float, int]]) -> Samples:
    x, y = (np.cumsum([0.0] + [move[k] * move[3] for move in moves]) for k in (0, 1))
    return samples(x, y, np.cumsum([0.0] + [move[2] for move in moves]))


def off(point: tuple[float, float], ends: tuple[float, float, float, float]) -> float:
    """Return a point's distance from a segment, computed step by step."""
    (px, py), (x0, y0, x1, y1) = point, ends
    length2 = (x1 - x0) ** 2 + (y1 - y0) ** 2
    share = 0.0
    if length2:
        share = ((px - x0) * (x1 - x0) + (py - y0) * (y1 - y0)) / length2
    share = min(1.0, max(0.0, share))
    return math.hypot(px - x0 - share * (x1 - x0), py - y0 - share * (y1 - y0))


@given(steps, st.sampled_from([0.02, 0.05, 0.2]), st.sampled_from([5.0, 30.0]))
def test_no_sample_lies_farther_from_its_run_than_the_tolerance(
    moves: list[tuple[float, float, float, int]], tolerance: float, turn_deg: float
) -> None:
    track = wandering(moves)
    found = outline(track, tolerance, math.radians(turn_deg))
    for run in range(len(found.index) - 1):
        ends = found.x[run], found.y[run], found.x[run + 1], found.y[run + 1]
        for sample in range(found.index[run], found.index[run + 1] + 1):
            place = float(track.x[sample]), float(track.y[sample])
            assert off(place, ends) <= tolerance


@given(steps, st.sampled_from([5.0, 30.0]))
def test_the_body_never_looks_farther_aside_than_the_tolerance(
    moves: list[tuple[float, float, float, int]], turn_deg: float
) -> None:
    track = wandering(moves)
    found = outline(track, 0.05, math.radians(turn_deg))
    told = np.interp(track.t, track.t[found.index], track.yaw[found.index])
    assert np.abs(told - track.yaw).max() <= math.radians(turn_deg) + 1e-9


def test_going_back_and_forth_on_one_line_is_not_lost() -> None:
    x = [*np.arange(0, 3, 0.1), *np.arange(3, 2, -0.1), *np.arange(2, 5.01, 0.1)]
    found = outline(samples(x, np.zeros(len(x)), np.zeros(len(x))), 0.05, WIDE)
    driven = np.hypot(np.diff(found.x), np.diff(found.y)).sum()
    assert abs(driven - np.abs(np.diff(x)).sum()) < 0.01


def test_a_body_that_spins_on_the_spot_stays_on_one_place() -> None:
    rng = np.random.default_rng(2)
    x, y = 1 + rng.normal(0, 0.002, 50), rng.normal(0, 0.002, 50)
    found = outline(samples(x, y, np.linspace(0, 720, 50)), 0.05, math.radians(15))
    assert len(set(zip(found.x, found.y, strict=True))) == 1
    turned = np.diff(np.linspace(0, 720, 50)[found.index])
    assert len(found.index) >= 9 and turned.max() <= 105


def test_poses_set_for_the_bodys_heading_do_not_bend_the_run() -> None:
    count = 200
    jitter = np.random.default_rng(3).normal(0, 0.005, count)
    yaw = 40 * np.sin(np.linspace(0, 12, count))
    found = outline(samples(np.linspace(0, 10, count), jitter, yaw), 0.05, math.radians(10))
    assert len(found.index) > 5
    direction = np.arctan2(np.diff(found.y), np.diff(found.x))
    assert np.degrees(np.ptp(direction)) < 0.01
