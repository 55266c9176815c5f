"""A track as straight runs and turns, never farther from the recorded one than it may be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from possmap.lab.convert.samples import Floats, Ints, Samples, off_segment

SNAP = 0.2
"""Share of the tolerance within which two poses are one place."""

LARGEST_TURN = math.pi / 2
"""No two poses of one place are further turned than this, so that every turn is told [rad]."""

_BIN_M = 1e-4
_BINS = 100_000

ROUNDING_M = 1e-4
"""What a log's four decimals may take away."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The poses that stand for a track; k poses.

    index : of the sample at each, rising, shape (k,).
    x, y : [m]. The robot runs straight from each to the next; the same place twice is a standstill.
    """

    index: Ints
    x: Floats
    y: Floats

    def run_of(self, samples: Ints) -> Ints:
        """Return between which poses samples lie: the number of the pose before."""
        found: Ints = np.searchsorted(self.index, samples, side="right") - 1
        return np.minimum(found, len(self.index) - 2)

    def strays(self, samples: Samples) -> Floats:
        """Return how far each sample lies from the run it belongs to [m]."""
        if len(self.index) < 2:
            alone: Floats = np.hypot(samples.x - self.x[0], samples.y - self.y[0])
            return alone
        run = self.run_of(np.arange(len(samples)))
        return off_segment(
            samples.x, samples.y, self.x[run], self.y[run], self.x[run + 1], self.y[run + 1]
        )


class Strays:
    """Counts distances in bins of 0.1 mm; the worst is kept exactly."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.worst = 0.0

    def add(self, strays: Floats) -> None:
        """Count distances [m]."""
        if len(strays):
            bins = np.minimum((strays / _BIN_M).astype(np.int64), _BINS - 1)
            self._counts += np.bincount(bins, minlength=_BINS)
            self.worst = max(self.worst, float(strays.max()))

    @property
    def median(self) -> float:
        """The median [m], to a tenth of a millimetre; 0 without any."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        middle = int(np.searchsorted(np.cumsum(self._counts), (total + 1) // 2))
        return (middle + 0.5) * _BIN_M if middle else 0.0


def outline(
    samples: Samples,
    tolerance: float,
    turn_tolerance: float,
    start: tuple[float, float] | None = None,
    stops: Ints | None = None,
) -> Outline:
    """Return the poses of a track: its ends, its bends, and where the body turned.

    Bends are found by Ramer, Douglas and Peucker's method. Distances are measured to the run, not
    to the line through it, and going back along it counts as well, so that going back and forth
    is not lost. Where only the body turns, a pose is set on the run.

    Parameters
    ----------
    tolerance
        The farthest that a sample may lie from its run [m].
    turn_tolerance
        The farthest that the body's heading may lie from what is between two poses [rad].
    start
        Where the track before has put its last pose, which is this one's first [m].
    stops
        Samples that get a pose in any case, rising.
    """
    snap = SNAP * tolerance
    bends = _bends(samples, max(tolerance - snap - 2 * ROUNDING_M, 0.0), stops)
    first_x, first_y = start or (float(samples.x[0]), float(samples.y[0]))
    index, x, y = [0], [first_x], [first_y]
    for first, end in zip(bends[:-1].tolist(), bends[1:].tolist(), strict=True):
        share = 0.0
        x0, y0, x1, y1 = samples.x[first], samples.y[first], samples.x[end], samples.y[end]
        length2 = (x1 - x0) ** 2 + (y1 - y0) ** 2
        for at in _turns(samples, first, end, turn_tolerance):
            if length2:
                so_far = slice(first, at + 1)
                along = (samples.x[so_far] - x0) * (x1 - x0) + (samples.y[so_far] - y0) * (y1 - y0)
                share = min(1.0, max(share, float(along.max() / length2)))
            index.append(at)
            x.append(float(x0 + share * (x1 - x0)))
            y.append(float(y0 + share * (y1 - y0)))
        index.append(end)
        x.append(float(x1))
        y.append(float(y1))
    for k in range(1, len(index)):
        if math.hypot(x[k] - x[k - 1], y[k] - y[k - 1]) < snap:
            x[k], y[k] = x[k - 1], y[k - 1]
    return Outline(np.array(index), np.array(x), np.array(y))


def _back(x: Floats, y: Floats, x0: float, y0: float, x1: float, y1: float) -> Floats:
    """Return how far each point lies behind the farthest before it, along a run [m]."""
    length = math.hypot(x1 - x0, y1 - y0)
    if not length:
        return np.zeros(len(x))
    along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
    along = np.clip(along, 0.0, length)
    found: Floats = np.maximum.accumulate(along) - along
    return found


def _bends(samples: Samples, tolerance: float, stops: Ints | None) -> Ints:
    """Return the samples between which straight runs stay within the tolerance."""
    kept = np.zeros(len(samples), dtype=np.bool_)
    kept[[0, -1]] = True
    kept[[] if stops is None else stops] = True
    todo = list(pairwise(np.flatnonzero(kept).tolist()))
    while todo:
        start, end = todo.pop()
        if end - start < 2:
            continue
        inner = slice(start + 1, end)
        x, y = samples.x[inner], samples.y[inner]
        ends = samples.x[start], samples.y[start], samples.x[end], samples.y[end]
        off = np.hypot(off_segment(x, y, *ends), _back(x, y, *ends))
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = start + 1 + worst
            kept[middle] = True
            todo += [(start, middle), (middle, end)]
    return np.flatnonzero(kept)


def _turns(samples: Samples, start: int, end: int, tolerance: float) -> list[int]:
    """Return where between two poses the body's heading must be told, in order."""
    found: list[int] = []
    todo = [(start, end)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        t, yaw = samples.t[first : last + 1], samples.yaw[first : last + 1]
        span = t[-1] - t[0]
        share = (t - t[0]) / span if span > 0 else np.linspace(0, 1, len(t))
        off = np.abs(yaw - (yaw[0] + share * (yaw[-1] - yaw[0])))[1:-1]
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = inner.start + worst
        elif abs(yaw[-1] - yaw[0]) > LARGEST_TURN:
            half = yaw[0] + (yaw[-1] - yaw[0]) / 2
            middle = inner.start + int(np.argmin(np.abs(yaw[1:-1] - half)))
        else:
            continue
        found.append(middle)
        todo += [(first, middle), (middle, last)]
    return sorted(found)
