"""Fusion: maximum inside a detection, Dempster's rule between them, minimum where free (§4.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from teams import fuse, write_logs

import possmap
from possmap.core.fusion import CERTAIN, UNIT, WEIGHT, necessity_of
from possmap.core.lattice import Window
from possmap.core.pyramid import FULL
from possmap.core.views import EDGE, Readout

Record = dict[str, Any]
values = st.integers(0, FULL)
shares = st.floats(0, 1)


def both(necessity: float, possibility: float) -> Readout:
    """Return what a cell says of which both sides are known alone."""
    w, v = -np.log(max(EDGE, 1 - necessity)), -np.log(max(EDGE, possibility))
    return Readout(np.array([[w]]), np.array([[v]]), np.array([[possibility]]))


def test_the_table_of_weights_is_the_methods() -> None:
    assert WEIGHT[0] == 0 and WEIGHT[FULL] == CERTAIN == 16 * 2**18
    assert all(np.diff(WEIGHT) > 0)
    q = 12345
    assert WEIGHT[q] == round(-np.log(1 - q / FULL) * UNIT)


@given(values, values)
def test_adding_weights_is_the_probabilistic_sum(one: int, other: int) -> None:
    x, y = (1 - np.exp(-WEIGHT[q] / UNIT) for q in (one, other))
    assert necessity_of(WEIGHT[[one]] + WEIGHT[[other]]) == pytest.approx(x + y - x * y)


@given(shares, shares)
def test_masses_add_up_and_their_belief_lies_below_the_plausibility(n: float, p: float) -> None:
    mass = both(n, p).masses
    assert sum(float(part[0, 0]) for part in mass) == pytest.approx(1)
    assert all(float(part[0, 0]) >= 0 for part in mass)


@given(shares, st.floats(0.01, 0.99))
def test_one_detection_or_one_pass_is_a_bayesian_log_odds_update(n: float, base: float) -> None:
    prior = np.log(base / (1 - base))
    seen = both(n, 1.0).probability(base)[0, 0]
    evidence = min(16.0, -np.log(1 - n) if n < 1 else 16.0)
    assert seen == pytest.approx(1 / (1 + np.exp(-(prior + evidence))))
    free = both(0.0, 1 - n).probability(base)[0, 0]
    denial = max(-16.0, np.log(1 - n) if n < 1 else -16.0)
    assert free == pytest.approx(1 / (1 + np.exp(-(prior + denial))))


def log(robot: str, excursion: str, *records: Record) -> dict[str, Any]:
    numbered = [{"seq": seq, **record} for seq, record in enumerate(records)]
    return {"possmap_log": 1, "robot": robot, "excursion": excursion, "records": numbered}


def pose(x: float, y: float, **more: float) -> Record:
    return {"kind": "pose", "x": x, "y": y, "heading": 0, **more}


def wall(x: float, y: float, x2: float, y2: float, followed: bool = False) -> Record:
    return {"kind": "wall", "x": x, "y": y, "x2": x2, "y2": y2, "followed": followed}


EXACT = {"along": 0, "across": 0, "turn_spread": 0, "resolution": 0.1}


def drawn(grid: Path, window: Window) -> list[str]:
    """Draw a grid, the highest y first: # wall, . free, ? unknown, ! contradicted."""
    with possmap.open_grid(grid) as opened:
        n, p = opened.necessity(window), opened.possibility(window)
    signs = np.full(n.shape, "?")
    signs[p < 1], signs[n > 0], signs[n > p] = ".", "#", "!"
    return ["".join(row) for row in signs[::-1]]


def test_a_run_is_free_a_wall_is_a_wall_and_the_rest_stays_unknown(tmp_path: Path) -> None:
    records = [
        pose(0.05, 0.15), pose(0.85, 0.15), wall(0.95, 0.05, 0.95, 0.35), pose(0.85, 0.25),
        pose(0.05, 0.25),
    ]  # fmt: skip
    fuse(write_logs(tmp_path / "logs", [log("r", "a", *records)]), tmp_path / "g", EXACT)
    assert drawn(tmp_path / "g", Window(-1, 5, -1, 11)) == [
        "????????????",
        "??????????#?",
        "?.........#?",
        "?.........#?",
        "??????????#?",
        "????????????",
    ]


def test_a_wall_across_the_path_is_a_contradiction_not_a_guess(tmp_path: Path) -> None:
    free = log("r1", "a", pose(0.05, 0.15), pose(0.85, 0.15))
    blocked = log("r2", "a", pose(0.05, 0.25), wall(0.45, 0.05, 0.45, 0.35), pose(0.25, 0.25))
    fuse(write_logs(tmp_path / "logs", [free, blocked]), tmp_path / "g", EXACT)
    assert drawn(tmp_path / "g", Window(0, 4, 0, 9)) == [
        "????#????",
        "????#????",
        "....!....",
        "????#????",
    ]


