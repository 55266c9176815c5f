"""Scores: ranking, F1 with a tolerance, proper scores and bins, each against a literal version."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from possmap.core.lattice import Window
from possmap.lab.evaluate.exam import Exam
from possmap.lab.evaluate.proper import brier, calibration_bins, log_score
from possmap.lab.evaluate.ranking import Ranking
from possmap.lab.evaluate.reliability import by_necessity, by_possibility
from possmap.lab.evaluate.true_map import TrueMap, true_map

values = st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.75, 1.0])


@given(st.lists(st.tuples(values, st.booleans()), min_size=1, max_size=30))
def test_auc_is_the_share_of_pairs_in_the_right_order(cells: list[tuple[float, bool]]) -> None:
    scores, wall = np.array([s for s, _ in cells]), np.array([w for _, w in cells])
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in scores[wall] for b in scores[~wall]]
    expected = float(np.mean(pairs)) if pairs else None
    assert Ranking(scores).auc(wall) == (None if expected is None else pytest.approx(expected))


def world(walls: np.ndarray) -> TrueMap:
    """Return a true map whose wall cells are these, 5 cm a cell."""
    at = (np.argwhere(walls) + 0.5) * 0.05
    segments = np.column_stack([at[:, 1], at[:, 0], at[:, 1], at[:, 0]]).reshape(-1, 4)
    window = Window(0, walls.shape[0], 0, walls.shape[1])
    return true_map(segments, np.empty((0, 2)), window, 0.05, 10**6)


SHAPE = (7, 8)


@given(
    arrays(np.bool_, SHAPE),
    arrays(np.bool_, SHAPE),
    arrays(np.float64, SHAPE, elements=values),
    st.sampled_from([0.05, 0.15]),
)
def test_f1_is_the_best_of_all_thresholds(
    walls: np.ndarray, touched: np.ndarray, scores: np.ndarray, tolerance: float
) -> None:
    walls[0, 0] = touched[0, 0] = True
    exam = Exam.of(world(walls), touched)
    found = exam.score(scores[touched], np.full(touched.sum(), 0.5), np.zeros(touched.sum(), bool))
    best = (0.0, 0.0, 0.0)

    def near(a: tuple[int, ...], b: tuple[int, ...]) -> bool:
        return math.dist(a, b) * 0.05 <= tolerance + 1e-9

    all_walls = [tuple(at) for at in np.argwhere(walls)]
    known = [at for at in all_walls if touched[at]]
    for threshold in sorted(set(scores[touched].tolist()), reverse=True):
        claims = [tuple(at) for at in np.argwhere(touched & (scores >= threshold))]
        precision = np.mean([any(near(at, wall) for wall in all_walls) for at in claims])
        recall = np.mean([any(near(at, wall) for at in claims) for wall in known])
        total = precision + recall
        f1 = 2 * precision * recall / total if total else 0.0
        best = max(best, (f1, precision, recall), key=lambda one: one[0] - 1e-12)
    assert (found.f1_5cm if tolerance == 0.05 else found.f1_15cm) == pytest.approx(best[0])
    if tolerance == 0.15 and found.precision_15cm is not None and found.recall_15cm is not None:
        p, r = found.precision_15cm, found.recall_15cm
        assert 2 * p * r / (p + r or 1) == pytest.approx(best[0])


def test_calling_all_wall_finds_all_and_is_as_precise_as_walls_are_frequent() -> None:
    walls = np.zeros((1, 20), dtype=bool)
    walls[0, 10] = True
    exam = Exam.of(world(walls), np.ones((1, 20), dtype=bool))
    precision = 7 / 20  # three cells on either side
    assert exam.all_wall_f1() == pytest.approx(2 * precision / (1 + precision))
    drawn = np.zeros((1, 20), dtype=bool)
    drawn[0, [12, 19]] = True
    assert exam.drawn_f1(drawn) == pytest.approx(2 * 0.5 * 1 / 1.5)


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=50))
def test_proper_scores_split_into_parts_that_add_up(cells: list[tuple[float, bool]]) -> None:
    said, wall = np.array([p for p, _ in cells]), np.array([w for _, w in cells])
    for split in (brier(said, wall), log_score(said, wall)):
        assert split.calibration + split.refinement == pytest.approx(split.score)
        assert split.calibration >= -1e-9
    assert brier(said, wall).score == pytest.approx(np.mean((said - wall) ** 2))


def test_probabilities_that_are_frequencies_lose_nothing_to_calibration() -> None:
    said = np.repeat([0.25, 0.75], 4)
    wall = np.array([True, False, False, False, True, True, True, False])
    for split in (brier(said, wall), log_score(said, wall)):
        assert split.calibration == pytest.approx(0, abs=1e-12)
    assert brier(said, wall).score == pytest.approx(0.1875)
    assert calibration_bins(said, wall) == ((0.25, 0.25, 4), (0.75, 0.75, 4))


def test_one_certain_mistake_does_not_cost_all() -> None:
    assert log_score(np.array([0.0, 1.0]), np.array([True, True])).score == pytest.approx(8)


def test_bins_of_n_are_closed_above_and_those_of_p_below() -> None:
    wall = np.array([False, True, False, True, True])
    flags = dict.fromkeys(("wall", "wall_10cm", "wall_30cm", "wall_local"), wall)
    lower = by_necessity(np.array([0.0, 0.1, 0.05, 0.95, 1.0]), flags)
    assert [(b.low, b.high, b.cells) for b in lower] == [(0, 0, 1), (0, 0.1, 2), (0.9, 1.0, 2)]
    assert [b.wall for b in lower] == [0, 0.5, 1]
    assert lower[1].mean == pytest.approx(0.075)
    upper = by_possibility(np.array([0.0, 0.1, 0.05, 0.95, 1.0]), flags)
    assert [(b.low, b.high, b.cells) for b in upper] == [
        (0, 0.1, 2), (0.1, 0.2, 1), (0.9, 1.0, 1), (1.0, 1.0, 1),
    ]  # fmt: skip
