"""The largest changes between two grids, far enough apart to be different places."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import numpy as np

from possmap.core.lattice import TILE, Lattice, TileKey
from possmap.inspection.diff_summary import Change
from possmap.inspection.difference import QUANTITIES, Changes

APART_M = 1.0
"""Changes nearer to each other than this, along x and y, are one [m]."""

_TOUCHED = 4
"""A change's surroundings are at most a tile wide, so that they lie in at most so many tiles."""


class Largest:
    """Finds the largest changes in two passes over tiles: offer each, then choose.

    count : how many to find.

    The first pass only remembers the tiles with the largest changes. That is enough: each change
    chosen rules out cells of four tiles at most, so that the next one lies in one of the four
    then following.
    """

    def __init__(self, count: int, lattice: Lattice) -> None:
        self._count, self._lattice = count, lattice
        self._most = _TOUCHED * (count - 1) + 1
        self._tiles: list[tuple[float, int, int]] = []
        self._radius = min(max(1, math.ceil(APART_M / lattice.resolution - 1e-9)), TILE // 2)

    def offer(self, key: TileKey, found: Changes) -> None:
        """Note how much a tile changes at most."""
        size = float(found.size.max(initial=0.0))
        if size and self._count:
            # Of equal ones the first by row and column stays, whatever the order of the offers.
            heapq.heappush(self._tiles, (size, -key.row, -key.column))
            if len(self._tiles) > self._most:
                heapq.heappop(self._tiles)

    def choose(self, read: Callable[[TileKey], Changes]) -> tuple[Change, ...]:
        """Return the largest changes, the largest first; ``read`` gives a tile's again."""
        heap = [(-size, TileKey(-row, -column)) for size, row, column in self._tiles]
        heapq.heapify(heap)
        cells: list[tuple[int, int]] = []
        chosen: list[Change] = []
        while heap and len(chosen) < self._count:
            bound, key = heapq.heappop(heap)
            found = read(key)
            best = self._best(found, cells)
            if best is None:
                continue
            size, place, quantity = best
            if -size == bound:  # else another tile's may be larger, now that these are ruled out
                row, column = int(found.row[place]), int(found.column[place])
                cells.append((row, column))
                chosen.append(
                    Change(
                        *self._lattice.centre_of(row, column),
                        QUANTITIES[quantity],
                        float(found.a[quantity, place]),
                        float(found.b[quantity, place]),
                    )
                )
                best = self._best(found, cells)
                if best is None:
                    continue
            heapq.heappush(heap, (-best[0], key))
        return tuple(chosen)

    def _best(self, found: Changes, cells: list[tuple[int, int]]) -> tuple[float, int, int] | None:
        """Return size, place and quantity of the largest change that is far from some cells."""
        size = found.size
        for row, column in cells:
            near = (np.abs(found.row - row) < self._radius) & (
                np.abs(found.column - column) < self._radius
            )
            size[:, near] = 0
        if not size.any():
            return None
        place = int(size.max(axis=0).argmax())
        quantity = int(size[:, place].argmax())
        return float(size[quantity, place]), place, quantity
