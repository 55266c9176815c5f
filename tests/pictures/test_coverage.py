"""Coverage counts excursions, not logs: whatever brought them, and however often."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from literal.teams import Log
from numpy.typing import NDArray
from teams import fuse, write_logs
from versions import log_of, prefix

import possmap
from possmap.core.lattice import Window
from possmap.pictures.render import Look, picture

SETTINGS = {"resolution": 0.1}


def turned(log: Log, dx: float, dy: float) -> Log:
    """Return a log whose robot went the other axis, from another place."""
    log = copy.deepcopy(log)
    for record in log["records"]:
        for x, y in (("x", "y"), ("x2", "y2")):
            if x in record:
                record[x], record[y] = dx - record[y], dy + record[x]
        if "heading" in record:
            record["heading"] = 90.0
    return log


A = log_of("r1", 8)
B = turned(log_of("r2", 8), 1.5, -1.5)
C = {**log_of("r3", 6), "excursion": "c"}
POINT = {**log_of("r4", 3), "records": [
    {"seq": 0, "kind": "pose", "x": -2.0, "y": 0.0, "heading": 0},
    {"seq": 1, "kind": "corner", "x": -2.0, "y": 0.3, "corner": "end"},
    {"seq": 2, "kind": "pose", "x": -2.0, "y": 0.0, "heading": 0},
]}  # fmt: skip


def drawn(grid: Path, **more: object) -> NDArray[np.uint8]:
    look = Look(layers=("coverage",), palette="gray", bare=True, **more)  # type: ignore[arg-type]
    with possmap.open_grid(grid) as opened:
        return np.asarray(picture(opened, look))


def brute_force(
    folder: Path, window: Window, excursions: Sequence[Log], settings: Mapping[str, object]
) -> NDArray[np.uint8]:
    """Count, cell by cell, the excursions that change a grid of their own."""
    count = np.zeros(window.shape, dtype=np.uint8)
    for number, one in enumerate(excursions):
        grid = folder / f"{number}.possmap"
        fuse(write_logs(folder / f"{number}", [one]), grid, settings)
        with possmap.open_grid(grid) as opened:
            known = (opened.necessity(window) > 0) | (opened.possibility(window) < 1)
            count += known | (opened.points(window) > 0)
    return count[::-1]


def window_of(grid: Path) -> Window:
    with possmap.open_grid(grid) as opened:
        assert opened.window is not None
        return opened.window


@pytest.mark.parametrize("more", [{}, {"independence": "excursion"}, {"free_along_walls": True}])
def test_coverage_is_what_fusing_each_excursion_alone_says(
    tmp_path: Path, more: dict[str, object]
) -> None:
    excursions, settings = [A, B, C, POINT], {**SETTINGS, **more}
    grid = tmp_path / "g.possmap"
    fuse(write_logs(tmp_path / "logs", excursions), grid, settings)
    expected = brute_force(tmp_path / "alone", window_of(grid), excursions, settings)
    assert set(np.unique(expected)) >= {0, 1, 2, 3}
    np.testing.assert_array_equal(drawn(grid), expected)


def test_an_excursion_that_three_logs_deliver_counts_once(tmp_path: Path) -> None:
    grid = tmp_path / "g.possmap"
    logs = [
        {**B, "carried": [prefix(A, 3)]},
        {**C, "carried": [prefix(A, 5)]},
        {**POINT, "carried": [A]},
        A,
    ]
    for number, log in enumerate(logs):
        fuse(write_logs(tmp_path / f"logs{number}", [log]), grid, SETTINGS)
    expected = brute_force(tmp_path / "alone", window_of(grid), [A, B, C, POINT], SETTINGS)
    np.testing.assert_array_equal(drawn(grid), expected)


def test_a_block_shows_its_most_covered_cell(tmp_path: Path) -> None:
    grid = tmp_path / "g.possmap"
    fuse(write_logs(tmp_path / "logs", [A, B, C]), grid, SETTINGS)
    every, some = drawn(grid), drawn(grid, max_size=9)
    assert max(some.shape) <= 9 and some.max() == every.max() == 3
