"""What records saw, laid at the robot's true poses: the map if every pose were known."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Mapping

import numpy as np

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
    """Lay out what was seen between two poses, along and across the true run.

    Places are complex numbers, so that a division by the run's direction tells along from across.
    """
    here, there = complex(start[X], start[Y]), complex(end[X], end[Y])
    before, unit = complex(logged.start.x, logged.start.y), complex(*logged.unit)
    turned = cmath.rect(1.0, math.radians(float(start[HEADING]) - logged.start.heading_deg))
    length = abs(there - here)
    stretch = length / logged.distance if logged.is_run else 1.0
    # Where the wheels turned and the robot did not move, its heading tells the way.
    ahead = (there - here) / length if logged.is_run and length else unit * turned

    def place(x: float, y: float) -> tuple[float, float]:
        off = (complex(x, y) - before) / unit
        at = here + complex(stretch * off.real, off.imag) * ahead
        return at.real, at.imag

    for _, sighting in logged.seen:
        if isinstance(sighting, Wall):
            yield (*place(sighting.x, sighting.y), *place(sighting.x2, sighting.y2))
        elif isinstance(sighting, Beam) and sighting.hit:
            hit = place(sighting.x2, sighting.y2)
            yield (*hit, *hit)
