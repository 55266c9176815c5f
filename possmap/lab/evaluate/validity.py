"""Validity of bounds: cells binned by what the map says of them, and how often a wall is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from possmap.lab.evaluate.raster import Flags, Floats, Ints

BINS = 10


@dataclass(frozen=True, slots=True)
class Bin:
    """Cells of which the map says about the same.

    low, high : the bin's bounds.
    mean : of what the map says of its cells.
    wall, wall_10cm, wall_30cm : share of cells with a true wall in it, within 0.1 m and 0.3 m.
    wall_local : share with a wall within the local error rectangle.
    """

    low: float
    high: float
    cells: int
    mean: float
    wall: float
    wall_10cm: float
    wall_30cm: float
    wall_local: float


def of_lower_bound(values: Floats, walls: Mapping[str, Flags]) -> tuple[Bin, ...]:
    """Bin cells by Bel: those for which nothing speaks (0), then (0, 0.1] to (0.9, 1].

    walls : by the names of a bin's last four fields, whether a wall is there.
    """
    return _binned(values, np.ceil(values * BINS).astype(np.int64), [(0.0, 0.0), *_tenths()], walls)


def of_upper_bound(values: Floats, walls: Mapping[str, Flags]) -> tuple[Bin, ...]:
    """Bin cells by Pl: [0, 0.1) to [0.9, 1), then those that nobody denies (1)."""
    return _binned(
        values, np.floor(values * BINS).astype(np.int64), [*_tenths(), (1.0, 1.0)], walls
    )


def _tenths() -> list[tuple[float, float]]:
    return [(k / BINS, (k + 1) / BINS) for k in range(BINS)]


def _binned(
    values: Floats, which: Ints, edges: list[tuple[float, float]], walls: Mapping[str, Flags]
) -> tuple[Bin, ...]:
    """Return the bins that hold cells."""
    size = len(edges)
    which = np.clip(which, 0, size - 1)
    cells, sums = np.bincount(which, minlength=size), np.bincount(which, values, size)
    hits = {name: np.bincount(which, flags, size) for name, flags in walls.items()}
    return tuple(
        Bin(
            low, high, int(cells[k]), float(sums[k] / cells[k]),
            **{name: float(hit[k] / cells[k]) for name, hit in hits.items()},
        )
        for k, (low, high) in enumerate(edges)
        if cells[k]
    )  # fmt: skip
