"""Contradiction between excursions: who says what, who the others are, and who is found by it."""

from __future__ import annotations

import math
import re
import tracemalloc
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from broken import FAULTS, retold
from hypothesis import given
from hypothesis import strategies as st
from literal.teams import random_team
from numpy.typing import NDArray
from teams import ROBUST, fuse, write_logs
from troupes import drive, logs_of, shipped_world

import possmap
from possmap.budget import LEAST_MIB, Budget
from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, WEIGHT, blank
from possmap.core.lattice import TILE, TileKey, tile_window
from possmap.core.patches import Crop, Patch, spread
from possmap.core.pyramid import FULL
from possmap.core.settings import FreeFusion
from possmap.errors import BudgetError
from possmap.grid.ledger import Entry
from possmap.inspection import tallies
from possmap.inspection.audit import Audit, audit
from possmap.inspection.contradiction import Crowd, Tally, committed, compare
from possmap.inspection.outliers import FEWEST, LEAST_SPREAD, Others

Log = dict[str, Any]
PROFILES: Mapping[str, Mapping[str, Any]] = {
    "paper": {"resolution": 0.2},
    "robust": {**ROBUST, "resolution": 0.2},
    "swath": {"path_width": 0.5, "resolution": 0.2},
}


def excursions_of(logs: Sequence[Log]) -> dict[tuple[str, str], Log]:
    """Return the longest version of each excursion, however it was delivered."""
    found: dict[tuple[str, str], Log] = {}
    for log in (one for outer in logs for one in (outer, *outer.get("carried", ()))):
        name = log["robot"], log["excursion"]
        if name not in found or len(log["records"]) > len(found[name]["records"]):
            whole = {key: value for key, value in log.items() if key != "carried"}
            found[name] = {"possmap_log": 1, **whole}
    return found


def stored(grid: Path) -> dict[TileKey, dict[Layer, NDArray[Any]]]:
    """Return walls and denials of every tile of a grid, row by row."""
    with possmap.open_grid(grid) as opened:
        window = opened.window
        found: dict[TileKey, dict[Layer, NDArray[Any]]] = {}
        if window is None:
            return found
        for row in opened.tiles.directory.rows():
            for column in opened.tiles.directory.columns(row, window):
                key = TileKey(row, column)
                layers = opened.tiles.read(key)
                found[key] = {
                    layer: layers.get(layer, blank(layer)).reshape(-1)
                    for layer in (Layer.WALLS, Layer.FREE)
                }
        return found


def sides(grid: Path) -> tuple[list[Entry], list[tuple[TileKey, dict[int, Patch]]]]:
    with possmap.open_grid(grid) as opened:
        entries = list(opened.ledger.entries())
        tiles = tallies.sides(opened, entries)
        return entries, [
            (tile.key, {number: tile.said(number) for number in tile.numbers}) for tile in tiles
        ]


def crowd_of(key: TileKey, some: Iterable[Patch], free_fusion: FreeFusion = "minimum") -> Crowd:
    crowd = Crowd(tile_window(key), free_fusion)
    for side in some:
        crowd.add(side)
    return crowd


def whole(key: TileKey, side: Patch) -> dict[Layer, NDArray[Any]]:
    """Return walls and denials of all cells of a tile, row by row."""
    return {
        layer: spread(side, layer, tile_window(key)).reshape(-1)
        for layer in (Layer.WALLS, Layer.FREE)
    }


def cells_of(layers: Mapping[Layer, NDArray[Any]]) -> NDArray[np.intp]:
    return np.flatnonzero((layers[Layer.WALLS] != 0) | (layers[Layer.FREE] != 0))


def in_cells(
    layers: Mapping[Layer, NDArray[Any]], cells: NDArray[np.intp]
) -> tuple[list[int], list[int]]:
    return layers[Layer.WALLS][cells].tolist(), layers[Layer.FREE][cells].tolist()


