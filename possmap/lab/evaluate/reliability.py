"""Reliability: cells binned by what the map says of them, and how often a wall is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from possmap.lab.evaluate.raster import Flags, Floats

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


def by_necessity(values: Floats, walls: Mapping[str, Flags]) -> tuple[Bin, ...]:
    """Bin cells by N: those of which nobody says anything (N = 0), then (0, 0.1] to (0.9, 1].

    walls : by the names of a bin's last four fields, whether a wall is there.
    """
    which = np.clip(np.ceil(values * BINS), 0, BINS).astype(np.int64)
    edges = [(0.0, 0.0), *((k / BINS, (k + 1) / BINS) for k in range(BINS))]
    return _binned(values, which, edges, walls)


def by_possibility(values: Floats, walls: Mapping[str, Flags]) -> tuple[Bin, ...]:
    """Bin cells by Π: [0, 0.1) to [0.9, 1), then those that nobody denies (Π = 1)."""
    which = np.clip(np.floor(values * BINS), 0, BINS).astype(np.int64)
    edges = [*((k / BINS, (k + 1) / BINS) for k in range(BINS)), (1.0, 1.0)]
    return _binned(values, which, edges, walls)


def _binned(
    values: Floats, which: np.ndarray, edges: list[tuple[float, float]], walls: Mapping[str, Flags]
) -> tuple[Bin, ...]:
    """Return the bins that hold cells."""
    size = len(edges)
    cells = np.bincount(which, minlength=size)
    sums = np.bincount(which, values, size)
    hits = {name: np.bincount(which, flags, size) for name, flags in walls.items()}
    return tuple(
        Bin(
            low,
            high,
            int(cells[k]),
            float(sums[k] / cells[k]),
            **{name: float(hit[k] / cells[k]) for name, hit in hits.items()},
        )
        for k, (low, high) in enumerate(edges)
        if cells[k]
    )
