"""From rectangles and doors to walls: what a floor plan draws, as straight segments."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from possmap.truth.plans import Segments

Rectangle: TypeAlias = tuple[float, float, float, float]
"""x0, y0, x1, y1 [m], x0 < x1 and y0 < y1."""

Wall: TypeAlias = tuple[float, float, float, float]
"""x, y, x2, y2 [m], parallel to an axis, x <= x2 and y <= y2."""

_WALL, _DOOR = 0, 1


def sides(rectangle: Rectangle) -> list[Wall]:
    """Return the four sides of a rectangle: south, north, west, east."""
    x0, y0, x1, y1 = rectangle
    return [(x0, y0, x1, y0), (x0, y1, x1, y1), (x0, y0, x0, y1), (x1, y0, x1, y1)]


def united(walls: Iterable[Wall], doors: Iterable[Wall] = ()) -> Segments:
    """Return walls with none in two pieces and none drawn twice, and openings where doors are.

    Parameters
    ----------
    walls
        In any order; pieces of one line that touch or overlap become one.
    doors
        What is taken away, from every wall on the same line.
    """
    # By line, whether it runs along x and at which y (or x): where something begins or ends.
    steps: dict[tuple[bool, float], list[tuple[float, int, int]]] = defaultdict(list)
    for kind, pieces in ((_WALL, walls), (_DOOR, doors)):
        for x, y, x2, y2 in pieces:
            line, low, high = ((True, y), x, x2) if y == y2 else ((False, x), y, y2)
            steps[line] += [(low, kind, 1), (high, kind, -1)]
    found = [
        (low, at, high, at) if level else (at, low, at, high)
        for (level, at), on_line in sorted(steps.items())
        for low, high in _standing(on_line)
    ]
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def _standing(steps: list[tuple[float, int, int]]) -> Iterator[tuple[float, float]]:
    """Yield from where to where on one line there are walls, and no doors."""
    count, begin = [0, 0], None
    for place, here in groupby(sorted(steps), key=itemgetter(0)):
        for _, kind, step in here:
            count[kind] += step
        if begin is None and count[_WALL] and not count[_DOOR]:
            begin = place
        elif begin is not None and not (count[_WALL] and not count[_DOOR]):
            yield begin, place
            begin = None
