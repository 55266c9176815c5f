"""Limits hold the true parameters as often as they say; rectangles hold new runs likewise."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from calibrated import FACTOR, PAPER, SPINS, Faults, hold, trials

from possmap.lab.calibrate.estimates import estimates
from possmap.lab.calibrate.heading import TERMS
from possmap.lab.calibrate.model import fit_model, limit_factor, rectangle_factor

pytestmark = pytest.mark.thorough

REPETITIONS = 200
LEAST = 0.95 - 3 * math.sqrt(0.95 * 0.05 / REPETITIONS)
"""Three standard errors of a share of so many repetitions below 95 %."""


def test_a_new_run_of_20_trials_needs_2_487_deviations_not_2_236() -> None:
    assert round(rectangle_factor(20), 3) == 2.487
    assert round(limit_factor(), 3) == 2.236
    assert rectangle_factor(10**7) == pytest.approx(limit_factor(), abs=1e-5)
    assert all(rectangle_factor(n) > rectangle_factor(n + 1) for n in range(2, 60))
    with pytest.raises(ValueError, match="trials, found 1, expected at least 2"):
        rectangle_factor(1)


@pytest.mark.parametrize("count", [5, 20])
def test_rectangles_of_few_trials_hold_95_percent_of_new_runs(count: int) -> None:
    """Straight from the definition: deviations of n runs, one more run, both axes."""
    rng = np.random.default_rng(3)
    seen = rng.standard_normal((20000, 2, count))
    new = rng.standard_normal((20000, 2))
    off = np.abs(new - seen.mean(axis=2))
    held = (off <= rectangle_factor(count) * seen.std(axis=2, ddof=1)).all(axis=1).mean()
    asymptotic = (off <= limit_factor() * seen.std(axis=2, ddof=1)).all(axis=1).mean()
    assert held == pytest.approx(0.95, abs=0.006)
    assert asymptotic < 0.935, "the factor of endlessly many trials is too small"


def test_limits_hold_the_true_parameters_as_often_as_they_say() -> None:
    """200 repetitions of the paper's trials of one robot."""
    rng, faults, held = np.random.default_rng(11), Faults(), Counter[str]()
    names = ("along", "across", "turn_bias", "turn_gain", "turn_noise", "drift", "scale")
    coverage = []
    for _ in range(REPETITIONS):
        fit = fit_model(trials(faults, rng))
        found = estimates(fit, fit)
        held.update(n for n in names if found[n].low <= getattr(faults, n) <= found[n].high)
        new = trials(faults, rng, 5)
        coverage.append(hold(new, fit.model, "heading").score.coverage)
    for name in names:
        assert held[name] / REPETITIONS >= LEAST, name
    for name in ("along", "turn_bias", "drift", "scale"):
        assert held[name] < REPETITIONS, f"{name}: limits that always hold say nothing"
    assert float(np.mean(coverage)) == pytest.approx(0.95, abs=0.015)


def outings_held(repetitions: int, seed: int) -> Counter[str]:
    """Return how often limits held for a robot whose faults differ from outing to outing."""
    rng, held = np.random.default_rng(seed), Counter[str]()
    faults = Faults(turn_spread=1.5, drift_spread=0.8)
    for _ in range(repetitions):
        fit = fit_model(trials(faults, rng, 12, PAPER + SPINS[:2], outings=True)).heading
        for name, limits in (
            ("turn_bias", fit.effect_interval("turn_bias")),
            ("drift", fit.effect_interval("drift")),
            ("turn_spread", fit.deviation_interval("outing_turn")),
            ("drift_spread", fit.deviation_interval("outing_drift")),
        ):
            unit = FACTOR if name.endswith("spread") else 1.0
            held[name] += unit * limits.low <= getattr(faults, name) <= unit * limits.high
    return held


def test_limits_hold_what_differs_from_outing_to_outing() -> None:
    """In 30 repetitions; tests/benchmarks/calibration.py has 200."""
    held = outings_held(30, 13)
    assert all(count >= 25 for count in held.values()), held


def test_a_part_that_is_not_taken_as_known_goes_into_its_spread() -> None:
    some = trials(Faults(), np.random.default_rng(5))
    full = fit_model(some)
    without = fit_model(some, set(TERMS) - {"drift", "turn_bias"})
    assert {"drift", "turn_bias"} & without.parameters.keys() == set()
    assert without.parameters["drift_spread"] > 2 * abs(full.parameters["drift"])
    assert without.parameters["turn_spread"] > 2 * abs(full.parameters["turn_bias"])
    held = hold(some, without.model, "heading").inside(0, 1)
    assert held.mean() >= 0.95


def test_the_papers_own_model_has_a_rectangle_and_one_side_only() -> None:
    found = fit_model(trials(Faults(), np.random.default_rng(6)), papers=True).parameters
    assert found.keys() == {"along", "across", "factor", "turn_bias", "turn_spread"}


def test_turns_to_one_side_cannot_tell_the_two_kinds_of_over_turn_apart() -> None:
    some = trials(Faults(), np.random.default_rng(7), plan=((3.0, 0.0), (3.0, 45.0)))
    fit = fit_model(some).heading
    assert "turn_gain" not in fit.effects and not fit.sides
    both = fit.effect_interval("turn_bias")
    assert both.low <= 2.0 + 0.01 * 45 <= both.high


def test_a_half_turn_keeps_its_side() -> None:
    """A log does not tell the side of a half turn; a trial does."""
    faults = Faults(turn_gain=0.05, turn_noise=0.1, drift=0.0)
    some = trials(faults, np.random.default_rng(8), plan=PAPER + SPINS)
    told = hold(some, fit_model(some).model, "heading").inside(2)
    assert np.nanmean(told) > 0.9
