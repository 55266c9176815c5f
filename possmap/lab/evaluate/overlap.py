"""Whether truth and map share a frame: robots that know their place see its walls, and no others.

Nor do they drive through them. Neither needs the map's cells, nor any true track.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from possmap.core.evidence import Segment
from possmap.core.lattice import Window
from possmap.lab.evaluate.raster import Floats, Segments, cells_of, extent_of
from possmap.lab.evaluate.strokes import Outing, line_cells, strokes

SURE_M = 0.15
"""Robots know their place where both half-widths are smaller [m]."""

LEAST_M = 0.5
"""Shorter runs are not asked: they hardly ever meet a wall [m]."""


NEAR_M = 0.5
"""So near to a true wall lies what a robot that knows its place saw of one [m]."""


class Witnesses(NamedTuple):
    """How many things robots that know their place report, and how many the truth belies."""

    asked: int
    belied: int


def crossings(outings: Iterable[Outing], walls: Segments, resolution: float) -> Witnesses:
    """Count the runs of robots that know their place, and those that go through a true wall."""
    runs = list(_sure_runs(outings))
    if not runs or not len(walls):
        return Witnesses(len(runs), 0)
    window = _extent(runs, resolution).intersection(extent_of(walls, resolution))
    solid = cells_of(walls, window, resolution).ravel()
    through = (solid[line_cells(run, window, resolution).flat(window)].any() for run in runs)
    return Witnesses(len(runs), sum(map(bool, through)))


def _sure_runs(outings: Iterable[Outing]) -> Iterator[Segment]:
    for outing in outings:
        for stroke in strokes(outing):
            run = stroke.driven
            if run is not None and _knows(run) and _reach(run) >= LEAST_M:
                yield run


def _knows(run: Segment) -> bool:
    one, other = run.rect0, run.rect1
    return max(one.half_x, one.half_y, other.half_x, other.half_y) < SURE_M


def _reach(run: Segment) -> float:
    return max(abs(run.x1 - run.x0), abs(run.y1 - run.y0))


def sightings(outings: Iterable[Outing], walls: Segments) -> Witnesses:
    """Count what robots that know their place saw of walls, and what of it lies near none."""
    seen = [hit for outing in outings for one in strokes(outing) for hit in one.hits if _knows(hit)]
    return astray(np.array([(s.x0, s.y0, s.x1, s.y1) for s in seen]).reshape(-1, 4), walls)


def astray(seen: Segments, walls: Segments) -> Witnesses:
    """Count walls that were seen, and those whose middle lies near no true wall."""
    middles = (seen[:, :2] + seen[:, 2:]) / 2
    parts = np.array_split(middles, len(middles) // 64 + 1)
    return Witnesses(len(seen), sum(_farther(part, walls) for part in parts))


def _farther(places: Floats, walls: Segments) -> int:
    """Return how many places are farther than NEAR_M from every wall."""
    start, step = walls[:, :2], walls[:, 2:] - walls[:, :2]
    square = np.maximum((step**2).sum(axis=1), np.finfo(float).tiny)
    away = places[:, None] - start
    share = np.clip((away * step).sum(axis=2) / square, 0, 1)
    distance = np.hypot(*np.moveaxis(away - share[:, :, None] * step, 2, 0))
    return int((distance.min(axis=1) > NEAR_M).sum()) if len(places) else 0


def _extent(runs: list[Segment], resolution: float) -> Window:
    return extent_of(np.array([(r.x0, r.y0, r.x1, r.y1) for r in runs]), resolution)
