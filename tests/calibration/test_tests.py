"""The tests of the paper's assumptions: right tables, right sizes, and what they can find."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.lab.calibrate.checks import independence, proportionality
from possmap.lab.calibrate.normality import gap, normality, null_gaps
from possmap.lab.calibrate.persistence import persistence


@pytest.mark.parametrize(
    ("count", "level", "limit"),
    # The table of Lilliefors as computed anew by Molin and Abdi (1998), by more draws than his.
    [(5, 0.05, 0.3427), (10, 0.05, 0.2616), (20, 0.05, 0.1920), (20, 0.01, 0.2226),
     (30, 0.05, 0.1590), (50, 0.05, 0.1246)],
)  # fmt: skip
def test_the_table_is_the_known_one(count: int, level: float, limit: float) -> None:
    null = null_gaps(count, np.random.default_rng(1), 20000)
    assert float(np.quantile(null, 1 - level)) == pytest.approx(limit, abs=0.004)


def test_the_plain_table_would_almost_never_reject() -> None:
    """METHOD §6: with a fitted mean and deviation, Kolmogorov's own limit at n = 20 is 0.294."""
    null = null_gaps(20, np.random.default_rng(2), 20000)
    assert (null > 0.294).mean() < 0.0005


def test_normal_errors_are_called_so_as_often_as_the_level_says() -> None:
    rng = np.random.default_rng(3)
    null = null_gaps(20, rng, 40000)
    gaps = gap(rng.standard_normal((10000, 20)))
    assert (gaps > np.quantile(null, 0.95)).mean() == pytest.approx(0.05, abs=0.01)


def test_power_is_what_repetitions_show() -> None:
    rng = np.random.default_rng(4)
    told = normality(rng.standard_normal(40), rng)
    assert told is not None and told.p > 0.05
    limit = np.quantile(null_gaps(40, rng), 0.95)
    found = (gap(rng.standard_t(3, (2000, 40))) > limit).mean()
    assert told.power_tails == pytest.approx(float(found), abs=0.06)
    assert told.power_tails > 0.25


def test_errors_of_no_normal_kind_are_found() -> None:
    rng = np.random.default_rng(5)
    told = normality(rng.standard_exponential(100), rng)
    assert told is not None and told.p < 0.01


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=30), st.floats(0.01, 100), st.floats(-5, 5)
)
def test_the_gap_knows_neither_place_nor_unit(
    errors: list[float], unit: float, shift: float
) -> None:
    values = np.array(errors)
    if values.std() < 1e-3:
        return
    assert float(gap(unit * values + shift)) == pytest.approx(float(gap(values)), abs=1e-6)


def test_too_few_errors_and_errors_without_variance_are_not_tested() -> None:
    rng = np.random.default_rng(6)
    assert normality(np.arange(3.0), rng) is None
    assert normality(np.full(20, 0.125), rng) is None
    assert independence(np.zeros(20), np.arange(20.0)) is None
    assert proportionality(np.ones(20), np.full(20, 3.0)) is None, "one distance"
    assert proportionality(np.zeros(20), np.arange(1.0, 21.0)) is None
    with pytest.raises(ValueError, match="not finite"):
        normality(np.array([0.0, 1.0, math.nan, 2.0]), rng)


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


def test_what_is_said_to_be_detectable_is_found_four_times_out_of_five() -> None:
    rng = np.random.default_rng(9)
    first = independence(*rng.standard_normal((2, 40)))
    assert first is not None
    r, found = first.detectable, 0
    for _ in range(300):
        one, other = rng.standard_normal((2, 40))
        told = independence(one, r * one + math.sqrt(1 - r * r) * other)
        found += told is not None and told.p < 0.05
    assert found / 300 == pytest.approx(0.8, abs=0.08)


@pytest.mark.parametrize("power", [0.5, 1.0, 1.5])
def test_the_growth_with_distance_is_found(power: float) -> None:
    rng = np.random.default_rng(10)
    distance = np.tile([1.0, 3.0, 9.0], 40)
    held = 0
    for _ in range(100):
        told = proportionality(0.02 * distance**power * rng.standard_normal(120), distance)
        assert told is not None
        held += told.low <= power <= told.high
        assert power == 1 or told.p < 0.05
    assert held >= 89


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
    independent, back, together = (persistence(e, tracks) for e in (free, noise, slow))
    assert independent is not None and independent.widening == 1.0
    assert back is not None and back.share < 0.3 and back.widening < 0.6
    assert together is not None and together.share > 4 and together.widening > 2
    assert persistence(free[:70], tracks[:70]) is None, "too few"
    assert persistence(free, [""] * 400) is None, "of no track"
