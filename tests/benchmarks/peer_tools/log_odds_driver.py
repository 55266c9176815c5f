"""A process that is timed: scans into a log-odds grid, ``python log_odds_driver.py LOG MAP REACH``.

Bresenham's lines, all beams at once, a step at a time. MAP is an ``.npz`` with ``log_odds`` of
shape (rows, columns) and ``origin``, the row and column of its first cell on a lattice at (0, 0).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from carmen import read_scans

RESOLUTION = 0.05
HIT, PASS = 0.85, -0.4
"""Log-odds of a cell where a beam ends, and of one it goes through: OctoMap's own."""

LIMITS = -2.0, 3.5


def main() -> None:
    """Add up what all beams say, then keep it within limits."""
    log, target, reach = sys.argv[1:]
    scans = read_scans(Path(log))
    ends = scans.ends(np.minimum(scans.readings, float(reach)))
    first = np.repeat(np.floor(scans.places / RESOLUTION).astype(np.int64), ends.shape[1], axis=0)
    last = np.floor(ends / RESOLUTION).astype(np.int64).reshape(-1, 2)
    origin = np.minimum(first.min(axis=0), last.min(axis=0))
    columns, rows = np.maximum(first.max(axis=0), last.max(axis=0)) - origin + 1

    def count(cells: np.ndarray) -> np.ndarray:
        column, row = (cells - origin).T
        return np.bincount(row * columns + column, minlength=rows * columns)

    hits = count(last[scans.readings.ravel() < float(reach)])
    way = last - first
    steps = np.abs(way).max(axis=1)
    passes = np.zeros_like(hits)
    for step in range(steps.max()):
        going = steps > step
        first, way, steps = first[going], way[going], steps[going]
        passes += count(first + (2 * step * way + steps[:, None]) // (2 * steps[:, None]))
    log_odds = np.clip(HIT * hits + PASS * passes, *LIMITS).astype(np.float32)
    np.savez(target, log_odds=log_odds.reshape(rows, columns), origin=origin[::-1])


if __name__ == "__main__":
    main()
