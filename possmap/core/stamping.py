"""Which stamps fall into which tile, and their maximum in an array (METHOD §2).

A stamp at a time over array slices: plain and literal. ``_stamping.c`` gives the same integers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from possmap.core import swath
from possmap.core.evidence import Segment
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.pyramid import Ints, Stamps, Values, profiles, quantised, relevant, stamps

LISTED_AT_ONCE = 512
"""Stamps whose tiles are looked up together."""

STAMPED_AT_ONCE = 64
"""Stamps whose profiles are computed together: bounds memory, whatever a record claims."""


class Piece(NamedTuple):
    """Stamps k = first..last of a segment: all that touch some tile, perhaps a few that do not."""

    segment: Segment
    first: int
    last: int


def pieces_of(
    segment: Segment, resolution: float, max_error: float
) -> Iterator[tuple[TileKey, Piece]]:
    """Yield each tile that a segment may touch, with the stamps that do; a tile may come twice."""
    span = relevant(segment, resolution, max_error)
    if span is None:
        return
    for first in range(span[0], span[1] + 1, LISTED_AT_ONCE):
        some = stamps(segment, first, min(span[1], first + LISTED_AT_ONCE - 1), resolution)
        reach_rows, reach_columns = _reach(segment, some, resolution)
        low_row, high_row = (some.rows - reach_rows) // TILE, (some.rows + reach_rows) // TILE
        low_column = (some.columns - reach_columns) // TILE
        high_column = (some.columns + reach_columns) // TILE
        for row in range(int(low_row.min()), int(high_row.max()) + 1):
            in_row = (low_row <= row) & (row <= high_row)
            for column in range(int(low_column.min()), int(high_column.max()) + 1):
                touching = np.flatnonzero(in_row & (low_column <= column) & (column <= high_column))
                if touching.size:
                    found = Piece(segment, first + int(touching[0]), first + int(touching[-1]))
                    yield TileKey(row, column), found


def _reach(segment: Segment, some: Stamps, resolution: float) -> tuple[Ints, Ints]:
    """Return how many rows and columns away from its centre each stamp may say something."""
    if segment.swath is None:
        return some.reach(resolution)
    cells = swath.reach(some, segment, resolution)
    return cells, cells


def extent(piece: Piece, resolution: float) -> Window:
    """Return a window of all cells that a piece can touch; cells are monotone along a segment."""
    first = stamps(piece.segment, piece.first, piece.first, resolution)
    last = stamps(piece.segment, piece.last, piece.last, resolution)
    rows = [int(first.rows[0]), int(last.rows[0])]
    columns = [int(first.columns[0]), int(last.columns[0])]
    a_row, a_column = _reach(piece.segment, first, resolution)
    b_row, b_column = _reach(piece.segment, last, resolution)
    reach_row = max(int(a_row[0]), int(b_row[0]))
    reach_column = max(int(a_column[0]), int(b_column[0]))
    return Window(
        min(rows) - reach_row,
        max(rows) + reach_row + 1,
        min(columns) - reach_column,
        max(columns) + reach_column + 1,
    )


def stamp(block: Values, window: Window, piece: Piece, resolution: float, max_error: float) -> None:
    """Raise ``block`` to the maximum of itself and the piece's stamps, or swath, in place.

    Parameters
    ----------
    block
        16-bit values of the cells of ``window``, shape (rows, columns).
    piece
        Stamps, in the window or not.
    max_error
        The error beyond which a stamp has no height [m].
    """
    if piece.segment.swath is not None:
        part = extent(piece, resolution).intersection(window)
        if part.cells:
            swath.sweep(block[part.slices_in(window)], part, piece.segment, resolution, max_error)
        return
    for start in range(piece.first, piece.last + 1, STAMPED_AT_ONCE):
        stop = min(piece.last, start + STAMPED_AT_ONCE - 1)
        some = stamps(piece.segment, start, stop, resolution)
        reach_rows, reach_columns = some.reach(resolution)
        bottom = np.maximum(some.rows - reach_rows, window.row0)
        top = np.minimum(some.rows + reach_rows + 1, window.row1)
        left = np.maximum(some.columns - reach_columns, window.column0)
        right = np.minimum(some.columns + reach_columns + 1, window.column1)
        inside = (bottom < top) & (left < right)
        if not inside.any():
            continue
        if not (reach_rows.any() or reach_columns.any()):
            # Stamps of one cell: long walls without any error have millions of them.
            at = some.rows[inside] - window.row0, some.columns[inside] - window.column0
            higher = np.maximum(some.half_x[inside], some.half_y[inside])
            np.maximum.at(block, at, quantised(np.maximum(0.0, 1 - higher / max_error)))
            continue
        row0, column0 = int(bottom[inside].min()), int(left[inside].min())
        rows = np.arange(row0, int(top[inside].max()))
        columns = np.arange(column0, int(right[inside].max()))
        up = profiles(some.rows, some.half_y, rows, resolution, max_error)[:, :, None]
        across = profiles(some.columns, some.half_x, columns, resolution, max_error)[:, None, :]
        corner = block[row0 - window.row0 :, column0 - window.column0 :]
        bounds = zip(
            np.flatnonzero(inside).tolist(),
            (bottom[inside] - row0).tolist(),
            (top[inside] - row0).tolist(),
            (left[inside] - column0).tolist(),
            (right[inside] - column0).tolist(),
            strict=True,
        )
        for k, low, high, near, far in bounds:
            target = corner[low:high, near:far]
            np.maximum(target, np.minimum(up[k, low:high], across[k, :, near:far]), out=target)
