"""Segments as rows of numbers: what a compiled kernel reads, and what processes hand each other."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from possmap.core.evidence import Segment, Swath
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import Floats

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
