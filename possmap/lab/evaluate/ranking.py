"""How well scores tell walls from the rest, at all thresholds at once: ROC-AUC, precision, F1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from possmap.lab.evaluate.raster import Flags, Floats, Ints, Levels


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
        walls = np.bincount(self.level[wall], minlength=len(self.scores))
        others = np.bincount(self.level, minlength=len(self.scores)) - walls
        pairs = int(walls.sum()) * int(others.sum())
        if not pairs:
            return None
        below = np.cumsum(others) - others
        return float((walls * (below + others / 2)).sum() / pairs)

    def curve(self, near: Flags, best_at_walls: Levels) -> Curve:
        """Return precision and recall of every threshold.

        Parameters
        ----------
        near
            Of each cell, whether a true wall lies within the tolerance.
        best_at_walls
            Of each true wall cell, the highest level within the tolerance.
        """
        claimed = _at_or_above(self.level, len(self.scores))
        right = _at_or_above(self.level[near], len(self.scores))
        found = _at_or_above(best_at_walls, len(self.scores))
        precision = right / claimed
        recall = found / max(1, len(best_at_walls))
        total = precision + recall
        f1 = np.divide(2 * precision * recall, total, out=np.zeros_like(total), where=total > 0)
        return Curve(self.scores, precision, recall, f1)


def _at_or_above(levels: Levels, count: int) -> Ints:
    """Return how many are at or above each level."""
    counts: Ints = np.cumsum(np.bincount(levels, minlength=count)[::-1])[::-1]
    return counts


@dataclass(frozen=True, eq=False)
class Curve:
    """Precision and recall by threshold, rising; arrays of one length.

    threshold : scores; cells at or above are claimed to be wall.
    """

    threshold: Floats
    precision: Floats
    recall: Floats
    f1: Floats

    @property
    def best(self) -> int:
        """The index of the threshold with the highest F1; of several, the highest threshold."""
        return len(self.f1) - 1 - int(np.argmax(self.f1[::-1]))

    def thinned(self, most: int = 500) -> Curve:
        """Return the curve with fewer points, the best and the ends among them, for a picture."""
        last = len(self.threshold) - 1
        some = np.unique(np.rint(np.linspace(0, last, most)).astype(np.int64))
        some = np.union1d(some, [self.best])
        return Curve(self.threshold[some], self.precision[some], self.recall[some], self.f1[some])


def best_nearby(
    level: Levels, mask: Flags, rows: Ints, columns: Ints, offsets: list[tuple[int, int]]
) -> Levels:
    """Return the highest level near each of some cells, -1 where there is none.

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
