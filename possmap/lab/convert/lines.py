"""Walls in what one beam saw on its way: lines through readings, whatever lies off them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from possmap.lab.convert.hits import Hits
from possmap.lab.convert.samples import Flags, Floats, Ints, Samples
from possmap.lab.convert.settings import ConvertSettings

MOST = 1024
"""Through so many points at most, evenly chosen: every one is paired with every other."""

GAP_M = 0.3
"""Farther apart than this, and than the robot moved and turned, readings are of two walls [m]."""

MOST_TURNED_M = 0.5
"""Turning carries a beam's end along a wall, but not farther than this without a doubt [m]."""

STRAYS = 2
"""So many readings in a row may lie off a wall that goes on behind them."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedWall:
    """A straight piece of wall, as one beam saw it in passing.

    Attributes
    ----------
    index
        Samples of the readings on it, rising, (m,).
    along
        Where these lie on the line from ``origin``, in its ``direction`` [m], (m,).
    origin, direction
        A point of the line, and the unit vector along it in which it was passed [m].
    stops
        Whether the beam saw past it behind its last reading: the wall ends there.
    """

    index: Ints
    along: Floats
    origin: tuple[float, float]
    direction: tuple[float, float]
    stops: bool

    @property
    def length(self) -> float:
        """Of the piece seen [m]."""
        return float(self.along.max() - self.along.min())

    @property
    def angle(self) -> float:
        """Of the line [rad]."""
        return math.atan2(self.direction[1], self.direction[0])

    def point(self, along: float) -> tuple[float, float]:
        """Return a point of the line [m]."""
        return (
            self.origin[0] + along * self.direction[0],
            self.origin[1] + along * self.direction[1],
        )

    @property
    def end(self) -> tuple[float, float]:
        """Where it was seen last."""
        return self.point(float(self.along[-1]))


@dataclass(frozen=True, slots=True)
class _Line:
    """A line: a point, and the unit vector along it."""

    x: float
    y: float
    dx: float
    dy: float

    def off(self, points: Floats) -> Floats:
        """Return how far points lie off it [m]."""
        found: Floats = np.abs(
            (points[:, 1] - self.y) * self.dx - (points[:, 0] - self.x) * self.dy
        )
        return found

    def along(self, points: Floats) -> Floats:
        """Return how far along it points lie [m]."""
        found: Floats = (points[:, 0] - self.x) * self.dx + (points[:, 1] - self.y) * self.dy
        return found


def fitted(points: Floats) -> _Line:
    """Return the line through points by repeated medians (Siegel 1982): half may lie off it.

    Parameters
    ----------
    points
        (n, 2) [m], in their order along the line, but for some; it runs that way.
    """
    middle = median(points)
    step = points - middle
    # Turned so that the line lies flat, for a slope must not be steep: from the middle of the
    # first half to that of the second, which a few wild points do not move.
    half = len(points) // 2
    ahead = median(points[-half:]) - median(points[:half])
    angle = math.atan2(ahead[1], ahead[0])
    cos, sin = math.cos(angle), math.sin(angle)
    flat, high = step[:, 0] * cos + step[:, 1] * sin, step[:, 1] * cos - step[:, 0] * sin
    slope, height = repeated_medians(flat, high)
    angle += math.atan(slope)
    x, y = middle[0] - height * sin, middle[1] + height * cos
    dx, dy = math.cos(angle), math.sin(angle)
    return _Line(float(x), float(y), dx, dy)


def walls_of(
    seen: Hits, samples: Samples, settings: ConvertSettings
) -> tuple[list[FittedWall], Ints]:
    """Return the walls that a beam passed, and which of its readings are on none.

    Readings are taken in their order. A wall grows from a few in a row that lie on one line, as
    long as readings go on to; it ends where several in a row do not, or after a gap.
    """
    numbers = np.flatnonzero(seen.seen)
    points, gaps = seen.end[numbers], _gaps(seen, samples)[numbers]
    on_wall = np.zeros(len(seen.index), dtype=np.bool_)
    walls: list[FittedWall] = []
    for inside in _pieces(points, gaps, settings):
        line = fitted(points[inside])
        own = numbers[inside]
        on_wall[own] = True
        walls.append(
            FittedWall(
                seen.index[own],
                line.along(points[inside]),
                (line.x, line.y),
                (line.dx, line.dy),
                _stops(line, seen, int(own[-1])),
            )
        )
    return walls, np.flatnonzero(seen.seen & ~on_wall)


def median(values: Floats) -> Floats:
    """Return the medians along the first axis, of (n, ...) values; quicker than NumPy on few."""
    ordered = np.sort(values, axis=0)
    found: Floats = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return found


def repeated_medians(x: Floats, y: Floats) -> tuple[float, float]:
    """Return slope and height at x = 0 of the line through points (Siegel 1982).

    The slope is the median, over the points, of the median slope from each to all others. Of
    points that have all one x it is 0.

    Parameters
    ----------
    x, y
        (n,); of more than MOST points some stand for all.
    """
    if len(x) > MOST:
        some = np.linspace(0, len(x) - 1, MOST).round().astype(np.int64)
        x, y = x[some], y[some]
    run, rise = x[:, None] - x, y[:, None] - y
    apart = run != 0
    # Points of one x say nothing of the slope: they go behind all others.
    slopes = np.divide(rise, run, out=np.full(run.shape, np.inf), where=apart)
    slopes.sort(axis=1)
    count = apart.sum(axis=1)
    if not count.any():
        return 0.0, float(median(y))
    row = np.arange(len(x))
    slope = float(median((slopes[row, (count - 1) // 2] + slopes[row, count // 2]) / 2))
    return slope, float(median(y - slope * x))


def _gaps(seen: Hits, samples: Samples) -> Floats:
    """Return how far each reading may lie from the one before on the same wall [m].

    A robot that looks seldom sees a wall in wide steps: what it moved and turned since the sample
    before counts, and once more, for a reading that failed.
    """
    if not len(seen.index):
        return np.zeros(0)
    before = np.maximum(seen.index - 1, 0)
    moved = np.hypot(
        samples.x[seen.index] - samples.x[before], samples.y[seen.index] - samples.y[before]
    )
    ranges = np.hypot(*(seen.end - seen.start).T)
    turned = np.abs(samples.yaw[seen.index] - samples.yaw[before])
    turned[1:] += np.abs(np.diff(seen.turned))  # a servo's, from one reading to the next
    turned *= ranges
    found: Floats = GAP_M + 2 * (moved + np.minimum(turned, MOST_TURNED_M))
    return found


def _pieces(points: Floats, gaps: Floats, settings: ConvertSettings) -> Iterator[Ints]:
    """Yield which points lie on one wall, wall by wall."""
    least, error = settings.wall_hits, settings.wall_error
    if len(points) < least:
        return
    seeds = np.flatnonzero(_may_begin(points, gaps, least, error))
    ways = (points[:, 0].tolist(), points[:, 1].tolist(), gaps.tolist())
    first = 0
    while (at := int(np.searchsorted(seeds, first))) < len(seeds):
        first = int(seeds[at])
        inside = _grown(points, ways, first, least, error)
        if inside is not None and _extent(points[inside]) >= settings.wall_length:
            yield inside
            first = int(inside[-1]) + 1
        else:
            first += 1


def _may_begin(points: Floats, gaps: Floats, least: int, error: float) -> Flags:
    """Return where so many points in a row, without a gap, may lie on one line, (n - least + 1,).

    They must reach some way, and none may lie far off the line from the first to the last.
    """
    jumps = np.hypot(*np.diff(points, axis=0).T) > gaps[1:]
    whole = ~sliding_window_view(jumps, least - 1).any(axis=1)
    seeds = sliding_window_view(points, least, axis=0)  # (n - least + 1, 2, least)
    extent = np.hypot(*np.ptp(seeds, axis=2).T)
    step = seeds - seeds[:, :, :1]
    (dx, dy), length = step[:, :, -1].T, np.hypot(*step[:, :, -1].T)
    off = np.abs(step[:, 1] * dx[:, None] - step[:, 0] * dy[:, None]).max(axis=1)
    flat: Flags = whole & (extent >= error) & (length > 0) & (off <= 2 * error * length)
    return flat


def _grown(
    points: Floats, ways: tuple[list[float], ...], first: int, least: int, error: float
) -> Ints | None:
    """Return the points of a wall that begins with the first; None where none does.

    Parameters
    ----------
    ways
        The points' x and y, and how far each may lie from the one before, as plain numbers.
    """
    seed = points[first : first + least]
    line = fitted(seed)
    if (line.off(seed) > error).any():
        return None
    xs, ys, gaps = ways
    inside = list(range(first, first + least))
    strays, refit, missed = 0, 2 * least, 0.0
    for number in range(first + least, len(points)):
        x, y = xs[number], ys[number]
        on_line = abs((y - line.y) * line.dx - (x - line.x) * line.dy) <= error
        last = inside[-1]
        if on_line and math.hypot(x - xs[last], y - ys[last]) <= gaps[number] + missed:
            inside.append(number)
            strays, missed = 0, 0.0
            if len(inside) >= refit:  # the longer the wall, the surer its line
                line = fitted(points[inside])
                refit *= 2
        else:
            strays += 1
            missed += gaps[number] - GAP_M
            if strays > STRAYS:
                break
    chosen = np.array(inside)
    line = fitted(points[chosen])
    chosen = chosen[line.off(points[chosen]) <= error]
    return chosen if len(chosen) >= least else None


def _extent(points: Floats) -> float:
    return float(np.hypot(*np.ptp(points, axis=0)))


def _stops(line: _Line, seen: Hits, last: int) -> bool:
    """Whether the next two readings went through where the wall would go on."""
    beyond = 0
    for number in range(last + 1, min(last + 3, len(seen.index))):
        (x, y), (x2, y2) = seen.start[number], seen.end[number]
        before = (y - line.y) * line.dx - (x - line.x) * line.dy
        behind = (y2 - line.y) * line.dx - (x2 - line.x) * line.dy
        beyond += before * behind < 0 and abs(behind) > GAP_M
    return beyond == 2
