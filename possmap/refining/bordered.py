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
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from possmap.refining.runs import Floats, Ints

OWN = 2
"""Unknowns of the border that belong to one block alone."""
BAND = 5
"""Diagonals of the band, the main one included; it is symmetric."""

_NO_WALL = 1e-6
"""What is known of a wall that nobody counts [1/m²]: without it, it might lie anywhere."""
_AT_ONCE = 256
"""Columns of an inverse that are held at once."""


class Fitted(NamedTuple):
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

    factor : of its band. shared : A⁻¹B. alone : A⁻¹f. walls : which ones it has to do with.
    inverse : of what is left for its own two; coupling : of these with its walls, solved;
    own : the two, were there no walls.
    """

    factor: Floats
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
        for number, (column, value, weighted) in enumerate(main):
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

    def solve(self, with_variances: bool) -> Fitted:
        """Return what fits best.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the rows leave an unknown open, or contradict the arithmetic of doubles.
        """
        size, blocks = int(self._bounds[-1]), self.blocks
        own_count = OWN * blocks
        rows, columns, values = _joined(self._pairs)
        band = np.bincount(rows * size + columns, values, BAND * size).reshape(BAND, size)
        target = np.bincount(*_joined(self._targets), size)
        border_target = np.bincount(*_joined(self._border_targets), own_count + self._walls)
        rows, columns, values = _joined(self._border)
        is_wall = rows >= own_count
        left = np.bincount(rows[is_wall] - own_count, values[is_wall], self._walls) + _NO_WALL
        schur, wall_target = np.diag(left), border_target[own_count:].copy()
        rows, columns, values = rows[~is_wall], columns[~is_wall], values[~is_wall]
        mine = rows // OWN * 4 + rows % OWN * 2 + columns % OWN
        own = np.bincount(mine, values, 4 * blocks).reshape(-1, 2, 2)
        own[:, 0, 1] = own[:, 1, 0] = own[:, 0, 1] + own[:, 1, 0]
        factor = cholesky_banded(band, lower=True, check_finite=False)
        solved: list[_Block] = []
        for number, (walls, shared) in enumerate(self._edges(size)):
            begin, end = self._bounds[number], self._bounds[number + 1]
            band_factor = np.ascontiguousarray(factor[:, begin:end])
            both = np.column_stack([shared, target[begin:end]])
            inside = cho_solve_banded((band_factor, True), both, check_finite=False)
            rest = -shared.T @ inside
            rest[:OWN, :OWN] += own[number]
            rest[:OWN, -1] += border_target[OWN * number : OWN * (number + 1)]
            inverse = np.linalg.inv(rest[:OWN, :OWN])
            coupled = inverse @ rest[:OWN, OWN:]
            outside = rest[OWN:, OWN:] - rest[OWN:, :OWN] @ coupled
            schur[np.ix_(walls, walls)] += outside[:, :-1]
            wall_target[walls] += outside[:, -1]
            solved.append(
                _Block(
                    band_factor,
                    inside[:, :-1],
                    inside[:, -1],
                    walls,
                    inverse,
                    coupled[:, :-1],
                    coupled[:, -1],
                )
            )
        covariance = np.linalg.inv(schur)
        at = covariance @ wall_target
        own_found = np.array([one.own - one.coupling @ at[one.walls] for one in solved])
        main = [
            one.alone - one.shared @ np.append(mine, at[one.walls])
            for one, mine in zip(solved, own_found, strict=True)
        ]
        if not with_variances:
            return Fitted(np.concatenate(main), own_found, at, None, None)
        variances = np.concatenate([_variances(one, covariance) for one in solved])
        return Fitted(np.concatenate(main), own_found, at, variances, np.diag(covariance))

    def _edges(self, size: int) -> Iterator[tuple[Ints, Floats]]:
        """Yield of each block the walls that it has to do with, and B: its own two, then walls."""
        rows, columns, values = _joined(self._shared)
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
            dense = np.bincount(at, values[begin:end], height * width)
            yield walls, dense.reshape(height, width)


def _variances(one: _Block, covariance: Floats) -> Floats:
    """Return the diagonal of the inverse within a block."""
    size = one.factor.shape[1]
    inverse = np.empty(size)
    for begin in range(0, size, _AT_ONCE):
        some = np.arange(begin, min(size, begin + _AT_ONCE))
        columns = np.zeros((size, len(some)))
        columns[some, some - begin] = 1.0
        columns = cho_solve_banded(
            (one.factor, True), columns, overwrite_b=True, check_finite=False
        )
        inverse[some] = columns[some, some - begin]
    of_walls = covariance[np.ix_(one.walls, one.walls)]
    mixed = -one.coupling @ of_walls
    border = np.block([[one.inverse - mixed @ one.coupling.T, mixed], [mixed.T, of_walls]])
    found: Floats = inverse + ((one.shared @ border) * one.shared).sum(axis=1)
    return found


def _joined(
    parts: Sequence[tuple[NDArray[np.float64] | Ints, ...]],
) -> tuple[NDArray[np.float64] | Ints, ...]:
    return tuple(np.concatenate(some) for some in zip(*parts, strict=True))
