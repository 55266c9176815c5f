"""Whatever the trials are, a calibration gives a sound model or says why it gives none."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from possmap.cli.calibrate import to_json, to_text
from possmap.core.model import ErrorModel
from possmap.lab.calibrate.report import sheet
from possmap.lab.calibrate.robots import calibrate
from possmap.lab.calibrate.trials import Trial

pytestmark = pytest.mark.thorough


@st.composite
def some_trials(draw: st.DrawFn) -> list[Trial]:
    seed = draw(st.integers(0, 2**31))
    rng = np.random.default_rng(seed)
    size = draw(st.sampled_from([1e-9, 1e-3, 0.05, 0.4]))
    told = draw(st.sampled_from([0.0, 0.5, 1.0]))
    distances = draw(st.lists(st.sampled_from([0.0, 0.1, 0.5, 1.0, 3.0, 30.0]), min_size=1))
    turns = draw(
        st.lists(st.sampled_from([0.0, 5.0, 45.0, -45.0, 180.0, -180.0, 400.0]), min_size=1)
    )
    outings = draw(st.integers(1, 6))
    found = []
    for k in range(draw(st.integers(1, 24))):
        distance, turn = distances[k % len(distances)], turns[k % len(turns)]
        along, across = distance * size * rng.standard_normal(2)
        heading = 50 * size * float(rng.standard_normal())
        measured = distance < 0.2 or rng.random() < told
        found.append(
            Trial(
                f"r{k % draw(st.integers(1, 3))}", f"{k % outings}", distance, turn,
                float(along), float(across), heading if measured else math.nan,
            )
        )  # fmt: skip
    return found


@settings(max_examples=30, deadline=None)
@given(some_trials())
def test_a_sound_model_comes_of_them_or_a_reason(some: list[Trial]) -> None:
    found = calibrate(some, np.random.default_rng(1))
    assert len(found.robots) + len(found.refused) == len({one.robot for one in some})
    assert all(found.refused.values())
    for one in (*found.robots, *([found.pooled] if found.pooled else [])):
        ErrorModel(**one.parameters)
        for name, told in one.estimates.items():
            if math.isfinite(told.value):
                assert told.low <= told.value <= told.high, name
    text = to_text(to_json(found, Path("model.yaml")))
    assert "NaN" not in text and json.loads(text)["robots"].keys() == {
        one.robot for one in found.robots
    }
    if found.robots:
        sheet(found)
