"""The heading from right angles: the smoother is the best estimate, and finds what was put in."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from possmap.lab.convert.orthogonal import (
    GATE,
    PROCESS,
    QUARTER,
    Alignment,
    Bearing,
    align,
)

DEG = math.pi / 180


def told(ways: list[float], error_deg: list[float], axis_deg: float, leg: int = 0) -> list[Bearing]:
    """Return walls on alternating axes as a robot with these heading errors sees them."""
    return [
        Bearing(leg, way, (axis_deg + 90 * (k % 2) + error) * DEG, 1.5)
        for k, (way, error) in enumerate(zip(ways, error_deg, strict=True))
    ]


def aligned(bearings: list[Bearing]) -> Alignment:
    found = align(bearings)
    assert found is not None
    return found


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.1, 4), st.floats(-4, 4)), min_size=1, max_size=12),
    st.floats(-40, 40),
    st.integers(0, 12),
)
def test_the_smoother_is_the_least_squares_of_all_walls_at_once(
    steps: list[tuple[float, float]], axis_deg: float, second_leg: int
) -> None:
    """A dense system over all errors and the axis: what the filter and smoother shorten."""
    legs = [0 if k < second_leg else 1 for k in range(len(steps))]
    ways, so_far = [], {0: 0.0, 1: 0.0}
    for (step, _), leg in zip(steps, legs, strict=True):
        so_far[leg] += step
        ways.append(so_far[leg])
    errors = [error for _, error in steps]
    bearings = [
        Bearing(leg, way, (axis_deg + error) * DEG, 1.5)
        for leg, way, error in zip(legs, ways, errors, strict=True)
    ]
    found = aligned(bearings)
    if not all(one.used for one in found.walls):
        return
    count = len(steps)
    rows, sides, weights = [], [], []
    for k, one in enumerate(bearings):
        row = np.zeros(count + 1)
        row[k] = row[count] = 1
        rows.append(row)
        sides.append(axis_deg * DEG + errors[k] * DEG)
        weights.append(1 / math.sqrt(one.variance))
        walk = np.zeros(count + 1)
        walk[k] = 1
        before = 0.0
        if k and bearings[k - 1].leg == one.leg:
            walk[k - 1] = -1
            before = bearings[k - 1].way
        rows.append(walk)
        sides.append(0.0)
        weights.append(1 / math.sqrt(PROCESS * (one.way - before)))
    w = np.array(weights)
    best, *_ = np.linalg.lstsq(np.array(rows) * w[:, None], np.array(sides) * w, rcond=None)
    for k, one in enumerate(bearings):
        assert found.error_at(one.leg, one.way) == pytest.approx(best[k], abs=2e-3)
    assert math.remainder(found.axis - best[count], QUARTER) == pytest.approx(0, abs=2e-3)


def test_the_buildings_axes_may_lie_askew() -> None:
    found = aligned(told([1, 2, 3, 4, 5], [0] * 5, 33))
    assert math.degrees(found.axis) % 90 == pytest.approx(33, abs=0.6)


def test_a_wall_askew_tells_nothing_and_is_reported() -> None:
    bearings = told([1, 2, 3, 4, 5], [0] * 5, 0)
    bearings.insert(3, Bearing(0, 3.5, 45 * DEG, 2.0))
    found = aligned(bearings)
    assert [one.used for one in found.walls] == [True, True, True, False, True, True]
    assert abs(found.walls[3].off) > GATE
    assert found.share == pytest.approx(5 / 6)
    assert max(abs(found.error_at(0, way)) for way in (1, 2, 3, 4, 5)) < 0.1 * DEG


def test_the_spread_of_walls_is_measured() -> None:
    rng = np.random.default_rng(6)
    ways = [0.5 * k for k in range(1, 801)]
    found = aligned(told(ways, rng.normal(0, 4, len(ways)).tolist(), 0))
    assert math.degrees(found.spread) == pytest.approx(4, rel=0.15)
    few = aligned(told([1, 2], [1, -1], 0))
    assert math.isnan(few.spread)
