"""The tests of the paper's assumptions: right tables, right sizes, and what they can find."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.lab.calibrate.assumptions import (
    gap,
    independence,
    normality,
    proportionality,
    variance_ratio,
)


@pytest.mark.parametrize(
    ("count", "limit"),
    # The table of Lilliefors as computed anew by Molin and Abdi (1998), by more draws than his.
    [(5, 0.3427), (20, 0.1920), (50, 0.1246)],
)
def test_the_table_is_lilliefors_own(count: int, limit: float) -> None:
    """METHOD §6: Kolmogorov's own limit, 0.294 at n = 20, would almost never reject."""
    rng = np.random.default_rng(1)
    gaps = gap(rng.standard_normal((20000, count)))
    assert float(np.quantile(gaps, 0.95)) == pytest.approx(limit, abs=0.004)
    assert count != 20 or (gaps > 0.294).mean() < 0.0005
    told = normality(rng.standard_normal(count), rng)
    assert told is not None
    assert told.p == pytest.approx(float((gaps >= told.distance).mean()), abs=0.02)


def test_power_is_what_repetitions_show() -> None:
    rng = np.random.default_rng(4)
    told = normality(rng.standard_normal(40), rng)
    assert told is not None and told.p > 0.05
    limit = np.quantile(gap(rng.standard_normal((10000, 40))), 0.95)
    found = (gap(rng.standard_t(3, (2000, 40))) > limit).mean()
    assert told.power_tails == pytest.approx(float(found), abs=0.06)
    assert told.power_tails > 0.25
    exponential = normality(rng.standard_exponential(100), rng)
    assert exponential is not None and exponential.p < 0.01


def test_too_few_errors_and_errors_without_variance_are_not_tested() -> None:
    rng = np.random.default_rng(6)
    assert normality(np.arange(3.0), rng) is None
    assert normality(np.full(20, 0.125), rng) is None
    assert independence(np.zeros(20), np.arange(20.0)) is None
    assert proportionality(np.ones(20), np.full(20, 3.0)) is None, "one distance"
    assert proportionality(np.zeros(20), np.arange(1.0, 21.0)) is None


def test_independent_axes_and_those_that_hang_together_are_told_apart() -> None:
    rng = np.random.default_rng(7)
    one, other = rng.standard_normal((2, 60))
    apart, together = independence(one, other), independence(one, one + other)
    assert apart is not None and apart.p > 0.05 and apart.low < 0 < apart.high
    assert together is not None and together.p < 0.001 and together.low > 0.4
    # Fisher: 2.8 standard errors of z, 1/sqrt(57) each.
    assert apart.detectable == pytest.approx(math.tanh(2.802 / math.sqrt(57)), abs=1e-3)


def test_large_errors_that_come_together_are_found_though_not_correlated() -> None:
    rng = np.random.default_rng(8)
    size = np.exp(rng.standard_normal(200))
    told = independence(*(size * rng.standard_normal((2, 200))))
    assert told is not None and told.sizes_p < 0.001


@pytest.mark.parametrize("power", [0.5, 1.0, 1.5])
def test_the_growth_with_distance_is_found(power: float) -> None:
    rng = np.random.default_rng(10)
    distance = np.tile([1.0, 3.0, 9.0], 40)
    held = 0
    for _ in range(60):
        told = proportionality(0.02 * distance**power * rng.standard_normal(120), distance)
        assert told is not None
        held += told.low <= power <= told.high
        assert power == 1 or told.p < 0.05
    assert held >= 53


@given(st.floats(1e-6, 1e3), st.integers(0, 2**31))
def test_growth_has_no_unit(unit: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    distance = rng.uniform(0.5, 10, 30)
    errors = 0.1 * distance * rng.standard_normal(30)
    one, other = proportionality(errors, distance), proportionality(unit * errors, distance)
    assert one is not None and other is not None
    assert one.exponent == pytest.approx(other.exponent, abs=1e-4)


def test_what_is_taken_back_is_told_from_what_stays() -> None:
    rng = np.random.default_rng(11)
    tracks = ["one"] * 400
    free = rng.standard_normal(400)
    noise = np.diff(rng.standard_normal(401))
    slow = np.repeat(rng.standard_normal(40), 10) + 0.5 * rng.standard_normal(400)
    independent, back, together = (variance_ratio(e, tracks) for e in (free, noise, slow))
    assert independent is not None and independent.widening == 1.0
    assert back is not None and back.share < 0.3 and back.widening < 0.6
    assert together is not None and together.share > 4 and together.widening > 2
    assert variance_ratio(free[:70], tracks[:70]) is None, "too few"
    assert variance_ratio(free, [""] * 400) is None, "of no track"
