"""The report of an evaluation, and the charts that it is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from possmap.core.lattice import Window
from possmap.lab.evaluate.report import COLOURS, report
from possmap.lab.evaluate.results import Evaluation, GridScore
from possmap.lab.evaluate.scores import Curve, MethodScore
from possmap.lab.evaluate.tracks import Rectangles, TrackErrors
from possmap.lab.evaluate.validity import Bin
from possmap.pictures import palettes
from possmap.pictures.charts import Axis, Chart, Mark, Series

RED = (200, 0, 0)
UNIT = Axis("x", 0, 1)


def plot_area(picture: Image.Image) -> tuple[int, int, int, int]:
    """Return the frame of a chart: the long lines in its colour."""
    pixels = np.asarray(picture)
    frame = (pixels == palettes.FAINT).all(axis=2)
    rows = np.flatnonzero(frame.sum(axis=1) > picture.width / 2)
    columns = np.flatnonzero(frame.sum(axis=0) > picture.height / 3)
    return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])


@pytest.mark.parametrize("mark", ["disc", "square", "triangle"])
@pytest.mark.parametrize("at", [(0.25, 0.5), (0.7, 0.1), (0.05, 0.9)])
def test_a_point_lies_where_the_axes_say(mark: Mark, at: tuple[float, float]) -> None:
    chart = Chart("one point", UNIT, UNIT, [Series("", [at], RED, mark, radii=[5.0])])
    picture = chart.drawn((400, 300), 0)
    left, top, right, bottom = plot_area(picture)
    rows, columns = np.nonzero((np.abs(np.asarray(picture, dtype=int) - RED) < 60).all(axis=2))
    x = left + at[0] * (right - left)
    y = bottom - at[1] * (bottom - top)
    assert (columns.mean(), rows.mean()) == pytest.approx((x, y), abs=2.5)


def test_what_lies_beyond_the_axes_is_drawn_at_their_ends_and_nothing_outside() -> None:
    outside = [(-5.0, 9.0), (7.0, -3.0)]
    picture = Chart("", UNIT, UNIT, [Series("", outside, RED, line=False)]).drawn((400, 300), 0)
    left, top, right, bottom = plot_area(picture)
    rows, columns = np.nonzero((np.asarray(picture) == RED).all(axis=2))
    assert len(rows) and rows.min() >= top and rows.max() <= bottom
    assert columns.min() >= left and columns.max() <= right


def method(value: float | None) -> MethodScore:
    curve = Curve(np.array([0.4, 0.8]), np.array([1, 0.5]), np.array([0.6, 0.6]))
    whole = None if value is None else curve
    return MethodScore(*[value] * 5, 0.2, 0.6, *[value] * 3, whole)  # type: ignore[arg-type]


def evaluation(value: float | None = 0.5, names: tuple[str, ...] = ("possmap",)) -> Evaluation:
    bins = tuple(
        Bin(k / 10, k / 10 + 0.1, 10 * k + 1, k / 10 + 0.05, 0.1, 0.2, 0.5, 0.9) for k in range(10)
    )
    ramp = np.linspace(0, 1, 60)
    track = TrackErrors("r1", "a", ramp / 3, ramp / 4, ramp, ramp)
    known = value is not None
    grid = GridScore(
        value, 0.7, 0.05, 0.02, 0.01, bins, bins, (track,) if known else (),
        Rectangles(0.95, 0.3, 60) if known else None, value, value,
    )  # fmt: skip
    return Evaluation(
        window=Window(0, 10, 0, 10),
        resolution=0.05,
        base_rate=0.5,
        mask_cells=100,
        wall_cells=10,
        methods={name: method(value) for name in (*names, "bayes", "bayes-smeared")},
        grids=dict.fromkeys(names, grid),
        all_wall_f1_15cm=value,
        true_pose_f1_15cm=value,
        walls=np.array([[0.0, 0.0, 1.0, 0.0]]),
        notes=() if known else ("no true tracks: no rectangles, and no score at true poses",),
    )


MAPS = Image.new("RGB", (900, 400), palettes.UNKNOWN)


def test_the_report_stands_below_the_maps_and_comes_out_the_same_each_time() -> None:
    picture = report(evaluation(), MAPS)
    assert picture.width >= 1500 and picture.height > MAPS.height + 900
    assert picture.crop((0, 0, *MAPS.size)).tobytes() == MAPS.tobytes()
    assert report(evaluation(), MAPS).tobytes() == picture.tobytes()


def test_every_method_has_its_row_and_colour() -> None:
    few, many = report(evaluation(), MAPS), report(evaluation(names=("possmap", "b", "c")), MAPS)
    assert many.height > few.height
    pixels = np.asarray(many)
    for colour in COLOURS[:5]:
        assert (pixels[-320:] == colour).all(axis=2).any(), colour


def test_what_could_not_be_had_is_said_and_nothing_breaks() -> None:
    picture = report(evaluation(None), MAPS)
    assert picture.width == report(evaluation(), MAPS).width
    one = evaluation().grids["possmap"]
    bare = replace(one, tracks=(), rectangles=None, lower_validity=one.lower_validity[:1])
    assert report(replace(evaluation(), grids={"possmap": bare}), MAPS).size


def test_names_of_any_length_stay_in_their_place() -> None:
    long = report(evaluation(names=("possmap", "x" * 300)), MAPS)
    short = report(evaluation(names=("possmap", "x")), MAPS)
    assert long.size[0] == short.size[0]
    margin = np.asarray(long)[-160:, -17:]
    assert (margin == palettes.PAPER).all()