def test_two_detections_reinforce_and_the_cells_of_one_do_not(tmp_path: Path) -> None:
    # Half-widths .7 and .5 leave heights .3 and .5; the second robot's .6 and .8 leave .4 and .2.
    def robot(name: str, first: float, last: float) -> dict[str, Any]:
        beams = [
            {"kind": "beam", "x": 0.05, "y": 0.05, "x2": 0.05, "y2": 0.05},
            {"kind": "pose", "x": 0.05, "y": 0.05, "heading": 0},
        ]
        start = pose(0.05, 0.05, error_x=min(first, last), error_y=min(first, last))
        return log(name, "a", start, *beams)

    settings = {**EXACT, "max_error": 1.0}
    logs = [robot("r1", 0.7, 0.5), robot("r2", 0.6, 0.8)]
    fuse(write_logs(tmp_path / "logs", logs), tmp_path / "g", settings)
    with possmap.open_grid(tmp_path / "g") as grid:
        apex = grid.necessity(Window(0, 1, 0, 1))[0, 0]
    assert apex == pytest.approx(0.5 + 0.4 - 0.5 * 0.4, abs=1e-4)


def hits(*halves: float) -> list[Record]:
    """Beams of one standstill whose hits fall into one cell, each with its own half-width."""
    grown = [max(0.0, half - 0.1) for half in halves]
    return [
        {"kind": "beam", "x": 0.05, "y": 0.05 - reach, "x2": 0.05, "y2": 0.05} for reach in grown
    ]


def test_of_readings_3_5_and_4_2_the_groups_maxima_fuse_to_7(tmp_path: Path) -> None:
    # With a heading half-width of 90° a beam of length r adds r to both half-widths: from .1 at the
    # robot, readings of heights .3 and .5, then .4 and .2, each pair between two poses.
    start = pose(0.05, 0.05, error_x=0.1, error_y=0.1, error_heading=90)
    again = {"kind": "pose", "x": 0.05, "y": 0.05, "heading": 0}
    one = log("r", "a", start, *hits(0.7, 0.5), again, *hits(0.6, 0.8), again)
    fuse(write_logs(tmp_path / "logs", [one]), tmp_path / "g", EXACT)
    with possmap.open_grid(tmp_path / "g") as grid:
        assert grid.necessity(Window(0, 1, 0, 1))[0, 0] == pytest.approx(0.70, abs=1e-4)
    fuse(
        write_logs(tmp_path / "logs", [one]),
        tmp_path / "h",
        {**EXACT, "independence": "excursion"},
    )
    with possmap.open_grid(tmp_path / "h") as grid:
        assert grid.necessity(Window(0, 1, 0, 1))[0, 0] == pytest.approx(0.50, abs=1e-4)


def test_laps_of_one_robot_make_a_wall_certain_only_if_each_is_independent(tmp_path: Path) -> None:
    lap = [wall(0.05, 0.15, 0.85, 0.15), pose(0.85, 0.05), pose(0.05, 0.05)]
    start = pose(0.05, 0.05, error_x=0.5, error_y=0.5)
    logs = write_logs(tmp_path / "logs", [log("r", "a", start, *lap * 8)])
    found = {}
    for independence in ("detection", "excursion"):
        grid = tmp_path / independence
        fuse(logs, grid, {**EXACT, "independence": independence})
        with possmap.open_grid(grid) as opened:
            found[independence] = opened.necessity().max()
    assert found["detection"] == pytest.approx(1 - 0.5**8, abs=1e-4)
    assert found["excursion"] == pytest.approx(0.5, abs=1e-4)


def test_free_space_counts_its_best_pass_and_no_more(tmp_path: Path) -> None:
    start = pose(0.05, 0.05, error_x=0.4, error_y=0.4)
    there_and_back = [pose(0.85, 0.05), pose(0.05, 0.05)] * 5
    fuse(
        write_logs(tmp_path / "logs", [log("r", "a", start, *there_and_back)]),
        tmp_path / "g",
        EXACT,
    )
    with possmap.open_grid(tmp_path / "g") as grid:
        assert grid.possibility().min() == pytest.approx(0.4, abs=1e-4)


def test_a_clipped_path_spares_the_wall_that_the_same_run_saw(tmp_path: Path) -> None:
    start = pose(0.05, 0.05, error_x=0.3, error_y=0.3)
    records = [start, wall(0.05, 0.25, 0.85, 0.25), pose(0.85, 0.05)]
    free = {**EXACT, "free_along_walls": True}
    logs = write_logs(tmp_path / "logs", [log("r", "a", *records)])
    fuse(logs, tmp_path / "g", free)
    fuse(logs, tmp_path / "h", {**free, "clip_coobserved": True})
    column = Window(-3, 6, 4, 5)
    with possmap.open_grid(tmp_path / "g") as denied, possmap.open_grid(tmp_path / "h") as spared:
        assert (denied.possibility(column)[:, 0] < 1).tolist() == [True] * 7 + [False] * 2
        assert (spared.possibility(column)[:, 0] < 1).tolist() == [True] * 5 + [False] * 4
        assert (spared.possibility(column)[:5] == denied.possibility(column)[:5]).all()