NOTHING = {layer: blank(layer).reshape(-1) for layer in (Layer.WALLS, Layer.FREE)}


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("seed", range(6))
def test_the_others_are_the_very_grid_that_is_fused_without_the_excursion(
    seed: int, profile: str, tmp_path: Path
) -> None:
    logs = excursions_of(random_team(np.random.default_rng(seed))[0])
    settings, grid = PROFILES[profile], tmp_path / "all.possmap"
    free_fusion = settings.get("free_fusion", "minimum")
    fuse(write_logs(tmp_path / "all", list(logs.values())), grid, settings)
    entries, by_tile = sides(grid)
    for number, entry in enumerate(entries):
        rest, alone = tmp_path / f"rest{number}", tmp_path / f"alone{number}"
        fuse(write_logs(tmp_path / "a", [logs[entry.name]]), alone, settings)
        own, others = stored(alone), {}
        if len(logs) > 1:
            kept = [log for name, log in logs.items() if name != entry.name]
            fuse(write_logs(tmp_path / f"r{number}", kept), rest, settings)
            others = stored(rest)
        said_in = {key: found[number] for key, found in by_tile if number in found}
        for key, layers in own.items():
            mine = whole(key, said_in.get(key, {}))
            assert cells_of(mine).tolist() == cells_of(layers).tolist()
        for key, found in by_tile:
            if number in found:
                mine = whole(key, found[number])
                cells = cells_of(mine)
                rest_of_it = crowd_of(key, found.values(), free_fusion).without(found[number])
                assert in_cells(mine, cells) == in_cells(own.get(key, NOTHING), cells)
                assert in_cells(whole(key, rest_of_it), cells) == in_cells(
                    others.get(key, NOTHING), cells
                )


@pytest.mark.parametrize("profile", PROFILES)
def test_a_robot_is_all_its_excursions_and_its_others_are_the_other_robots(
    profile: str, tmp_path: Path
) -> None:
    logs = list(excursions_of(random_team(np.random.default_rng(3))[0]).values())
    logs += [{**log, "excursion": f"{log['excursion']}-again"} for log in logs[:2]]
    settings, grid = PROFILES[profile], tmp_path / "all.possmap"
    free_fusion = settings.get("free_fusion", "minimum")
    fuse(write_logs(tmp_path / "all", logs), grid, settings)
    entries, by_tile = sides(grid)
    robot = logs[0]["robot"]
    mine = [log for log in logs if log["robot"] == robot]
    rest = [log for log in logs if log["robot"] != robot]
    assert len(mine) > 1
    assert rest
    fuse(write_logs(tmp_path / "mine", mine), tmp_path / "m.possmap", settings)
    fuse(write_logs(tmp_path / "rest", rest), tmp_path / "r.possmap", settings)
    own, others = stored(tmp_path / "m.possmap"), stored(tmp_path / "r.possmap")
    seen = 0
    for key, found in by_tile:
        parts = [
            crowd_of(key, some, free_fusion).whole()
            for some in (
                [one for number, one in found.items() if (entries[number].robot == robot) is me]
                for me in (True, False)
            )
        ]
        mine, theirs = (
            whole(key, parts[0]),
            whole(key, crowd_of(key, parts, free_fusion).without(parts[0])),
        )
        cells = cells_of(mine)
        assert in_cells(mine, cells) == in_cells(own.get(key, NOTHING), cells)
        assert in_cells(theirs, cells) == in_cells(others.get(key, NOTHING), cells)
        seen += len(cells)
    assert seen > 0


values = st.integers(0, FULL)
cells = st.lists(st.tuples(st.integers(0, TILE * TILE - 1), values, values), max_size=30)


ORIGIN = TileKey(0, 0)


def side_of(some: Sequence[tuple[int, int, int]]) -> Patch:
    layers = {layer: blank(layer) for layer in (Layer.WALLS, Layer.FREE)}
    for cell, wall, free in some:
        layers[Layer.WALLS].reshape(-1)[cell] = WEIGHT[wall]
        layers[Layer.FREE].reshape(-1)[cell] = free
    return {
        layer: Crop(tile_window(ORIGIN), cells) for layer, cells in layers.items() if cells.any()
    }


def tally_of(one: Patch, other: Patch) -> Tally:
    tally = Tally()
    tally.add(compare(one, crowd_of(ORIGIN, [one, other]).without(one), "minimum"))
    return tally


@given(cells, cells)
def test_of_two_each_contradicts_the_other_as_much(
    some: list[tuple[int, int, int]], more: list[tuple[int, int, int]]
) -> None:
    one, other = side_of(some), side_of(more)
    there, back = tally_of(one, other), tally_of(other, one)
    assert (there.wall_free, there.free_wall) == (back.free_wall, back.wall_free)
    assert (there.wall_wall, there.free_free) == (back.wall_wall, back.free_free)
    assert (
        there.compared
        == back.compared
        == len(set(cells_of(whole(ORIGIN, one))) & set(cells_of(whole(ORIGIN, other))))
    )
    assert 0 <= there.conflict <= 1
    assert 0 <= there.contradiction <= 1


