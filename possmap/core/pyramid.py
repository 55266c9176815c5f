"""The pyramid of one position, and the stamps of a segment (METHOD §2; the paper's §4.1).

For half-widths (hx, hy) around a position, a cell k columns and l rows away gets N = min(N_x, N_y):

    height_x = max(0, 1 - hx / max_error)
    N_x = height_x · max(0, 1 - |k|·c / (hx + c/2))

and both factors become 16-bit integers, floor(65535·N_x + 0.5), before the minimum is taken.

Kernels read segments as rows of numbers, and processes hand them to each other so: ``table_of``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Segment, Swath
from possmap.core.lattice import HAIR
from possmap.core.propagation import ErrorRectangle

MOST_LOGGED = 1e6
"""No number of a log is larger (docs/logs.md) [m]."""

FULL = 65535
"""The 16-bit number of certainty."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Values = NDArray[np.uint16]
Weights = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Stamps:
    """Some consecutive stamps of a segment, arrays of one length.

    rows, columns : the cells of their centres.
    half_x, half_y : half-widths there [m].
    """

    rows: Ints
    columns: Ints
    half_x: Floats
    half_y: Floats

    def reach(self, resolution: float) -> tuple[Ints, Ints]:
        """Return how many rows and columns away from its centre each stamp may be positive."""
        return _reach(self.half_y, resolution), _reach(self.half_x, resolution)


def _reach(half: Floats, resolution: float) -> Ints:
    reach: Ints = np.ceil(half / resolution + 0.5).astype(np.int64) - 1
    return reach


def count_of(segment: Segment, resolution: float) -> int:
    """Return METHOD's n: the segment's stamps are k = 0..n."""
    longest = max(abs(segment.x1 - segment.x0), abs(segment.y1 - segment.y0))
    return max(1, math.ceil(longest / resolution - HAIR))


def relevant(segment: Segment, resolution: float, max_error: float) -> tuple[int, int] | None:
    """Return the first and last k whose pyramid has a height, or None if none has.

    Half-widths are linear in k, growing or shrinking, so those below ``max_error`` are consecutive.
    """
    n = 0 if _is_point(segment) else count_of(segment, resolution)
    one, other = segment.rect0, segment.rect1
    sides = ((one.half_x, other.half_x), (one.half_y, other.half_y))

    def too_wide(k: int) -> bool:
        share = k / max(1, n)
        return any(half0 + share * (half1 - half0) >= max_error for half0, half1 in sides)

    first, last = 0, n
    for half0, half1 in sides:
        if min(half0, half1) >= max_error:
            return None
        if max(half0, half1) > max_error:
            crossing = n * ((max_error - half0) / (half1 - half0))
            if half1 > half0:
                last = min(last, math.ceil(crossing) + 1)
            else:
                first = max(first, math.floor(crossing) - 1)
    # One too many has no height, but may be so wide that looking at its tiles takes for ever.
    while first <= last and too_wide(first):
        first += 1
    while first <= last and too_wide(last):
        last -= 1
    return (first, last) if first <= last else None


def _is_point(segment: Segment) -> bool:
    return segment.x0 == segment.x1 and segment.y0 == segment.y1


def stamps(segment: Segment, first: int, last: int, resolution: float) -> Stamps:
    """Return stamps k = first..last of a segment: rectangles and places interpolated at k/n."""
    share = np.arange(first, last + 1) / count_of(segment, resolution)

    def between(start: float, end: float) -> Floats:
        at: Floats = start + share * (end - start)
        return at

    def cells(start: float, end: float) -> Ints:
        cell: Ints = np.floor(between(start, end) / resolution + HAIR).astype(np.int64)
        return cell

    return Stamps(
        rows=cells(segment.y0, segment.y1),
        columns=cells(segment.x0, segment.x1),
        half_x=between(segment.rect0.half_x, segment.rect1.half_x),
        half_y=between(segment.rect0.half_y, segment.rect1.half_y),
    )


def profiles(
    centres: Ints, half: Floats, cells: Ints, resolution: float, max_error: float
) -> Values:
    """Return the quantised profile of each stamp along one axis.

    Parameters
    ----------
    centres, half
        Row (or column) of each stamp's centre, and its half-width there [m]; shape (stamps,).
    cells
        The rows (or columns) asked for, shape (cells,).

    Returns
    -------
    Values
        Shape (stamps, cells). Computed in doubles, in the order METHOD §2 writes them.
    """
    away = np.abs(cells - centres[:, None])
    height = np.maximum(0.0, 1 - half / max_error)[:, None]
    slope = np.maximum(0.0, 1 - (away * resolution) / (half + resolution / 2)[:, None])
    return quantised(height * slope)


def quantised(values: Floats) -> Values:
    """Return values in [0, 1] as 16-bit integers: floor(65535·v + 0.5)."""
    found: Values = np.floor(FULL * values + 0.5).astype(np.uint16)
    return found


FARTHEST = 2**50
"""Cells from the origin: beyond, doubles do not tell one cell from its neighbour for long."""


COLUMNS = (
    "x0", "y0", "x1", "y1", "half_x0", "half_y0", "half_x1", "half_y1",
    "max_error", "width", "is_point", "factor",
)  # fmt: skip
"""The doubles of a row: Segment's fields, ``max_error`` [m], and a swath's width, 0 if it has none.

``_stamping.c`` lists them in the same order.
"""


def table_of(segments: Iterable[Segment], max_error: float) -> Floats:
    """Return segments as an array of shape (segments, len(COLUMNS)).

    max_error : the error beyond which a stamp has no height [m].
    """
    rows = [
        (
            one.x0, one.y0, one.x1, one.y1,
            one.rect0.half_x, one.rect0.half_y, one.rect1.half_x, one.rect1.half_y,
            max_error,
            one.swath.width if one.swath else 0.0,
            one.x0 == one.x1 and one.y0 == one.y1,
            one.swath.factor if one.swath else 0.0,
        )
        for one in segments
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, len(COLUMNS))


def segment_of(row: Floats) -> Segment:
    """Return the segment of a row, but for the number of its record."""
    x0, y0, x1, y1, half_x0, half_y0, half_x1, half_y1, _, width, _, factor = row.tolist()
    return Segment(
        0, x0, y0, x1, y1,
        ErrorRectangle(half_x0, half_y0), ErrorRectangle(half_x1, half_y1),
        Swath(width, factor) if width else None,
    )  # fmt: skip
