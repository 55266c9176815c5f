"""The cells on which maps are examined, and what is true of each: one mask for all methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from possmap.lab.evaluate.distance import disc
from possmap.lab.evaluate.proper import brier, calibration_bins, log_score
from possmap.lab.evaluate.ranking import Curve, Ranking, best_nearby
from possmap.lab.evaluate.raster import Flags, Floats, Ints
from possmap.lab.evaluate.results import MethodScore
from possmap.lab.evaluate.true_map import TrueMap


@dataclass(frozen=True, eq=False)
class Exam:
    """The cells that any method touched, without solid insides, in the order of an array's rows.

    Attributes
    ----------
    mask
        Shape of the true map's window.
    wall
        Of each cell of the mask, whether it is wall; shape (n,), like all that follows.
    within
        Whether a wall lies within a tolerance: 0.05, 0.1, 0.15 or 0.3 m.
    rows, columns
        Of the mask's wall cells, in the mask's array; arrays of one length.
    """

    truth: TrueMap
    mask: Flags
    wall: Flags
    within: dict[float, Flags]
    rows: Ints
    columns: Ints

    @classmethod
    def of(cls, truth: TrueMap, touched: Flags) -> Exam:
        """Examine the cells that were touched, where one can be."""
        mask = touched & ~truth.solid
        rows, columns = np.nonzero(mask & truth.walls)
        squares = truth.squares[mask]
        within = {m: truth.near(squares, m) for m in (0.05, 0.1, 0.15, 0.3)}
        return cls(truth, mask, truth.walls[mask], within, rows, columns)

    def score(self, ranked: Floats, probability: Floats, called_free: Flags) -> MethodScore:
        """Score one method's map.

        Parameters
        ----------
        ranked
            Of each cell, the higher, the more like a wall.
        probability
            Of a wall.
        called_free
            Whether the method would let a robot drive there.
        """
        ranking = Ranking(ranked)
        curves = {m: self._curve(ranking, m) for m in (0.05, 0.15)}
        narrow, wide = (curves[m] for m in (0.05, 0.15))
        best = None if wide is None else wide.best
        return MethodScore(
            auc=ranking.auc(self.wall),
            f1_5cm=None if narrow is None else float(narrow.f1[narrow.best]),
            f1_15cm=None if wide is None else float(wide.f1[best]),
            precision_15cm=None if wide is None else float(wide.precision[best]),
            recall_15cm=None if wide is None else float(wide.recall[best]),
            brier=brier(probability, self.wall),
            log_score=log_score(probability, self.wall),
            dangerous_free=float(called_free[self.wall].mean()) if self.wall.any() else None,
            curve_15cm=None if wide is None else wide.thinned(),
            probability_bins=calibration_bins(probability, self.wall),
        )

    def _curve(self, ranking: Ranking, tolerance_m: float) -> Curve | None:
        if not len(self.rows):
            return None
        offsets = disc(tolerance_m, self.truth.resolution)
        best = best_nearby(ranking.level, self.mask, self.rows, self.columns, offsets)
        return ranking.curve(self.within[tolerance_m], best)

    def all_wall_f1(self) -> float | None:
        """Return F1 within 15 cm of calling every cell of the mask a wall."""
        if not len(self.rows):
            return None
        precision = float(self.within[0.15].mean())
        return 2 * precision / (precision + 1)

    def drawn_f1(self, drawn: Flags) -> float | None:
        """Return F1 within 15 cm of some cells called wall, an array of the window's shape."""
        if not len(self.rows) or not drawn.any():
            return None
        claims = drawn & ~self.truth.solid
        precision = float(self.truth.near(self.truth.squares[claims], 0.15).mean())
        level = drawn.ravel().astype(np.int32)
        everywhere = np.ones_like(drawn)
        offsets = disc(0.15, self.truth.resolution)
        found = best_nearby(level, everywhere, self.rows, self.columns, offsets) == 1
        recall = float(found.mean())
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0
