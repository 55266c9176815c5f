"""Straight lines as cells, by METHOD's own rule for a segment: truth and map share one lattice."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import HAIR, Window

Flags: TypeAlias = NDArray[np.bool_]
"""One yes or no per cell, shape (rows, columns), row 0 at the lowest y."""

Ints: TypeAlias = NDArray[np.int64]
Floats: TypeAlias = NDArray[np.float64]

Segments: TypeAlias = Floats
"""x, y, x2, y2 [m] of each, shape (n, 4)."""

AT_ONCE = 2**21
"""Stamps laid out together: bounds memory."""


def cells_of(segments: Segments, window: Window, resolution: float) -> Flags:
    """Return the cells of a window that segments touch: those of METHOD §2's stamps k = 0..n.

    n = max(1, ceil(max(|Δx|, |Δy|)/c - 1e-6)); the cell of P₀ + (k/n)(P₁ - P₀) is
    floor(p/c + 1e-6). Of segments that reach far beyond the window, only what matters is computed.
    """
    touched = np.zeros(window.shape, dtype=np.bool_)
    if not len(segments):
        return touched
    start, step = segments[:, :2], segments[:, 2:] - segments[:, :2]
    n = np.maximum(1, np.ceil(np.abs(step).max(axis=1) / resolution - HAIR)).astype(np.int64)
    first, last = within(segments, n, window, resolution)
    counts = np.maximum(0, last - first + 1)
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(segments):
        before = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, before + AT_ONCE, side="right")))
        owner = np.repeat(np.arange(begin, end), counts[begin:end])
        k = np.arange(len(owner)) + before - (ends - counts)[owner] + first[owner]
        places = start[owner] + (k / n[owner])[:, None] * step[owner]
        columns, rows = np.floor(places / resolution + HAIR).astype(np.int64).T
        inside = (rows >= window.row0) & (rows < window.row1)
        inside &= (columns >= window.column0) & (columns < window.column1)
        touched[rows[inside] - window.row0, columns[inside] - window.column0] = True
        begin = end
    return touched


def within(segments: Segments, n: Ints, window: Window, resolution: float) -> tuple[Ints, Ints]:
    """Return the first and last k of 0..n of each segment that may lie in a window, generously."""
    start, step = segments[:, :2], segments[:, 2:] - segments[:, :2]
    low = (np.array([window.column0, window.row0]) - 1) * resolution
    high = (np.array([window.column1, window.row1]) + 1) * resolution
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = (low - start) / step, (high - start) / step
    still = step == 0
    beside = still & ((start < low) | (start > high))
    enter = np.where(still, np.where(beside, 2.0, 0.0), np.minimum(one, other)).max(axis=1)
    leave = np.where(still, 1.0, np.maximum(one, other)).min(axis=1)
    first = np.floor(np.clip(enter, 0, 2) * n).astype(np.int64)
    last = np.ceil(np.clip(leave, -1, 1) * n).astype(np.int64)
    return first, last


def extent_of(segments: Segments, resolution: float) -> Window:
    """Return the smallest window that holds all stamps of some segments, at least one."""
    cells = np.floor(segments.reshape(-1, 2) / resolution + HAIR).astype(np.int64)
    (column0, row0), (column1, row1) = cells.min(axis=0).tolist(), cells.max(axis=0).tolist()
    return Window(row0, row1 + 1, column0, column1 + 1)


def grown(window: Window, cells: int) -> Window:
    """Return a window with a margin."""
    return Window(
        window.row0 - cells, window.row1 + cells, window.column0 - cells, window.column1 + cells
    )
