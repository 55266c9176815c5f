"""How far each cell is from the nearest true wall, exactly, up to a bound."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import HAIR
from possmap.lab.evaluate.raster import Flags

Squares = NDArray[np.integer]
"""Squared distances, in cells."""


def squared_distances(walls: Flags, reach: int) -> Squares:
    """Return the squared distance from each cell's centre to the nearest wall cell's, in cells.

    What lies farther than ``reach`` cells has some larger number. First along the columns, then
    the best of each row's neighbours: exact, since distances of a column do not depend on the row.
    """
    kind = np.uint16 if 2 * (reach + 1) ** 2 < 2**16 else np.int64
    up = np.full(walls.shape, reach + 1, dtype=kind)
    up[walls] = 0
    for row in range(1, len(up)):
        np.minimum(up[row], up[row - 1] + 1, out=up[row])
    for row in range(len(up) - 2, -1, -1):
        np.minimum(up[row], up[row + 1] + 1, out=up[row])
    up *= up
    nearest = up.copy()
    for away in range(1, min(reach, walls.shape[1] - 1) + 1):
        square = kind(away * away)
        np.minimum(nearest[:, away:], up[:, :-away] + square, out=nearest[:, away:])
        np.minimum(nearest[:, :-away], up[:, away:] + square, out=nearest[:, :-away])
    return nearest


def limit(tolerance_m: float, resolution: float) -> float:
    """Return the largest squared distance within a tolerance, in cells; rounding is forgiven."""
    return (tolerance_m / resolution + HAIR) ** 2


def reach_of(tolerance_m: float, resolution: float) -> int:
    """Return how many cells away along an axis a cell within the tolerance may be."""
    return math.floor(tolerance_m / resolution + HAIR)


def disc(tolerance_m: float, resolution: float) -> list[tuple[int, int]]:
    """Return the offsets (rows, columns) of all cells within a tolerance."""
    reach, most = reach_of(tolerance_m, resolution), limit(tolerance_m, resolution)
    span = range(-reach, reach + 1)
    return [(row, column) for row in span for column in span if row**2 + column**2 <= most]
