"""Least squares whose normal matrix is banded block by block, but for a border that blocks share.

    [A  B] [x]   [f]      A: one banded block for each excursion; B: what its unknowns have to do
    [Bᵀ C] [z] = [g]      with the border z: two unknowns of its own, and walls.

Each band is factored by itself (Cholesky, LAPACK's), and what is left for the walls, Schur's
complement, is dense: it has as many rows as there are walls, however many excursions saw them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from possmap.refining.runs import Floats, Ints

OWN = 2
"""Unknowns of the border that belong to one block alone."""
BAND = 5
"""Diagonals of the band, the main one included; it is symmetric."""

_NO_WALL = 1e-6
"""What is known of a wall that nobody counts [1/m²]: without it, it might lie anywhere."""


class Solution(NamedTuple):
    """What fits best; variances are None unless asked for.

    main : x; own : of each block, shape (blocks, 2); walls : the rest of z.
    """

    main: Floats
    own: Floats
    walls: Floats
    main_variances: Floats | None
    wall_variances: Floats | None


class _Block(NamedTuple):
    """One excursion's part, as far as it can be solved without the others.

    shared : A⁻¹B. alone : A⁻¹f. walls : which ones it has to do with.
    inverse : of what is left for its own two; coupling : of these with its walls, solved;
    own : the two, were there no walls.
    """

    shared: Floats
    alone: Floats
    walls: Ints
    inverse: Floats
    coupling: Floats
    own: Floats


class Bordered:
    """Gathers rows, and solves.

    Parameters
    ----------
    bounds
        Where each block of x begins, and the last one ends.
    walls
        How many there are.
    """

    def __init__(self, bounds: Ints, walls: int) -> None:
        self._bounds, self._walls = bounds, walls
        self._pairs: list[tuple[Ints, Ints, Floats]] = []
        self._targets: list[tuple[Ints, Floats]] = []
        self._shared: list[tuple[Ints, Ints, Floats]] = []
        self._border: list[tuple[Ints, Ints, Floats]] = []
        self._border_targets: list[tuple[Ints, Floats]] = []

    @property
    def blocks(self) -> int:
        """How many there are."""
        return len(self._bounds) - 1

    def add(
        self,
        columns: Sequence[Ints],
        values: Sequence[Floats],
        target: Floats,
        weight: Floats,
        border: Sequence[Ints] = (),
        border_values: Sequence[Floats] = (),
    ) -> None:
        """Add rows Σ value·x[column] + Σ value·z[border] = target, each counting ``weight``.

        z is numbered: two of each block, then walls.
        """
        main = [
            (column, value, value * weight) for column, value in zip(columns, values, strict=True)
        ]
        edge = list(zip(border, border_values, strict=True))
        for number, (column, _, weighted) in enumerate(main):
            self._targets.append((column, weighted * target))
            for other, its, _ in main[: number + 1]:
                low, high = np.minimum(column, other), np.maximum(column, other)
                self._pairs.append((high - low, low, weighted * its))
            for other, its in edge:
                self._shared.append((column, other, weighted * its))
        for number, (column, value) in enumerate(edge):
            self._border_targets.append((column, weight * value * target))
            for other, its in edge[: number + 1]:
                self._border.append((column, other, weight * value * its))

    def solve(self, with_variances: bool) -> Solution:
        """Return what fits best.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the rows leave an unknown open, or contradict the arithmetic of doubles.
        """
        factor = cholesky_banded(self._band(), lower=True, check_finite=False)
        target = _sums(*_two(self._targets), self._size)
        own, schur = self._corner()
        edge = _sums(*_two(self._border_targets), len(own) * OWN + self._walls)
        own_target, wall_target = edge[: len(own) * OWN].reshape(-1, OWN), edge[len(own) * OWN :]
        solved: list[_Block] = []
        for number, (walls, shared) in enumerate(self._edges()):
            some = slice(self._bounds[number], self._bounds[number + 1])
            right = own_target[number], target[some]
            one, rest = _solved(factor[:, some], walls, shared, own[number], right)
            schur[np.ix_(walls, walls)] += rest[:, :-1]
            wall_target[walls] += rest[:, -1]
            solved.append(one)
        covariance = np.asarray(np.linalg.inv(schur), dtype=np.float64)
        at = covariance @ wall_target
        own_found = np.array([one.own - one.coupling @ at[one.walls] for one in solved])
        main = [
            one.alone - one.shared @ np.append(mine, at[one.walls])
            for one, mine in zip(solved, own_found, strict=True)
        ]
        found = Solution(np.concatenate(main), own_found, at, None, None)
        if not with_variances:
            return found
        variances = np.concatenate([_of_border(one, covariance) for one in solved])
        variances += _inverse_diagonal(factor, self._bounds)
        return found._replace(main_variances=variances, wall_variances=np.diag(covariance))

    @property
    def _size(self) -> int:
        return int(self._bounds[-1])

    def _band(self) -> Floats:
        """Return A, diagonal by diagonal, as LAPACK keeps the lower half of a band."""
        offsets, columns, values = _three(self._pairs)
        flat = _sums(offsets * self._size + columns, values, BAND * self._size)
        return flat.reshape(BAND, self._size)

    def _corner(self) -> tuple[Floats, Floats]:
        """Return C: two by two of each block, and of the walls, which rows do not mix."""
        rows, columns, values = _three(self._border)
        first = OWN * self.blocks
        walls = rows >= first
        of_walls = _sums(rows[walls] - first, values[walls], self._walls)
        rows, columns, values = rows[~walls], columns[~walls], values[~walls]
        place = rows // OWN * OWN**2 + rows % OWN * OWN + columns % OWN
        own = _sums(place, values, OWN**2 * self.blocks).reshape(-1, OWN, OWN)
        own[:, 0, 1] += own[:, 1, 0]
        own[:, 1, 0] = own[:, 0, 1]
        return own, np.diag(of_walls + _NO_WALL)

    def _edges(self) -> Iterator[tuple[Ints, Floats]]:
        """Yield of each block the walls that it has to do with, and B: its own two, then walls."""
        rows, columns, values = _three(self._shared)
        owner = np.searchsorted(self._bounds, rows, side="right") - 1
        every = OWN * self.blocks + self._walls
        known, place = np.unique(owner * every + columns, return_inverse=True)
        starts = np.searchsorted(known, np.arange(self.blocks + 1) * every)
        order = np.argsort(owner, kind="stable")
        cuts = np.searchsorted(owner[order], np.arange(self.blocks + 1))
        rows, place, values = rows[order], place.reshape(-1)[order], values[order]
        for number, (first, last) in enumerate(pairwise(starts.tolist())):
            walls = known[first + OWN : last] - number * every - OWN * self.blocks
            begin, end = cuts[number], cuts[number + 1]
            width = last - first
            height = int(self._bounds[number + 1] - self._bounds[number])
            at = (rows[begin:end] - self._bounds[number]) * width + place[begin:end] - first
            dense: Floats = _sums(at, values[begin:end], height * width)
            yield walls, dense.reshape(height, width)


def _solved(
    factor: Floats, walls: Ints, shared: Floats, own: Floats, right: tuple[Floats, Floats]
) -> tuple[_Block, Floats]:
    """Solve a block as far as it can be alone; return what is left for its walls, and its target.

    shared : B. own : C of its own two. right : g of its own two, and f.
    """
    band = np.ascontiguousarray(factor)
    inside = cho_solve_banded((band, True), np.column_stack([shared, right[1]]), check_finite=False)
    rest = -shared.T @ inside
    rest[:OWN, :OWN] += own
    rest[:OWN, -1] += right[0]
    inverse = np.linalg.inv(rest[:OWN, :OWN])
    coupled = inverse @ rest[:OWN, OWN:]
    left = rest[OWN:, OWN:] - rest[OWN:, :OWN] @ coupled
    block = _Block(inside[:, :-1], inside[:, -1], walls, inverse, coupled[:, :-1], coupled[:, -1])
    return block, left


def _inverse_diagonal(factor: Floats, bounds: Ints) -> Floats:
    """Return the diagonal of the inverse of each block, from the factor of the band.

    Takahashi's recursion, from each block's last column to its first, all blocks at once: of the
    inverse no more than BAND - 1 rows and columns are ever held.
    """
    found = np.empty(factor.shape[1])
    sizes = np.diff(bounds)
    order = np.argsort(-sizes, kind="stable")  # the blocks that still have columns come first
    last, sizes = bounds[1:][order] - 1, sizes[order]
    held = np.zeros((len(order), BAND - 1, BAND - 1))
    for step in range(int(sizes[0])):
        column = last[: np.searchsorted(-sizes, -step)] - step
        held = held[: len(column)]
        pivot = factor[0, column]
        below = (factor[1:, column] / pivot).T
        beside = -np.einsum("bij,bj->bi", held, below)
        found[column] = pivot**-2.0 - (below * beside).sum(axis=1)
        moved = np.empty_like(held)
        moved[:, 1:, 1:] = held[:, :-1, :-1]
        moved[:, 0, 0] = found[column]
        moved[:, 0, 1:] = moved[:, 1:, 0] = beside[:, :-1]
        held = moved
    return found


def _of_border(one: _Block, covariance: Floats) -> Floats:
    """Return what not knowing the border adds to the variances within a block."""
    of_walls = covariance[np.ix_(one.walls, one.walls)]
    mixed = -one.coupling @ of_walls
    border = np.block([[one.inverse - mixed @ one.coupling.T, mixed], [mixed.T, of_walls]])
    found: Floats = ((one.shared @ border) * one.shared).sum(axis=1)
    return found


def _sums(places: Ints, values: Floats, size: int) -> Floats:
    """Return the sum of values at each place."""
    return np.bincount(places, values, size).astype(np.float64, copy=False)


def _two(parts: Sequence[tuple[Ints, Floats]]) -> tuple[Ints, Floats]:
    return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])


def _three(parts: Sequence[tuple[Ints, Ints, Floats]]) -> tuple[Ints, Ints, Floats]:
    return (
        np.concatenate([one for one, _, _ in parts]),
        np.concatenate([one for _, one, _ in parts]),
        np.concatenate([one for _, _, one in parts]),
    )
