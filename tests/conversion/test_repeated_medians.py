"""Repeated medians: the same line as a literal look at all pairs, in bounded memory."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from possmap.lab.convert.lines import MOST, repeated_medians

places = st.integers(-50, 50).map(lambda n: n / 8)
points = st.lists(st.tuples(places, places), min_size=2, max_size=12)


@settings(deadline=None)  # the first look imports scipy
@given(points)
def test_the_line_is_that_of_scipy(xy: list[tuple[float, float]]) -> None:
    """The well-kept library says the same; one function of it is not worth 35 MB to a user."""
    from scipy.stats import siegelslopes

    x, y = np.array(xy).T
    assume(len(set(x.tolist())) == len(x))  # of points of one x it makes something else
    assert repeated_medians(x, y) == pytest.approx(tuple(siegelslopes(y, x)), abs=1e-9)


def test_nearly_half_of_the_points_may_lie_anywhere() -> None:
    x = np.arange(41.0)
    y = 0.25 * x - 3
    y[1::5] += 100
    y[2::5] -= 1000
    slope, height = repeated_medians(x, y)
    assert slope == pytest.approx(0.25)
    assert height == pytest.approx(-3)


def test_very_many_points_take_bounded_memory() -> None:
    x = np.linspace(0, 1000, 40 * MOST)
    tracemalloc.start()
    slope, height = repeated_medians(x, 2 * x + 1)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert math.isclose(slope, 2)
    assert math.isclose(height, 1)
    assert peak < 100 << 20
