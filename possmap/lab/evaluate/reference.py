"""The ceiling: the map that the same records would draw if every pose were known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from possmap.core.correction import CorrectedStretch
from possmap.core.records import Beam, PartialMap, Wall
from possmap.core.track import Stretch, stretches
from possmap.lab.evaluate.raster import Floats, Segments
from possmap.lab.evaluate.tracks import HEADING, X, Y


def true_walls(version: PartialMap, track: Floats, rows: Mapping[int, int]) -> Segments:
    """Return what an excursion's wall and beam records saw, laid at its true poses [m].

    Parameters
    ----------
    rows
        The row of the true track for each pose record, by index; a stretch needs both its ends.
    """
    index_of = {id(record): index for index, record in enumerate(version.records)}
    seen: list[tuple[float, float, float, float]] = []
    for stretch in stretches(version.records):
        start, end = index_of[id(stretch.start)], stretch.end_index
        if start in rows and end in rows:
            seen += _seen(stretch, track[rows[start]], track[rows[end]])
    return np.array(seen, dtype=np.float64).reshape(-1, 4)


def _seen(
    logged: Stretch, start: Floats, end: Floats
) -> Iterator[tuple[float, float, float, float]]:
    """Lay out what was seen between two poses, along and across the true run."""
    there = _laid(logged, start, end)
    for _, sighting in logged.seen:
        if isinstance(sighting, Wall):
            yield (
                *there.place(sighting.x, sighting.y),
                *there.place(sighting.x2, sighting.y2),
            )
        elif isinstance(sighting, Beam) and sighting.hit:
            hit = there.place(sighting.x2, sighting.y2)
            yield (*hit, *hit)


def _laid(logged: Stretch, start: Floats, end: Floats) -> CorrectedStretch:
    """Return a stretch at its true poses: a correction that knows the truth."""
    step_x, step_y = float(end[X] - start[X]), float(end[Y] - start[Y])
    length = math.hypot(step_x, step_y)
    turned = math.radians(float(start[HEADING]) - logged.start.heading_deg)
    cos, sin = math.cos(turned), math.sin(turned)
    if logged.is_run and length:
        along, stretch = (step_x / length, step_y / length), length / logged.distance
    elif logged.is_run:  # the wheels turned, the robot did not move: its heading tells the way
        unit_x = (logged.end.x - logged.start.x) / logged.distance
        unit_y = (logged.end.y - logged.start.y) / logged.distance
        along = (unit_x * cos - unit_y * sin, unit_x * sin + unit_y * cos)
        stretch = 0.0
    else:
        along, stretch = (1.0, 0.0), 1.0
    return CorrectedStretch(
        logged=logged,
        start=(float(start[X]), float(start[Y])),
        end=(float(end[X]), float(end[Y])),
        length=length,
        along=along,
        stretch=stretch,
        rotation=(cos, sin),
        heading_deg=float(end[HEADING]),
    )
