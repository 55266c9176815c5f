"""The banded solver gives what solving the whole matrix gives, variances too."""

from __future__ import annotations

import numpy as np
import pytest

from possmap.refining.bordered import OWN, Bordered


def test_bands_and_border_are_one_system() -> None:
    """Rows at random, in two blocks of 9 and 6 unknowns, their own two each, and three walls."""
    rng = np.random.default_rng(5)
    bounds, walls = np.array([0, 9, 15]), 3
    system = Bordered(bounds, walls)
    whole = np.zeros((15 + OWN * 2 + walls, 15 + OWN * 2 + walls))
    whole[-walls:, -walls:] += 1e-6 * np.eye(walls)
    right = np.zeros(len(whole))

    def add(columns: list[int], border: list[int]) -> None:
        values, edge = rng.normal(size=len(columns)), rng.normal(size=len(border))
        target, weight = float(rng.normal()), float(rng.uniform(0.5, 2.0))
        one = np.array
        system.add(
            [one([c]) for c in columns], [one([v]) for v in values], one([target]), one([weight]),
            [one([b]) for b in border], [one([v]) for v in edge],
        )  # fmt: skip
        row = np.zeros(len(whole))
        row[columns], row[[15 + b for b in border]] = values, edge
        whole[...] += weight * np.outer(row, row)
        right[...] += weight * target * row

    for block, (begin, end) in enumerate(((0, 9), (9, 15))):
        own = [OWN * block, OWN * block + 1]
        for first in range(begin, end):
            add([first], own)
            add(list(range(first, min(end, first + 5))), [])
            add([first], [4 + first % walls])
        for one in own:
            add([], [one])
    found = system.solve(with_variances=True)
    expected, inverse = np.linalg.solve(whole, right), np.linalg.inv(whole)
    assert found.main == pytest.approx(expected[:15])
    assert found.own.ravel() == pytest.approx(expected[15:19])
    assert found.walls == pytest.approx(expected[19:])
    assert found.main_variances == pytest.approx(np.diag(inverse)[:15])
    assert found.wall_variances == pytest.approx(np.diag(inverse)[19:])
