"""A window read in bands of rows, never whole: only tiles that hold anything are looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from possmap.core.lattice import TILE, Window
from possmap.grid.grid import Grid

Marks: TypeAlias = NDArray[np.bool_]

MOST = 1 << 22
"""Cells of a band, at most: small numbers for them fit in memory beside floats for a few tiles."""


def bands(window: Window, from_top: bool = False, most: int = MOST) -> Iterator[Window]:
    """Cut a window into bands from its lowest row up, or from its highest down.

    A band lies within one row of tiles: unless the window is very wide, each tile is read once.
    Bands are as wide as the window, unless one row has more than ``most`` cells: then pieces of it
    follow each other.
    """
    columns = max(1, window.shape[1])
    height = TILE
    while height > 1 and height * columns > most:
        height //= 2  # so a border of tiles stays a border of bands
    starts = range(window.row0 // height, -(-window.row1 // height))
    for start in reversed(starts) if from_top else starts:
        row0, row1 = max(window.row0, start * height), min(window.row1, (start + 1) * height)
        for column in range(window.column0, window.column1, most):
            yield Window(row0, row1, column, min(column + most, window.column1))


def filled(
    grid: Grid,
    band: Window,
    value: Callable[[Window], NDArray[Any]],
    ignorance: int,
    dtype: DTypeLike,
) -> NDArray[Any]:
    """Return an array of a band's shape: ``value`` where tiles hold anything, else ``ignorance``.

    value : of a window of at most a few tiles.
    """
    found = np.full(band.shape, ignorance, dtype=dtype)
    for area in grid.tiles.areas(band):
        found[area.slices_in(band)] = value(area)
    return found


def known(grid: Grid, area: Window) -> Marks:
    """Return which cells of an area hold evidence of any kind."""
    return (grid.necessity(area) > 0) | (grid.possibility(area) < 1) | (grid.points(area) > 0)


def holds_evidence(grid: Grid, window: Window) -> bool:
    """Whether any cell of a window holds evidence."""
    return any(bool(known(grid, area).any()) for area in grid.tiles.areas(window))
