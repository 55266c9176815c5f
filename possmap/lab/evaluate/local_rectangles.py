"""The local error rectangle of a cell: that of the record contributing most to the cell's N."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from possmap.core import kernel
from possmap.core.evidence import Findings, Layer, Segment
from possmap.core.lattice import Window
from possmap.core.pyramid import Values, count_of, relevant
from possmap.core.stamping import Piece, extent
from possmap.lab.evaluate.raster import Floats

Reach = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Strongest:
    """Of each cell of a window, the strongest single report of a wall.

    value : the 16-bit value of its stamp there; 0: none speaks for a wall.
    up, across : rows and columns that its rectangle reaches, wholly or in part, from the cell: at
        the place of the segment that is nearest to the cell.
    """

    value: Values
    up: Reach
    across: Reach

    @classmethod
    def blank(cls, window: Window) -> Strongest:
        """Return what is known before any report."""
        return cls(*(np.zeros(window.shape, dtype=np.uint16) for _ in range(3)))


def strongest(excursions: Iterable[Findings], window: Window, resolution: float) -> Strongest:
    """Return the strongest report of each cell; of two equal ones the smaller rectangle's."""
    best = Strongest.blank(window)
    for found in excursions:
        for one in found.evidence:
            if one.layer is Layer.WALLS:
                for segment in one.segments:
                    _report(best, window, segment, resolution, found.model.max_error)
    return best


def _report(
    best: Strongest, window: Window, segment: Segment, resolution: float, max_error: float
) -> None:
    """Let one segment take the cells where it says more than what spoke before, in place."""
    span = relevant(segment, resolution, max_error)
    if span is None:
        return
    piece = Piece(segment, *span)
    region = extent(piece, resolution).intersection(window)
    if not region.cells:
        return
    values: Values = np.zeros(region.shape, dtype=np.uint16)
    kernel.stamp(values, region, piece, resolution, max_error)
    cut = region.slices_in(window)
    rows, columns = np.nonzero((values >= best.value[cut]) & (values > 0))
    up, across = _reach(segment, span, region, rows, columns, resolution)
    at = rows + cut[0].start, columns + cut[1].start
    value = values[rows, columns]
    smaller = up.astype(np.int64) + across < best.up[at].astype(np.int64) + best.across[at]
    wins = (value > best.value[at]) | smaller
    at = at[0][wins], at[1][wins]
    best.value[at], best.up[at], best.across[at] = value[wins], up[wins], across[wins]


def _reach(
    segment: Segment,
    span: tuple[int, int],
    region: Window,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    resolution: float,
) -> tuple[Reach, Reach]:
    """Return how far the rectangle reaches at the place of a segment nearest to each cell."""
    x = (columns + region.column0 + 0.5) * resolution - segment.x0
    y = (rows + region.row0 + 0.5) * resolution - segment.y0
    dx, dy = segment.x1 - segment.x0, segment.y1 - segment.y0
    square, n = dx * dx + dy * dy, count_of(segment, resolution)
    share = (x * dx + y * dy) / square if square else np.zeros(len(rows))
    share = np.clip(share, span[0] / n, span[1] / n)  # only where it has a height

    def cells(half0: float, half1: float) -> Reach:
        half: Floats = half0 + share * (half1 - half0)
        reach: Floats = np.ceil(half / resolution + 0.5) - 1
        held: Reach = np.minimum(reach, np.iinfo(np.uint16).max).astype(np.uint16)
        return held

    one, other = segment.rect0, segment.rect1
    return cells(one.half_y, other.half_y), cells(one.half_x, other.half_x)
