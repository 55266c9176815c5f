"""Where the path of a run past walls stops denying walls: at those that it saw itself (METHOD §2).

With a gap of 0.12 m to a followed wall and half-widths of 0.2 m, the path's pyramid would otherwise
deny the very wall that the same run proves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.correction import CorrectedStretch
from possmap.core.lattice import HAIR, Window
from possmap.core.records import Wall

TOUCHING_M = 1e-9
"""Distances below this are rounding: the point lies on the line."""


class Placed(Protocol):
    """Where a wall record lies on the map, from (x, y) to (x2, y2) [m]."""

    @property
    def x(self) -> float: ...  # noqa: D102
    @property
    def y(self) -> float: ...  # noqa: D102
    @property
    def x2(self) -> float: ...  # noqa: D102
    @property
    def y2(self) -> float: ...  # noqa: D102


class ClipLine(NamedTuple):
    """The infinite line normal·p = offset; the run saw it from the side where normal·p is larger.

    one_sided : False where the run lies on the line, so that nothing is beyond it.
    """

    normal_x: float
    normal_y: float
    offset: float
    one_sided: bool

    def touch(self, resolution: float) -> float:
        """Return how far from the line the centre of a cell that it touches may lie [m]."""
        return resolution / 2 * (abs(self.normal_x) + abs(self.normal_y)) + HAIR * resolution


Clips: TypeAlias = Sequence[tuple[ClipLine, ...]]
"""The lines at which paths end, of some paths."""


def clip_lines(run: CorrectedStretch, walls: Mapping[int, Placed]) -> tuple[ClipLine, ...]:
    """Return the line of every wall record of the run, oriented towards the run's farther end.

    walls : the placed records, by index.
    """
    return tuple(
        _line(run, walls[index])
        for index, sighting in run.logged.seen
        if isinstance(sighting, Wall)
    )


def _line(run: CorrectedStretch, wall: Placed) -> ClipLine:
    length = math.hypot(wall.x2 - wall.x, wall.y2 - wall.y)
    if length > 0:
        normal_x, normal_y = -(wall.y2 - wall.y) / length, (wall.x2 - wall.x) / length
    else:
        normal_x, normal_y = _towards_point(run, wall.x, wall.y)
    offset = normal_x * wall.x + normal_y * wall.y
    first = normal_x * (run.start[0] - wall.x) + normal_y * (run.start[1] - wall.y)
    second = normal_x * (run.end[0] - wall.x) + normal_y * (run.end[1] - wall.y)
    seen_from = second if abs(second) > abs(first) + TOUCHING_M else first
    sign = -1.0 if seen_from < 0 else 1.0
    return ClipLine(sign * normal_x, sign * normal_y, sign * offset, abs(seen_from) > TOUCHING_M)


def _towards_point(run: CorrectedStretch, x: float, y: float) -> tuple[float, float]:
    """Return the direction of the shortest connection from the run to a point, or the run's own."""
    (x0, y0), (x1, y1) = run.start, run.end
    along = (x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)
    squared = run.length * run.length
    share = min(1.0, max(0.0, along / squared)) if squared else 0.0
    away_x, away_y = x - (x0 + share * (x1 - x0)), y - (y0 + share * (y1 - y0))
    distance = math.hypot(away_x, away_y)
    if distance <= TOUCHING_M:
        return run.along
    return away_x / distance, away_y / distance


def spared(window: Window, lines: tuple[ClipLine, ...], resolution: float) -> NDArray[np.bool_]:
    """Return which cells of ``window`` the path must say nothing of, shape (rows, columns).

    A cell is touched if its centre lies within c/2·(|n_x| + |n_y|) of the line, and a hair.
    """
    x = (np.arange(window.column0, window.column1) + 0.5) * resolution
    y = (np.arange(window.row0, window.row1) + 0.5) * resolution
    mask = np.zeros(window.shape, dtype=np.bool_)
    for line in lines:
        distance = line.normal_y * y[:, None] + (line.normal_x * x - line.offset)
        touch = line.touch(resolution)
        mask |= distance <= touch if line.one_sided else np.abs(distance) <= touch
    return mask


def line_table(clips: Clips, resolution: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the lines of clips as numbers, for a compiled kernel.

    Returns
    -------
    tuple
        Rows of normal_x, normal_y, offset, touch and one_sided, shape (lines, 5); and where each
        clip's rows begin, and the last one's end, shape (clips + 1,).
    """
    rows = [
        (line.normal_x, line.normal_y, line.offset, line.touch(resolution), line.one_sided)
        for lines in clips
        for line in lines
    ]
    starts = np.cumsum([0, *map(len, clips)], dtype=np.int64)
    return np.array(rows, dtype=np.float64).reshape(-1, 5), starts
