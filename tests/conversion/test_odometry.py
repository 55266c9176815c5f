"""Known errors taken out sample by sample, as the method takes them out run by run."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conversion.drives import samples
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.correction import correct
from possmap.core.model import ErrorModel
from possmap.core.records import Pose
from possmap.core.track import stretches
from possmap.lab.convert.legs import Laying

legs = st.lists(st.tuples(st.floats(0.1, 3), st.floats(-120, 120)), min_size=1, max_size=12)
models = st.builds(
    ErrorModel,
    drift=st.floats(-4, 4),
    turn_gain=st.floats(-0.1, 0.1),
    scale=st.floats(0.9, 1.1),
)


def corners(track: list[tuple[float, float]]) -> tuple[list[float], list[float], list[float]]:
    x, y, heading = [0.0], [0.0], [0.0]
    for length, turn in track:
        x.append(x[-1] + length * math.cos(math.radians(heading[-1])))
        y.append(y[-1] + length * math.sin(math.radians(heading[-1])))
        heading.append(heading[-1] + turn)
    return x, y, heading


@given(legs, models)
def test_a_sample_at_each_corner_is_laid_where_the_method_lays_the_pose(
    track: list[tuple[float, float]], model: ErrorModel
) -> None:
    x, y, heading = corners(track)
    found, _ = Laying(model).lay(samples(x, y, heading))
    records = [Pose(k, None, *pose) for k, pose in enumerate(zip(x, y, heading, strict=True))]
    laid = correct(stretches(records), model)
    assert found.x[1:] == pytest.approx([one.end[0] for one in laid], abs=1e-9)
    assert found.y[1:] == pytest.approx([one.end[1] for one in laid], abs=1e-9)
    assert np.degrees(found.yaw[1:]) == pytest.approx([one.heading_deg for one in laid], abs=1e-6)


@given(legs, models, st.integers(1, 11))
def test_pieces_are_laid_as_the_whole(
    track: list[tuple[float, float]], model: ErrorModel, cut: int
) -> None:
    given_track = samples(*corners(track))
    whole, way = Laying(model).lay(given_track)
    laying = Laying(model)
    parts = [given_track.part(0, cut), given_track.part(cut)]
    laid = [laying.lay(part) for part in parts if len(part)]
    assert np.concatenate([part.x for part, _ in laid]) == pytest.approx(whole.x, abs=1e-9)
    assert np.concatenate([part.yaw for part, _ in laid]) == pytest.approx(whole.yaw, abs=1e-9)
    assert np.concatenate([far for _, far in laid]) == pytest.approx(way, abs=1e-9)


def test_ten_metres_at_one_degree_a_metre_end_where_the_method_says() -> None:
    found, way = Laying(ErrorModel(drift=1)).lay(samples(np.linspace(0, 10, 101), np.zeros(101)))
    assert (found.x[-1], found.y[-1]) == pytest.approx((9.949, 0.870), abs=1e-3)
    assert math.degrees(found.yaw[-1]) == pytest.approx(10)
    assert way[-1] == pytest.approx(10)
