"""How well scores tell walls from the rest, all methods on one mask of cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from possmap.core.views import EDGE
from possmap.lab.evaluate.distance import disc
from possmap.lab.evaluate.raster import Flags, Floats, Ints
from possmap.lab.evaluate.true_map import TrueMap

Levels = NDArray[np.int32]
"""Ranks among scores: small numbers, of many cells."""

TOLERANCES_M = (0.05, 0.1, 0.15, 0.3)


@dataclass(frozen=True, eq=False)
class MethodScore:
    """How true one method's map is; None where the mask has no such cells.

    Attributes
    ----------
    auc
        How often a wall cell scores higher than another.
    f1_5cm, f1_15cm, precision_15cm, recall_15cm
        At the threshold that is best for F1 within the tolerance.
    brier, log_score
        Of the probability at the base rate, the lower the better.
    dangerous_free, called_free
        Share of the wall cells, and of the free cells, that the map calls free.
    dangerous_at_equal_floor
        Share of the wall cells that rank among what is called free, if the method called as large
        a share of the free cells free as the first method does.
    curve_15cm
        Precision and recall of all thresholds.
    """

    auc: float | None
    f1_5cm: float | None
    f1_15cm: float | None
    precision_15cm: float | None
    recall_15cm: float | None
    brier: float
    log_score: float
    dangerous_free: float | None
    called_free: float | None
    dangerous_at_equal_floor: float | None
    curve_15cm: Curve | None


@dataclass(frozen=True, eq=False)
class JudgedCells:
    """The cells that any method touched, without the insides of walls, in the order of rows.

    Attributes
    ----------
    mask
        Shape of the true map's window.
    """

    truth: TrueMap
    mask: Flags

    @classmethod
    def among(cls, truth: TrueMap, touched: Flags) -> JudgedCells:
        """Judge the cells that were touched, where one can be."""
        return cls(truth, touched & ~truth.solid)

    @cached_property
    def wall(self) -> Flags:
        """Of each cell of the mask, whether it is wall; shape (n,)."""
        return self.truth.walls[self.mask]

    @cached_property
    def within(self) -> dict[float, Flags]:
        """Of each cell of the mask, whether a wall lies within a tolerance; shape (n,)."""
        squares = self.truth.squares[self.mask]
        return {metres: self.truth.near(squares, metres) for metres in TOLERANCES_M}

    @cached_property
    def wall_places(self) -> tuple[Ints, Ints]:
        """Rows and columns of the mask's wall cells, in the mask's array."""
        rows, columns = np.nonzero(self.mask & self.truth.walls)
        return rows, columns

    def score(
        self,
        ranked: Floats,
        probability: Floats,
        called_free: Flags,
        floor_share: float | None = None,
    ) -> MethodScore:
        """Score one method's map; arrays of shape (n,).

        Parameters
        ----------
        ranked
            Of each cell, the higher, the more like a wall.
        probability
            Of a wall.
        called_free
            Whether the method would let a robot drive there.
        floor_share
            Share of the free cells that the first method calls free; None: this is the first.
        """
        ranking = Ranking(ranked)
        narrow, wide = (self._curve(ranking, metres) for metres in (0.05, 0.15))
        said = np.clip(probability, EDGE, 1 - EDGE)  # one certain mistake must not cost all
        called = _share(called_free[~self.wall])
        floor_share = called if floor_share is None else floor_share
        return MethodScore(
            auc=ranking.auc(self.wall),
            f1_5cm=_at_best(narrow, "f1"),
            f1_15cm=_at_best(wide, "f1"),
            precision_15cm=_at_best(wide, "precision"),
            recall_15cm=_at_best(wide, "recall"),
            brier=float(np.mean((probability - self.wall) ** 2)),
            log_score=float(-np.mean(np.log(np.where(self.wall, said, 1 - said)))),
            dangerous_free=_share(called_free[self.wall]),
            called_free=called,
            dangerous_at_equal_floor=ranking.walls_below(self.wall, floor_share),
            curve_15cm=wide,
        )

    def _curve(self, ranking: Ranking, tolerance_m: float) -> Curve | None:
        rows, columns = self.wall_places
        if not len(rows):
            return None
        offsets = disc(tolerance_m, self.truth.resolution)
        best = best_nearby(ranking.level, self.mask, rows, columns, offsets)
        return ranking.curve(self.within[tolerance_m], best)

    def all_wall_f1(self) -> float | None:
        """Return F1 within 15 cm of calling every cell of the mask a wall."""
        if not len(self.wall_places[0]):
            return None
        precision = float(self.within[0.15].mean())
        return 2 * precision / (precision + 1)

    def drawn_f1(self, drawn: Flags) -> float | None:
        """Return F1 within 15 cm of some cells called wall, an array of the window's shape."""
        rows, columns = self.wall_places
        if not len(rows) or not drawn.any():
            return None
        squares = self.truth.squares[drawn & ~self.truth.solid]
        precision = float(self.truth.near(squares, 0.15).mean())
        level, offsets = drawn.ravel().astype(np.int32), disc(0.15, self.truth.resolution)
        best = best_nearby(level, np.ones_like(drawn), rows, columns, offsets)
        recall = float((best == 1).mean())
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _at_best(curve: Curve | None, name: str) -> float | None:
    return None if curve is None else float(getattr(curve, name)[curve.best])


