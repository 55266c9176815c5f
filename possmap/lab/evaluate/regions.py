"""Regions that walls keep apart: what can be reached from home, and what is solid."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from possmap.lab.evaluate.raster import Flags, Ints


class Regions:
    """The connected regions of the cells that are no wall, neighbours by their sides.

    Cells are taken by runs, the pieces of rows between walls: few, whatever the number of cells.

    Parameters
    ----------
    walls
        A line of the lattice's own rule lets nothing pass: its cells meet at least at corners.
    """

    def __init__(self, walls: Flags) -> None:
        self._shape = walls.shape
        stride = walls.shape[1] + 1  # a border between the end of a row and the next one's begin
        open_ = np.zeros((walls.shape[0], stride + 1), dtype=np.int8)
        open_[:, 1:-1] = ~walls
        steps = np.diff(open_, axis=1).ravel()  # one number per border between cells
        self._begins, self._ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        self._stride = stride
        self._region = self._joined()

    def _joined(self) -> Ints:
        """Return each run's region: the number of its first run."""
        # A run touches those of the next row that begin before it ends, and end after it begins.
        first = np.searchsorted(self._ends, self._begins + self._stride, side="right")
        last = np.searchsorted(self._begins, self._ends + self._stride, side="left")
        counts = np.maximum(0, last - first)
        one = np.repeat(np.arange(len(first)), counts)
        offset = np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
        other = first[one] + offset
        region = np.arange(len(first))
        while True:
            low = np.minimum(region[one], region[other])
            high = np.maximum(region[one], region[other])
            if (low == high).all():
                return region
            np.minimum.at(region, high, low)
            while True:  # everybody to the root
                root = region[region]
                if (root == region).all():
                    break
                region = root

    def at(self, rows: Ints, columns: Ints) -> Ints:
        """Return the regions of some cells, each once; of walls, and outside, there is none."""
        inside = (rows >= 0) & (rows < self._shape[0]) & (columns >= 0)
        inside &= columns < self._shape[1]
        place = rows[inside] * self._stride + columns[inside]
        run = np.searchsorted(self._begins, place, side="right") - 1
        hit = run >= 0
        hit[hit] = self._ends[run[hit]] > place[hit]
        return np.unique(self._region[run[hit]])

    def at_border(self) -> Ints:
        """Return the regions that touch the border of the array."""
        last = (self._shape[0] - 1) * self._stride
        column = self._begins % self._stride, self._ends % self._stride
        touches = (self._begins < self._stride) | (self._begins >= last)
        touches |= (column[0] == 0) | (column[1] == self._shape[1])
        return np.unique(self._region[touches])

    def all(self) -> Ints:
        """Return every region."""
        return np.unique(self._region)

    def painted(self, regions: Iterable[int] | Ints) -> Flags:
        """Return the cells of some regions."""
        chosen = np.isin(self._region, np.asarray(list(regions), dtype=np.int64))
        marks = np.zeros(self._shape[0] * self._stride + 1, dtype=np.int8)
        marks[self._begins[chosen]] += 1
        marks[self._ends[chosen]] -= 1
        inside = np.cumsum(marks[:-1], dtype=np.int8).reshape(self._shape[0], self._stride)
        return inside[:, :-1].astype(np.bool_)