@given(values, values, values, values)
def test_k_is_dempsters_of_the_masses_of_either_side(a: int, b: int, c: int, d: int) -> None:
    one, other = side_of([(7, a, b)]), side_of([(7, c, d)])
    tally = tally_of(one, other)
    if not (a or b) or not (c or d):
        assert tally.compared == 0
        return
    (wall, free), (wall2, free2) = (
        [float(part[7]) for part in committed(layers[Layer.WALLS], layers[Layer.FREE], "minimum")]
        for layers in (whole(ORIGIN, one), whole(ORIGIN, other))
    )
    assert tally.conflict == pytest.approx(wall * free2 + free * wall2)


def test_sure_of_a_wall_against_sure_of_free_space_is_k_1_and_agreement_is_k_0() -> None:
    wall, free = side_of([(7, FULL, 0)]), side_of([(7, 0, FULL)])
    assert whole(ORIGIN, wall)[Layer.WALLS][7] == CERTAIN
    assert tally_of(wall, free).conflict == pytest.approx(1, abs=1e-6)
    worst = tally_of(wall, free).worst
    assert worst
    assert worst[:2] == (0, 7)
    assert worst.conflict == pytest.approx(1, abs=1e-6)
    assert tally_of(wall, wall).conflict == tally_of(free, free).conflict == 0
    assert tally_of(wall, wall).worst is None


def test_a_side_that_contradicts_itself_leaves_to_each_of_its_masses_half() -> None:
    # N = 1 and Π = 0: METHOD §4 keeps both e⁻¹⁶ away and normalises the conflict.
    torn, free = side_of([(7, FULL, FULL)]), side_of([(7, 0, FULL)])
    assert tally_of(torn, free).conflict == pytest.approx(0.5, abs=1e-6)


def test_the_worst_place_is_in_the_square_that_contradicts_most_not_the_worst_cell() -> None:
    half = FULL // 2
    lonely, crowded = (5, FULL, 0), [(100 + column, half, 0) for column in range(8)]
    one = side_of([lonely, *crowded])
    other = side_of([(cell, 0, FULL) for cell, *_ in (lonely, *crowded)])
    worst = tally_of(one, other).worst
    assert worst
    assert worst[:2] == (0, 100)
    assert worst.conflict == pytest.approx(0.5, abs=1e-4)
    assert worst.in_square == pytest.approx(4, abs=1e-3)


def team() -> list[Log]:
    return logs_of(drive(shipped_world("figure8"), robots=5, minutes=12, seed=4, exchange=False))


@pytest.fixture(scope="module")
def honest() -> list[Log]:
    return team()


def audited(folder: Path, logs: Sequence[Log], **settings: Any) -> Audit:
    grid = folder / "site.possmap"
    grid.unlink(missing_ok=True)
    fuse(write_logs(folder / "logs", logs), grid, {"resolution": 0.1, **settings})
    return audit(grid)


def without_grid(found: Audit) -> Audit:
    return replace(found, grid=Path())