def _share(flags: Flags) -> float | None:
    return float(flags.mean()) if flags.size else None


class Ranking:
    """Scores by their rank: equal scores share a level, the lowest is 0.

    After the one sort everything is counting: a threshold is a level, and whoever is at or above
    it is claimed to be wall.

    Parameters
    ----------
    scores
        One of each cell, shape (n,); the higher, the more like a wall.
    """

    def __init__(self, scores: Floats) -> None:
        self.scores, level = np.unique(scores, return_inverse=True)
        self.level = level.astype(np.int32)

    def auc(self, wall: Flags) -> float | None:
        """Return how often a wall scores higher than what is none, ties half; None without both."""
        walls, others = self._counts(wall)
        pairs = int(walls.sum()) * int(others.sum())
        if not pairs:
            return None
        below = np.cumsum(others) - others
        return float((walls * (below + others / 2)).sum() / pairs)

    def walls_below(self, wall: Flags, floor_share: float | None) -> float | None:
        """Return the share of walls among the lowest scores that hold a share of all others.

        Of cells that tie at the threshold, walls and others are taken in proportion.
        """
        walls, others = self._counts(wall)
        if floor_share is None or not walls.any() or not others.any():
            return None
        missed, called = (np.cumsum([0, *part]) / part.sum() for part in (walls, others))
        # From the first place where so much is called: ranks that hold walls alone come after it.
        at = int(np.searchsorted(called, floor_share, side="left"))
        if at == 0 or called[at] == floor_share:
            return float(missed[at])
        share = (floor_share - called[at - 1]) / (called[at] - called[at - 1])
        return float(missed[at - 1] + share * (missed[at] - missed[at - 1]))

    def _counts(self, wall: Flags) -> tuple[Ints, Ints]:
        """Return how many walls, and how many others, each level has."""
        walls = np.bincount(self.level[wall], minlength=len(self.scores))
        return walls, np.bincount(self.level, minlength=len(self.scores)) - walls

    def curve(self, near: Flags, best_at_walls: Levels) -> Curve:
        """Return precision and recall of every threshold.

        Parameters
        ----------
        near
            Of each cell, whether a true wall lies within the tolerance.
        best_at_walls
            Of each true wall cell, the highest level within the tolerance.
        """
        claimed, right, found = (
            np.cumsum(np.bincount(levels, minlength=len(self.scores))[::-1])[::-1]
            for levels in (self.level, self.level[near], best_at_walls)
        )
        precision, recall = right / claimed, found / max(1, len(best_at_walls))
        total = precision + recall
        f1 = np.divide(2 * precision * recall, total, out=np.zeros_like(total), where=total > 0)
        return Curve(precision, recall, f1)


@dataclass(frozen=True, eq=False)
class Curve:
    """Precision, recall and F1 by threshold, rising; arrays of one length."""

    precision: Floats
    recall: Floats
    f1: Floats

    @property
    def best(self) -> int:
        """The index of the threshold with the highest F1; of several, the highest threshold."""
        return len(self.f1) - 1 - int(np.argmax(self.f1[::-1]))


def best_nearby(
    level: Levels, mask: Flags, rows: Ints, columns: Ints, offsets: list[tuple[int, int]]
) -> Levels:
    """Return the highest level near each of some cells; one near a cell of the mask has some.

    Parameters
    ----------
    level
        Of each cell of the mask, in the order of its rows.
    rows, columns
        The cells asked for, in the mask's array.
    offsets
        The neighbourhood, as rows and columns away.
    """
    margin = max((abs(value) for offset in offsets for value in offset), default=0)
    whole = np.full((mask.shape[0] + 2 * margin, mask.shape[1] + 2 * margin), -1, dtype=np.int32)
    whole[margin : margin + mask.shape[0], margin : margin + mask.shape[1]][mask] = level
    best: Levels = np.full(len(rows), -1, dtype=np.int32)
    for row, column in offsets:
        np.maximum(best, whole[rows + (row + margin), columns + (column + margin)], out=best)
    return best
