"""Scores: ranking, F1 with a tolerance, proper scores and bins, each against a literal version."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from possmap.core.lattice import Window
from possmap.lab.evaluate.scores import JudgedCells, Ranking
from possmap.lab.evaluate.true_map import TrueMap, true_map
from possmap.lab.evaluate.validity import of_lower_bound, of_upper_bound

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
    cells = JudgedCells.among(world(walls), touched)
    found = cells.score(scores[touched], np.full(touched.sum(), 0.5), np.zeros(touched.sum(), bool))
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
    cells = JudgedCells.among(world(walls), np.ones((1, 20), dtype=bool))
    precision = 7 / 20  # three cells on either side
    assert cells.all_wall_f1() == pytest.approx(2 * precision / (1 + precision))
    drawn = np.zeros((1, 20), dtype=bool)
    drawn[0, [12, 19]] = True
    assert cells.drawn_f1(drawn) == pytest.approx(2 * 0.5 * 1 / 1.5)


def test_proper_scores_are_means_and_one_certain_mistake_does_not_cost_all() -> None:
    walls = np.array([[True, False, True, False]])
    cells = JudgedCells.among(world(walls), np.ones((1, 4), dtype=bool))
    said = np.array([0.75, 0.25, 0.0, 0.0])
    found = cells.score(said, said, said < 0.5)
    assert found.brier == pytest.approx((2 * 0.25**2 + 1) / 4)
    assert found.log_score == pytest.approx((-2 * math.log(0.75) + 16) / 4, abs=1e-6)
    assert (found.dangerous_free, found.called_free) == (0.5, 1)


@given(st.lists(st.tuples(values, st.booleans()), min_size=2, max_size=30), st.floats(0, 1))
def test_walls_at_an_equal_floor_are_those_among_the_lowest_scores(
    cells: list[tuple[float, bool]], share: float
) -> None:
    """Of the lowest scores, as many as hold that share of the floor; ties in proportion."""
    scores, wall = np.array([s for s, _ in cells]), np.array([w for _, w in cells])
    found = Ranking(scores).walls_below(wall, share)
    if not wall.any() or wall.all():
        assert found is None
        return
    floor, missed, wanted = 0.0, 0.0, share * (~wall).sum()
    for level in sorted(set(scores.tolist())):
        here = scores == level
        free, walls = (here & ~wall).sum(), (here & wall).sum()
        if floor >= wanted:
            break
        part = min(1.0, (wanted - floor) / free) if free else 1.0
        floor, missed = floor + part * free, missed + part * walls
    assert found == pytest.approx(missed / wall.sum())


def test_bins_of_bel_are_closed_above_and_those_of_pl_below() -> None:
    wall = np.array([False, True, False, True, True])
    flags = dict.fromkeys(("wall", "wall_10cm", "wall_30cm", "wall_local"), wall)
    lower = of_lower_bound(np.array([0.0, 0.1, 0.05, 0.95, 1.0]), flags)
    assert [(b.low, b.high, b.cells) for b in lower] == [(0, 0, 1), (0, 0.1, 2), (0.9, 1.0, 2)]
    assert [b.wall for b in lower] == [0, 0.5, 1]
    assert lower[1].mean == pytest.approx(0.075)
    upper = of_upper_bound(np.array([0.0, 0.1, 0.05, 0.95, 1.0]), flags)
    assert [(b.low, b.high, b.cells) for b in upper] == [
        (0, 0.1, 2), (0.1, 0.2, 1), (0.9, 1.0, 1), (1.0, 1.0, 1),
    ]  # fmt: skip