def test_the_order_of_the_logs_does_not_matter(honest: list[Log], tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, other = (
        audited(tmp_path / name, logs) for name, logs in (("a", honest), ("b", honest[::-1]))
    )
    assert [side.contradiction for side in one.excursions] == pytest.approx(
        [side.contradiction for side in other.excursions]
    )
    assert [(side.robot, side.compared, side.worst) for side in one.robots] == [
        (side.robot, side.compared, side.worst) for side in other.robots
    ]


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


def test_a_robot_far_from_all_others_is_not_judged_rather_than_cleared(
    honest: list[Log], tmp_path: Path
) -> None:
    far = retold({**honest[0], "robot": "far"}, start=(500.0, 0.0, 0.0))
    found = audited(tmp_path, [*honest, far])
    last = found.robots[-1]
    assert (last.robot, last.judged, last.compared, last.above) == ("far", False, 0, None)
    assert all(side.judged for side in found.robots[:-1])


@pytest.mark.parametrize("profile", ["paper", "robust"])
@pytest.mark.parametrize("fault", ["turns 5° per 45° wrong", "starts 1 m off", "starts 20° off"])
def test_a_robot_with_a_grave_fault_is_ranked_first(
    fault: str, profile: str, honest: list[Log], tmp_path: Path
) -> None:
    broken = honest[0]["robot"]
    logs = [FAULTS[fault](log) if log["robot"] == broken else log for log in honest]
    found = audited(tmp_path, logs, **(ROBUST if profile == "robust" else {}))
    assert found.robots[0].robot == broken


def test_a_log_retold_without_a_fault_is_the_log(honest: list[Log]) -> None:
    for log in honest:
        for record, same in zip(log["records"], retold(log)["records"], strict=True):
            assert record.keys() == same.keys()
            for key, value in record.items():
                if key == "heading":
                    assert math.remainder(same[key] - value, 360) == pytest.approx(0, abs=1e-3)
                elif isinstance(value, float):
                    assert same[key] == pytest.approx(value, abs=2e-3)
                else:
                    assert same[key] == value


def drives(robot: str, excursion: str, x: float, half: float) -> Log:
    """Return an excursion of one short run, its place uncertain by so many metres."""
    records = [
        {"seq": 0, "kind": "pose", "x": x, "y": 6, "heading": 0, "error_x": half, "error_y": half},
        {"seq": 1, "kind": "pose", "x": x + 0.1, "y": 6, "heading": 0},
    ]
    model = {"max_error": 100} if half else {"along": 0, "across": 0}
    return {
        "possmap_log": 1,
        "robot": robot,
        "excursion": excursion,
        "model": model,
        "records": records,
    }


def carried(folder: Path, logs: Sequence[Log]) -> Path:
    grid = folder / "site.possmap"
    outer = {"possmap_log": 1, "robot": "r", "excursion": "a", "records": [], "carried": logs}
    fuse(write_logs(folder / "logs", [outer]), grid, {"resolution": 0.05})
    return grid


def test_memory_does_not_grow_with_the_excursions_of_a_tile(tmp_path: Path) -> None:
    # 100 that each say something of all of a tile's 65,536 cells would be 119 MiB; 100 MiB more
    # to compare them. The memory of 128 MiB holds the interpreter, too.
    grid = carried(
        tmp_path, [drives(f"q{number % 70}", f"{number}", 6, 12) for number in range(99)]
    )
    tracemalloc.start()
    try:
        found = audit(grid, budget=Budget(LEAST_MIB))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 60 << 20
    assert sum(side.share == 1 for side in found.excursions) == 99


@pytest.mark.parametrize("kept", [0, 1 << 20])
def test_what_is_stamped_twice_says_the_same(
    kept: int, honest: list[Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole_site = audited(tmp_path, honest)
    monkeypatch.setattr(tallies, "_MOST_KEPT", kept)
    assert audit(tmp_path / "site.possmap") == whole_site


def test_a_small_excursion_takes_no_more_cells_than_it_may_touch(tmp_path: Path) -> None:
    far = [drives(f"q{number}", "a", 1000.0 * number, 0) for number in range(5)]
    _, by_tile = sides(carried(tmp_path, far))
    crops = [crop for _, found in by_tile for side in found.values() for crop in side.values()]
    assert len(crops) >= 5
    assert max(crop.window.cells for crop in crops) < 200


def test_pieces_that_do_not_fit_are_refused_before_they_are_sorted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each run lies in 40 tiles.
    far = [drives("q", "a", 0, 0), drives("p", "a", 0, 0)]
    for log in far:
        log["records"][1]["x"] = 500
    grid = carried(tmp_path, far)
    monkeypatch.setattr(tallies, "_PIECE_BYTES", 1 << 20)
    monkeypatch.setattr(tallies, "sides_by_tile", None)
    with pytest.raises(BudgetError, match="laying out 4 records needs --memory ") as caught:
        audit(grid, budget=Budget(LEAST_MIB))
    monkeypatch.undo()
    assert audit(grid, budget=Budget(LEAST_MIB)).robots
    # 39 pieces and more beyond one a record, a third more for what is not held, the program.
    needed = int(re.findall("--memory ([0-9]+)", str(caught.value))[0])
    assert needed >= 2 * 37 * 4 / 3 + 56


sided = st.lists(st.tuples(st.sampled_from("abcd"), st.sampled_from([0.0, 0.1, 0.25, 0.3, 1.0])))


@given(sided)
def test_others_are_all_values_but_the_owners(some: list[tuple[str, float]]) -> None:
    others = Others([value for _, value in some], [owner for owner, _ in some])
    for owner in "abcde":
        rest = np.array([value for one, value in some if one != owner])
        assert others.owners_without(owner) == len({one for one, _ in some if one != owner})
        median = np.median(rest) if len(rest) > 1 else None
        assert others.median_without(owner) == median
        if len(rest) < FEWEST:
            assert others.spread_without(owner) is None
        else:
            apart = np.median(np.abs(rest - np.median(rest)))
            assert others.spread_without(owner) == max(LEAST_SPREAD, 1.4826 * apart)
