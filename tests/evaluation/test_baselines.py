"""The log-odds grids beside possmap's, and what a cell's local rectangle is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import Layer
from possmap.core.lattice import Window
from possmap.core.model import ErrorModel
from possmap.core.pyramid import FULL, count_of, relevant
from possmap.core.records import Beam, PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.views import Readout
from possmap.lab.evaluate.bayes import LogOddsSettings, bayes, probability
from possmap.lab.evaluate.local_rectangles import strongest
from possmap.lab.evaluate.observations import JudgedExcursion, Rasterizer, observations
from possmap.lab.evaluate.smeared import bayes_smeared

SURE = ErrorModel(along=0, across=0, turn_spread=0)
C = 0.1


def outing(
    records: Sequence[Record], model: ErrorModel = SURE, name: str = "a", **settings: object
) -> JudgedExcursion:
    version = PartialMap("r1", name, (), tuple(records))
    chosen = EvidenceSettings(resolution=C, **settings)  # type: ignore[arg-type]
    return JudgedExcursion.of(version, model, chosen)


def pose(seq: int, x: float, y: float, error: float = 0.0) -> Pose:
    return Pose(seq, None, x, y, 0.0, error, error)


def drawn(array: np.ndarray, marks: dict[float, str]) -> list[str]:
    return ["".join(marks.get(round(float(v), 2), "?") for v in row) for row in array[::-1]]


PAST_A_WALL = [
    pose(0, 0.15, 0.15),
    Wall(1, None, 0.15, 0.45, 0.75, 0.45),
    pose(2, 0.75, 0.15),
]


def test_a_wall_and_the_floor_under_a_body_as_text() -> None:
    grid = bayes([outing(PAST_A_WALL)], Window(0, 6, 0, 9), C, LogOddsSettings(body=0.25))
    assert drawn(grid.log_odds, {0.0: ".", 0.85: "#", -0.4: "o"}) == [
        ".........",
        ".#######.",
        ".........",
        ".ooooooo.",
        "ooooooooo",
        ".ooooooo.",
    ]
    assert (grid.touched == (grid.log_odds != 0)).all()


def test_log_odds_are_held_between_their_bounds_after_every_record() -> None:
    walls = [Wall(k, None, 0.45, 0.45, 0.45, 0.45) for k in range(1, 7)]
    there = [pose(0, 0.15, 0.15), *walls, pose(7, 0.16, 0.15)]
    over = [pose(8 + k, 0.15 + 0.6 * (k % 2), 0.45) for k in range(3)]
    grid = bayes([outing([*there, *over])], Window(0, 9, 0, 9), C, LogOddsSettings())
    assert grid.log_odds[4, 4] == pytest.approx(3.5 - 0.4 * 2)  # not 6·.85 - …
    drives = [pose(k, 0.15 + 0.6 * (k % 2), 0.15) for k in range(12)]
    assert bayes([outing(drives)], Window(0, 9, 0, 9), C, LogOddsSettings()).log_odds.min() == -2


def test_beams_between_two_poses_are_one_scan_in_which_a_hit_beats_the_way() -> None:
    scan = [
        pose(0, 0.05, 0.05),
        Beam(1, None, 0.05, 0.05, 0.45, 0.05),
        Beam(2, None, 0.05, 0.05, 0.75, 0.05),
        Beam(3, None, 0.05, 0.05, 0.85, 0.05, hit=False),
        pose(4, 0.05, 0.05),
    ]
    grid = bayes([outing(scan)], Window(0, 1, 0, 10), C, LogOddsSettings())
    assert drawn(grid.log_odds, {0.0: ".", 0.85: "#", -0.4: "o"}) == ["oooo#oo#o."]


@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_one_detection_and_one_pass_are_possmaps_own_probability(
    n: float, denial: float, base_rate: float
) -> None:
    """METHOD §4: ℓ(wall) = -ln(1 - α), ℓ(free) = ln Π."""
    told = LogOddsSettings(hit=-math.log1p(-n), free=-math.log1p(-denial), low=-99, high=99)
    there = [pose(0, 0.05, 0.15), Wall(1, None, 0.45, 0.45, 0.45, 0.45), pose(2, 0.05, 0.45)]
    through = [pose(3, 0.85, 0.45)]
    grid = bayes([outing([*there, *through])], Window(0, 6, 0, 9), C, told)
    ours = Readout(
        np.array([[-math.log1p(-n)]]), np.array([[-math.log1p(-denial)]]), np.array([[1 - denial]])
    ).probability(base_rate)
    found = probability(grid.log_odds[4:5, 4:5].astype(np.float64), base_rate)
    assert found == pytest.approx(ours, rel=1e-5)


def test_what_is_known_exactly_is_not_smeared() -> None:
    sharp = bayes([outing(PAST_A_WALL)], Window(0, 6, 0, 9), C, LogOddsSettings())
    smeared = bayes_smeared([outing(PAST_A_WALL)], Window(0, 6, 0, 9), C, LogOddsSettings())
    assert smeared.log_odds == pytest.approx(sharp.log_odds, abs=1e-6)


def looked_at(error: float) -> list[Record]:
    """Return a log with one point of wall, its place known to ± an error."""
    return [pose(0, 0.05, 0.05, error), Wall(1, None, 1.05, 1.05, 1.05, 1.05), pose(2, 0.05, 0.05)]


@pytest.mark.parametrize("error", [0.1, 0.3, 0.6])
def test_the_smear_of_a_point_is_a_gaussian_that_adds_up_to_the_point(error: float) -> None:
    window = Window(-20, 40, -20, 40)
    grid = bayes_smeared([outing(looked_at(error))], window, C, LogOddsSettings())
    assert grid.log_odds.sum() == pytest.approx(0.85, rel=0.02)
    rows, columns = np.indices(window.shape)
    weights = grid.log_odds / grid.log_odds.sum()
    middle = (weights * rows).sum(), (weights * columns).sum()
    assert middle == pytest.approx((30, 30), abs=1e-4)
    sd = math.sqrt((weights * (rows - 30) ** 2).sum()) * C
    assert sd == pytest.approx(math.hypot(error / 2.236, C / math.sqrt(12)), rel=0.05)


def test_an_excursions_looks_do_not_add_up_but_excursions_do() -> None:
    window = Window(0, 30, 0, 30)
    once = looked_at(0.2)
    twice = [*once, Wall(3, None, 1.05, 1.05, 1.05, 1.05), pose(4, 0.05, 0.05)]
    one = bayes_smeared([outing(once)], window, C, LogOddsSettings()).log_odds
    assert (bayes_smeared([outing(twice)], window, C, LogOddsSettings()).log_odds == one).all()
    both = [outing(once), outing(PAST_A_WALL, name="b")]
    forth = bayes_smeared(both, window, C, LogOddsSettings()).log_odds
    back = bayes_smeared(both[::-1], window, C, LogOddsSettings()).log_odds
    assert forth == pytest.approx(back, abs=1e-6)
    two = bayes_smeared(
        [outing(once), outing(once, name="b")], window, C, LogOddsSettings()
    ).log_odds
    assert two == pytest.approx(2 * one)


def test_what_is_as_far_off_as_max_error_is_not_told() -> None:
    window = Window(0, 30, 0, 30)
    far = bayes_smeared([outing(looked_at(1.0))], window, C, LogOddsSettings())
    assert not far.touched.any()


@given(
    st.tuples(*[st.floats(-1.5, 1.5)] * 4).filter(lambda p: p[:2] != p[2:]),
    st.floats(0.01, 0.5),
    st.integers(-8, 0),
    st.integers(1, 9),
)
def test_the_floor_under_a_body_is_what_lies_near_its_path(
    places: tuple[float, float, float, float], width: float, low: int, size: int
) -> None:
    window = Window(low, low + size, low, low + size)
    one = outing([pose(0, *places[:2]), pose(1, *places[2:])])
    (told,) = observations(one)
    assert told.driven is not None
    found = np.zeros(window.cells, dtype=bool)
    found[Rasterizer(window, C).floor(told.driven, width).flat(window)] = True
    x0, y0, x1, y1 = places
    n = max(1, math.ceil(max(abs(x1 - x0), abs(y1 - y0)) / C - 1e-6))
    path = {
        (
            math.floor((y0 + k / n * (y1 - y0)) / C + 1e-6),
            math.floor((x0 + k / n * (x1 - x0)) / C + 1e-6),
        )
        for k in range(n + 1)
    }
    for row, column in np.ndindex(window.shape):
        cell = row + low, column + low
        x, y = (cell[1] + 0.5) * C, (cell[0] + 0.5) * C
        length = math.dist((x0, y0), (x1, y1))
        along = (x - x0) * ((x1 - x0) / length) + (y - y0) * ((y1 - y0) / length)
        share = min(length, max(0.0, along)) / length
        away = math.dist((x, y), (x0 + share * (x1 - x0), y0 + share * (y1 - y0)))
        if abs(away - width / 2) > 1e-6:
            expected = cell in path or away < width / 2
            assert found[row * size + column] == expected, cell


@given(st.lists(st.tuples(*[st.floats(0, 2)] * 4), min_size=1, max_size=4), st.floats(0, 0.5))
def test_the_local_rectangle_is_that_of_the_strongest_report(
    walls: list[tuple[float, float, float, float]], error: float
) -> None:
    """Cell by cell, stamp by stamp; the rectangle is taken at the nearest place of the wall."""
    records: list[Record] = [pose(0, 0, 0, error)]
    for k, wall in enumerate(walls):
        records += [Wall(2 * k + 1, None, *wall), pose(2 * k + 2, 0.3 * (k + 1), 0.1)]
    one, window = outing(records, ErrorModel(along=0.1, across=0.1)), Window(-2, 22, -2, 22)
    best = strongest([one.found], window, C)
    values = np.zeros(window.shape)
    for evidence in one.found.evidence:
        if evidence.layer is not Layer.WALLS:
            continue
        (segment,) = evidence.segments
        if relevant(segment, C, 1.0) is None:
            continue
        n = count_of(segment, C)
        for k in range(n + 1):
            s = k / n
            hx = segment.rect0.half_x + s * (segment.rect1.half_x - segment.rect0.half_x)
            hy = segment.rect0.half_y + s * (segment.rect1.half_y - segment.rect0.half_y)
            if max(hx, hy) >= 1:
                continue
            column = math.floor((segment.x0 + s * (segment.x1 - segment.x0)) / C + 1e-6)
            row = math.floor((segment.y0 + s * (segment.y1 - segment.y0)) / C + 1e-6)
            cells = np.abs(np.arange(-2, 22) - column) * C
            across = (1 - hx) * np.maximum(0, 1 - cells / (hx + C / 2))
            cells = np.abs(np.arange(-2, 22) - row) * C
            up = (1 - hy) * np.maximum(0, 1 - cells / (hy + C / 2))
            np.maximum(values, np.minimum(up[:, None], across[None]), out=values)
    assert best.value / FULL == pytest.approx(values, abs=1e-4)
    least = min(a.rect.half_x for a in one.found.geometry.values())
    assert (best.across[best.value > 0] >= math.ceil(least / C + 0.5) - 1).all()


def test_the_rectangle_reaches_the_cells_that_it_covers_at_least_in_part() -> None:
    best = strongest([outing(looked_at(0.2)).found], Window(0, 30, 0, 30), C)
    assert (best.up[10, 10], best.across[10, 10]) == (2, 2)  # ±0.2 m around a centre of a cell
    best = strongest([outing(looked_at(0.26)).found], Window(0, 30, 0, 30), C)
    assert (best.up[10, 10], best.across[10, 10]) == (3, 3)
    assert best.value[10, 12] > 0 and best.across[10, 12] == 3
    assert best.value[0, 0] == best.up[0, 0] == 0
