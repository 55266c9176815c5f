"""From rectangles and doors to walls: what a floor plan draws, as straight segments."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np

from possmap.truth.plans import Segments

Rectangle: TypeAlias = tuple[float, float, float, float]
"""x0, y0, x1, y1 [m], x0 < x1 and y0 < y1."""

Wall: TypeAlias = tuple[float, float, float, float]
"""x, y, x2, y2 [m], parallel to an axis, x <= x2 and y <= y2."""


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
    standing, open_ = _by_line(walls), _by_line(doors)
    pieces = [
        (low, at, high, at) if level else (at, low, at, high)
        for (level, at), spans in sorted(standing.items())
        for low, high in _without(_joined(spans), _joined(open_.get((level, at), [])))
    ]
    return np.array(pieces, dtype=np.float64).reshape(-1, 4)


_Span: TypeAlias = tuple[float, float]
_Line: TypeAlias = tuple[bool, float]
"""Whether it runs along x, and at which y (or x)."""


def _by_line(walls: Iterable[Wall]) -> dict[_Line, list[_Span]]:
    lines: dict[_Line, list[_Span]] = defaultdict(list)
    for x, y, x2, y2 in walls:
        if y == y2:
            lines[True, y].append((x, x2))
        else:
            lines[False, x].append((y, y2))
    return lines


def _joined(spans: list[_Span]) -> list[_Span]:
    joined: list[_Span] = []
    for low, high in sorted(spans):
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(high, joined[-1][1]))
        else:
            joined.append((low, high))
    return joined


def _without(spans: list[_Span], gaps: list[_Span]) -> Iterator[_Span]:
    """Yield what gaps leave of spans; both sorted, and free of overlap among themselves."""
    first = 0
    for begin, end in spans:
        while first < len(gaps) and gaps[first][1] <= begin:
            first += 1
        low, gap = begin, first
        while gap < len(gaps) and gaps[gap][0] < end:
            if gaps[gap][0] > low:
                yield low, gaps[gap][0]
            low = gaps[gap][1]
            gap += 1
        if low < end:
            yield low, end
