"""Who contradicts the others, or what its own walls tell, and who is found by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from broken import FAULTS, retold
from hypothesis import given
from hypothesis import strategies as st
from teams import ROBUST, fuse, write_logs
from troupes import drive, logs_of, shipped_world

import possmap
from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, UNIT
from possmap.core.lattice import TileKey, Window, tile_window
from possmap.core.observations import Fit, Observations
from possmap.core.patches import Crop, Patch
from possmap.core.plan import ExcursionPlan
from possmap.grid.replay import replay
from possmap.grid.selection import Selection
from possmap.inspection.audit import Audit, audit
from possmap.inspection.contradiction import Contradiction, compare, sides_by_tile
from possmap.inspection.judgement import Told

Log = dict[str, Any]
DEMPSTER = {**ROBUST, "free_fusion": "dempster", "resolution": 0.1}
TILE_WINDOW = tile_window(TileKey(0, 0))


def side_of(cells: Sequence[tuple[int, int, int]]) -> Patch:
    """Return a side of one row of cells: column, weight for a wall, weight against it."""
    window = Window(0, 1, 0, 256)
    walls, free = np.zeros((2, 1, 256), dtype=np.int64)
    for column, wall, against in cells:
        walls[0, column], free[0, column] = wall, against
    layers = ((Layer.WALLS, walls), (Layer.FREE, free))
    return {layer: Crop(window, array) for layer, array in layers if array.any()}


def against(one: Patch, *others: Patch) -> Contradiction:
    crowd = np.zeros((2, *TILE_WINDOW.shape), dtype=np.int64)
    for other in others:
        for layer, (window, cells) in other.items():
            crowd[layer][window.slices_in(TILE_WINDOW)] += cells
    return compare(one, crowd, TILE_WINDOW)


weights = st.integers(0, 3 * UNIT)


@given(weights, weights, weights, weights)
def test_k_is_dempsters_of_the_masses_of_either_side(a: int, b: int, c: int, d: int) -> None:
    found = against(side_of([(3, a, b)]), side_of([(3, c, d)]))
    if not ((a or b) and (c or d)):
        assert found.compared == 0
        return
    (wall, free), (wall2, free2) = (
        (
            (1 - math.exp(-w)) * math.exp(-v) / inner,
            (1 - math.exp(-v)) * math.exp(-w) / inner,
        )
        for w, v in ((a / UNIT, b / UNIT), (c / UNIT, d / UNIT))
        for inner in [math.exp(-w) + math.exp(-v) - math.exp(-w - v)]
    )
    assert found.compared == 1
    assert found.wall_free == pytest.approx(wall * free2)
    assert found.free_wall == pytest.approx(free * wall2)
    assert found.wall_wall == pytest.approx(wall * wall2)
    assert found.conflict == pytest.approx(wall * free2 + free * wall2)


def test_sure_of_a_wall_against_sure_of_free_space_is_all_and_agreement_is_none() -> None:
    wall, free = side_of([(0, CERTAIN, 0)]), side_of([(0, 0, CERTAIN)])
    assert against(wall, free).degree == pytest.approx(1)
    assert against(wall, wall).degree == against(free, free).degree == 0


def test_the_worst_place_is_in_the_square_that_contradicts_most_not_the_worst_cell() -> None:
    crowded = [100 + column for column in range(8)]
    one = side_of([(5, CERTAIN, 0), *((column, UNIT, 0) for column in crowded)])
    other = side_of([(column, 0, CERTAIN) for column in (5, *crowded)])
    worst = against(one, other).worst
    assert worst is not None and worst[:2] == (0, 100)


def test_the_others_are_the_grid_without_the_robot(tmp_path: Path, honest: list[Log]) -> None:
    robot = honest[0]["robot"]
    kept = [log for log in honest if log["robot"] != robot]
    for name, logs in (("all", honest), ("rest", kept)):
        fuse(write_logs(tmp_path / name, logs), tmp_path / f"{name}.possmap", DEMPSTER)
    with possmap.open_grid(tmp_path / "all.possmap") as grid:
        entries = list(grid.ledger.entries())
        plans: list[ExcursionPlan] = [replay(grid, one, grid.settings).plan for one in entries]
        _, tiles = sides_by_tile(plans, grid.settings, None)
        crowds = []
        for tile in tiles:
            own = [number for number in tile.numbers if entries[number].robot == robot]
            everybody = tile.together(tile.numbers)
            crowds.append((tile.window, everybody - tile.together(own)))
    with possmap.open_grid(tmp_path / "rest.possmap") as grid:
        assert len(crowds) > 2
        for window, crowd in crowds:
            for layer in (Layer.WALLS, Layer.FREE):
                np.testing.assert_array_equal(crowd[layer], grid.tiles.read_window(layer, window))


@pytest.fixture(scope="module")
def honest() -> list[Log]:
    return logs_of(drive(shipped_world("figure8"), robots=5, minutes=12, seed=4, exchange=False))


def audited(folder: Path, logs: Sequence[Log], **settings: Any) -> Audit:
    grid = folder / "site.possmap"
    grid.unlink(missing_ok=True)
    fuse(write_logs(folder / "logs", logs), grid, {**DEMPSTER, **settings})
    return audit(grid)


def test_the_order_of_the_logs_does_not_matter(honest: list[Log], tmp_path: Path) -> None:
    told = []
    for name, logs in (("a", honest), ("b", honest[::-1])):
        (tmp_path / name).mkdir()
        found = audited(tmp_path / name, logs)
        told.append({
            (one.robot, one.excursion): (one.contradiction, one.compared, one.worst, one.told)
            for one in found.excursions
        })  # fmt: skip
    assert told[0] == told[1]


def test_windows_add_up_to_the_whole(honest: list[Log], tmp_path: Path) -> None:
    whole = audited(tmp_path, honest)
    halves = [
        audit(tmp_path / "site.possmap", window_m=window)
        for window in ((-50.0, -50.0, 1.23, 50.0), (1.3, -50.0, 50.0, 50.0))
    ]
    # 1.23 m lies in the cell that ends at 1.3 m: the halves have no cell in common.
    for side in whole.robots:
        parts = [one for half in halves for one in half.robots if one.robot == side.robot]
        assert sum(one.compared for one in parts) == side.compared
        assert sum(one.wall_free * one.compared for one in parts) == pytest.approx(
            side.wall_free * side.compared
        )


def test_a_selection_is_judged_as_if_there_were_nothing_else(
    honest: list[Log], tmp_path: Path
) -> None:
    robots = tuple(sorted({log["robot"] for log in honest})[:3])
    audited(tmp_path, honest)
    some = audit(tmp_path / "site.possmap", selection=Selection(robots=robots))
    (tmp_path / "few").mkdir()
    alone = audited(tmp_path / "few", [log for log in honest if log["robot"] in robots])
    assert (some.robots, some.excursions) == (alone.robots, alone.excursions)


def test_a_robot_far_from_all_others_is_not_compared_rather_than_cleared(
    honest: list[Log], tmp_path: Path
) -> None:
    far = retold({**honest[0], "robot": "far"}, start=(500.0, 0.0, 0.0))
    found = audited(tmp_path, [*honest, far])
    last = found.robots[-1]
    assert (last.robot, last.judged, last.compared, last.above) == ("far", False, 0, None)
    assert all(side.judged for side in found.robots[:-1])


@pytest.mark.parametrize("fault", ["turns 5° per 45° wrong", "starts 1 m off", "starts 20° off"])
def test_a_robot_with_a_grave_fault_is_ranked_first(
    fault: str, honest: list[Log], tmp_path: Path
) -> None:
    broken = honest[0]["robot"]
    logs = [FAULTS[fault](log) if log["robot"] == broken else log for log in honest]
    assert audited(tmp_path, logs).robots[0].robot == broken


def test_walls_tell_of_a_broken_robot_and_of_no_sound_one(
    honest: list[Log], tmp_path: Path
) -> None:
    broken = honest[0]["robot"]
    wrong = FAULTS["turns 5° per 45° wrong"]
    logs = [wrong(log) if log["robot"] == broken else log for log in honest]
    settings = {"estimator": "walls", "orthogonal": True, "turn_noise": 0.7}
    assert not any(one.reasons for one in audited(tmp_path, honest, **settings).robots)
    found = audited(tmp_path, logs, **settings)
    assert [one.robot for one in found.robots if one.stands_out] == [broken]
    assert "outliers among its walls" in found.robots[0].reasons


def test_a_robot_whose_model_is_honest_about_its_wheels_strays(
    honest: list[Log], tmp_path: Path
) -> None:
    broken = honest[0]["robot"]
    worn = logs_of(
        drive(
            shipped_world("figure8"), robots=5, minutes=12, seed=4, exchange=False,
            drift=4.0, turn_noise=3.0,
        )
    )  # fmt: skip
    logs = [log for log in honest if log["robot"] != broken]
    logs += [log for log in worn if log["robot"] == broken]
    settings = {"estimator": "walls", "orthogonal": True, "turn_noise": 0.7}
    found = audited(tmp_path, logs, **settings)
    assert [one.robot for one in found.robots if one.stands_out] == [broken]
    assert "its heading strays" in found.robots[0].reasons


def told(*residuals: float, surprise: float = 0.0) -> Told:
    """Return what observations told of a heading, each off by so much [degrees]."""
    used = Observations(used=len(residuals), seen=len(residuals))
    squares = len(residuals) + surprise * math.sqrt(2 * len(residuals))
    return Told.of([(used, Fit(squares, 0.0, tuple(map(math.radians, residuals))))])


def test_one_lost_excursion_makes_no_robot_stray() -> None:
    others = [told(*([1.0, -1.0] * 30))] * 5
    assert not list(told(*([1.0] * 60 + [40.0] * 30)).reasons(others))
    assert list(told(*([4.0] * 60)).reasons(others)) == ["its heading strays"]
    assert not list(told(*([4.0] * 29)).reasons(others))


def test_few_walls_must_surprise_more_than_many() -> None:
    others = [told(*([1.0] * 60))] * 5
    # As many naive standard deviations, (S - n) / sqrt(2n), with 12 walls and with 1000.
    assert not list(told(*([1.0] * 12), surprise=5.5).reasons(others))
    assert list(told(*([1.0] * 1000), surprise=5.5).reasons(others))
