"""The grid file: what is written is read: tiles, windows, digest, ledger; and whole outputs."""

from __future__ import annotations

import json
import re
import stat
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from literal.teams import random_excursion
from teams import digest, flat_settings, write_logs

import possmap
from possmap.atomic import replacing
from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers, blank
from possmap.core.lattice import TILE, TileKey, Window, tile_window
from possmap.core.settings import NO_ROBOTS, EvidenceSettings
from possmap.errors import OutputError
from possmap.grid.encoding import decode, encode
from possmap.grid.grid import Grid
from possmap.logs import read_log
from possmap.settings.limits import Limits

DATA = Path(__file__).parents[2] / "data" / "json"


def bump(robot: str = "r1", x: float = 0.5, **more: Any) -> Any:
    """Return a log of a bump at (``x``, 0.2), seen from the origin."""
    pose = {"kind": "pose", "x": 0, "y": 0, "heading": 0, "error_x": 0.2, "error_y": 0.1}
    wall = {"seq": 1, "kind": "wall", "x": x, "y": 0.2, "x2": x, "y2": 0.2}
    records = [{"seq": 0, **pose}, wall, {"seq": 2, **pose}]
    return {"possmap_log": 1, "robot": robot, "excursion": "a", "records": records, **more}


def fused(folder: Path, *logs: Any, name: str = "site", **settings: Any) -> Path:
    grid = folder / f"{name}.possmap"
    summary = possmap.fuse(write_logs(folder / name, logs), grid, flat_settings(settings))
    assert summary.count("refused") == 0, [log.error for log in summary.logs]
    return grid


# Tiles ------------------------------------------------------------------------------------------

VALUES = st.sampled_from([1, 65535, 65536, 2**32 - 1, 2**32, 2**40]) | st.integers(1, 2**40)
PLACES = st.tuples(st.integers(0, TILE - 1), st.integers(0, TILE - 1))


@st.composite
def layers_of_a_tile(draw: st.DrawFn) -> tuple[Layer, LayerArray]:
    """Make a layer with a few cells, or with all cells of a block, up to a largest value."""
    layer = draw(st.sampled_from(Layer))
    array = blank(layer)
    most = 65535 if layer is Layer.FREE else 2**40
    for (row, column), value in draw(st.dictionaries(PLACES, VALUES, min_size=1)).items():
        array[row, column] = min(value, most)
    if draw(st.booleans()):
        rows, columns = (slice(*sorted(draw(PLACES))) for _ in "ab")
        rng = np.random.default_rng(draw(st.integers(0, 99)))
        largest = min(draw(VALUES), most)
        array[rows, columns] = rng.integers(0, largest, array[rows, columns].shape, endpoint=True)
    if not array.any():
        array[0, 0] = 1
    return layer, array


@given(one=layers_of_a_tile())
@budget(max_examples=150, deadline=None)
def test_a_tile_comes_back_as_it_was(one: tuple[Layer, LayerArray]) -> None:
    layer, array = one
    encoded = encode(layer, TileKey(-1, 2), array)
    whole = blank(layer)
    cells = decode(encoded.bounds, encoded.data)
    whole[encoded.bounds.slices_in(Window(0, TILE, 0, TILE))] = cells
    assert cells.dtype == array.dtype
    assert np.array_equal(whole, array)
    assert encoded.digest == encode(layer, TileKey(-1, 2), array.copy()).digest
    assert encoded.digest != encode(layer, TileKey(2, -1), array).digest


TILES = [TileKey(row, column) for row in (-2, -1, 0) for column in (-1, 0, 3)]


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[Layer, LayerArray], Window]:
    """Make a grid of random tiles, the same as dense arrays, and their window."""
    path = tmp_path_factory.mktemp("dense") / "site.possmap"
    window = Window(-2 * TILE, TILE, -TILE, 4 * TILE)
    whole = {layer: np.zeros(window.shape, dtype=blank(layer).dtype) for layer in Layer}
    rng = np.random.default_rng(5)
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(EvidenceSettings(), NO_ROBOTS)
        for key in TILES:
            layers: TileLayers = {}
            for layer in rng.permutation(list(Layer))[:2]:
                array = layers[Layer(layer)] = blank(Layer(layer))
                low, high = np.sort(rng.integers(1, TILE, (2, 2)), axis=0)
                block = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
                array[block] = rng.integers(0, 60000, array[block].shape)
                array[0, -1] = 7
                whole[Layer(layer)][tile_window(key).slices_in(window)] = array
            grid.tiles.write(key, layers)
    return path, whole, window


@given(
    corner=st.tuples(st.integers(-540, 270), st.integers(-300, 1100)),
    size=st.tuples(st.sampled_from([0, 1, 2, 255, 256, 257, 600]), st.integers(0, 600)),
    layer=st.sampled_from(Layer),
)
@budget(max_examples=60, deadline=None)
def test_a_window_reads_what_a_dense_array_holds(
    dense: tuple[Path, dict[Layer, LayerArray], Window],
    corner: tuple[int, int],
    size: tuple[int, int],
    layer: Layer,
) -> None:
    path, whole, all_of_it = dense
    window = Window(corner[0], corner[0] + size[0], corner[1], corner[1] + size[1])
    expected = np.zeros(window.shape, dtype=whole[layer].dtype)
    shared = window.intersection(all_of_it)
    if shared.cells:
        expected[shared.slices_in(window)] = whole[layer][shared.slices_in(all_of_it)]
    with Grid(path) as grid:
        found = grid.tiles.read_window(layer, window)
    assert found.dtype == expected.dtype
    assert np.array_equal(found, expected)


# Digest -----------------------------------------------------------------------------------------


def test_the_same_evidence_has_one_digest_and_any_other_another(tmp_path: Path) -> None:
    logs = [bump(), bump("r2", x=-7.0)]
    there = digest(fused(tmp_path, *logs, name="there"))
    back = [{**logs[1], "x_who": "me"}, bump("r3", carried=[logs[0]]), logs[1]]
    both = digest(fused(tmp_path, *logs, bump("r3"), name="both"))
    assert digest(fused(tmp_path, *back, name="back")) == both != there
    others = [
        fused(tmp_path, bump(), name="fewer"),
        fused(tmp_path, bump(), bump("r2", x=-7.0 + 1e-9), name="hair"),
        fused(tmp_path, bump(), bump("r4", x=-7.0), name="robot"),
        fused(tmp_path, bump(), bump("r2", x=-7.0, excursion="b"), name="excursion"),
        fused(tmp_path, bump(), bump("r2", x=-7.0, model={"drift": 1e-9}), name="model"),
        fused(tmp_path, *logs, name="setting", clip_coobserved=True),
        fused(tmp_path, *logs, name="resolution", resolution=0.1),
    ]
    assert len({there, both, *map(digest, others)}) == 2 + len(others)


# Far away ---------------------------------------------------------------------------------------


def test_the_ends_of_the_world_cost_little(tmp_path: Path) -> None:
    corners = [(x, y) for x in (-1e6, 1e6) for y in (-1e6, 1e6)]
    logs: list[dict[str, Any]] = []
    for number, (x, y) in enumerate(corners):
        here = {"x": x, "y": y, "heading": 0}
        there = {"x": -x, "y": -y}
        records = [
            {"seq": 0, "kind": "pose", **here},
            {"seq": 1, "kind": "beam", "x": x, "y": y, "x2": -x, "y2": -y},
            {"seq": 2, "kind": "pose", **here},
            {"seq": 3, "kind": "pose", **there, "heading": 0},
        ]
        logs += [{"possmap_log": 1, "robot": f"r{number}", "excursion": "a", "records": records}]
    start = time.perf_counter()
    tracemalloc.start()
    grid = fused(tmp_path, *logs)
    with possmap.open_grid(grid) as opened:
        window = opened.window
        for x, y in corners:
            row, column = opened.lattice.cell_of(x, y)
            assert opened.necessity(Window(row, row + 1, column, column + 1))[0, 0] > 0.999
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.perf_counter() - start < 5
    assert window == Window(-20_000_000, 20_000_001, -20_000_000, 20_000_001)
    assert peak < 30e6 and grid.stat().st_size < 500_000


def test_a_wall_of_two_thousand_kilometres_is_refused_at_once(tmp_path: Path) -> None:
    wall = {"seq": 1, "kind": "wall", "x": -1e6, "y": 0.01, "x2": 1e6, "y2": 0.02}
    records = bump()["records"]
    paths = write_logs(tmp_path / "logs", [bump(records=[records[0], wall, records[2]])])
    start = time.perf_counter()
    (log,) = possmap.fuse(paths, tmp_path / "site.possmap").logs
    assert time.perf_counter() - start < 1
    assert log.status == "refused" and "(setting limit_record_cells)" in str(log.error)


def test_a_small_log_of_much_work_is_refused_before_any_is_done(tmp_path: Path) -> None:
    """Wide stamps, each cell of them touched thousands of times; then long lines, many of them."""
    model = {"along": 0, "across": 0, "max_error": 10000}
    pose = {"kind": "pose", "heading": 0, "x": 0, "y": 0}
    wide = [{"seq": 0, **pose, "error_x": 140, "error_y": 140}, {"seq": 1, **pose, "x": 280}]
    many = [{"seq": 0, **pose, "error_x": 20, "error_y": 20}]
    many += [{"seq": n, **pose, "x": 200 * (n % 2)} for n in range(1, 200)]
    thin = [{"seq": n, "kind": "wall", "x": 0, "y": 0, "x2": 2e4, "y2": n} for n in range(1, 1001)]
    thin = [{"seq": 0, **pose}, *thin, {"seq": 1001, **pose}]
    every = {"a": wide, "b": many, "c": thin}
    logs = [bump(name, records=some, model=model) for name, some in every.items()]
    start = time.process_time()
    read = possmap.fuse(write_logs(tmp_path / "logs", logs), tmp_path / "site.possmap").logs
    assert time.process_time() - start < 4
    ends = [str(log.error).rpartition("(setting ")[2] for log in read]
    assert ends == ["limit_record_cells)", "limit_file_cells)", "limit_file_cells)"]


def test_what_the_correction_takes_off_every_lattice_is_refused(tmp_path: Path) -> None:
    pose = {"kind": "pose", "y": 0, "heading": 0}
    records = [{"seq": 0, "x": -1e6, **pose}, {"seq": 1, "x": 1e6, **pose}]
    log = bump(records=records, model={"scale": 1e6, "along": 0, "across": 0})
    paths = write_logs(tmp_path / "logs", [log])
    (log,) = possmap.fuse(paths, tmp_path / "site.possmap", {"resolution": 0.001}).logs
    assert log.error == (
        f"{paths[0]}:1: seq 1 of excursion a of robot r1 lies, corrected, 2e+12 m from the origin, "
        "expected less than 1.13e+12"
    )


def test_many_records_that_touch_much_are_refused_together(tmp_path: Path) -> None:
    walls = [
        {"seq": n, "kind": "wall", "x": -2e4, "y": 0.01, "x2": 2e4, "y2": n / 100}
        for n in range(1, 2001)
    ]
    pose = bump()["records"][0]
    records = [pose, *walls, {**pose, "seq": 2001}]
    paths = write_logs(tmp_path / "logs", [bump(records=records), bump(robot="other")])
    grid = tmp_path / "site.possmap"
    start = time.perf_counter()
    large, small = possmap.fuse(paths, grid).logs
    assert time.perf_counter() - start < 5
    assert str(large.error).startswith(f"{paths[0]}: its records take ")
    assert str(large.error).endswith("expected at most 3e+11 (setting limit_file_cells)")
    assert (large.status, small.status) == ("refused", "fused")
    with possmap.open_grid(grid) as opened:
        assert [entry.robot for entry in opened.ledger.entries()] == ["other"]


def test_a_ledger_may_hold_more_than_a_log(tmp_path: Path) -> None:
    """Each of its excursions came as a log once, and may hold no more than that."""
    one, two = bump(), {**bump(x=-100.5), "excursion": "b"}  # in different tiles
    both = {**one, "carried": [{key: two[key] for key in two if key != "possmap_log"}]}
    old, new = tmp_path / "old.possmap", tmp_path / "new.possmap"
    possmap.fuse(write_logs(tmp_path / "logs", [one, two]), old)
    (whole,) = write_logs(tmp_path / "both", [both])

    def refusal(path: Path, most: int) -> str | None:
        (log,) = possmap.fuse([path], new, {"limit_file_cells": most}, dry_run=True).logs
        return log.error

    found = re.search(r"take (\S+) cells of work", refusal(whole, 1000) or "")
    assert found
    of_one = float(found[1])
    assert refusal(whole, int(1.5 * of_one)) is not None
    assert refusal(old, int(1.5 * of_one)) is None
    assert str(refusal(old, 1000)).endswith(
        " cells of work, expected at most 1e+03 (setting limit_file_cells)"
    )


# Ledger -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_the_ledger_gives_back_what_was_read(seed: int, tmp_path: Path) -> None:
    log = random_excursion(np.random.default_rng(seed), "Ada:3.b", "a")
    log["records"][-1]["x_mine"] = [1, {"é": None}]
    log |= {"model": {"drift": -0.1, "scale": 1 + 2**-52}, "x_floor": "wet"}
    (path,) = write_logs(tmp_path / "logs", [log])
    (delivery,) = read_log(path, Limits()).deliveries
    grid = tmp_path / "site.possmap"
    possmap.fuse([path], grid)
    with possmap.open_grid(grid) as opened:
        (entry,) = opened.ledger.entries()
        known = opened.ledger.version(entry)
    assert known == delivery.version and repr(known) == repr(delivery.version)
    assert json.loads(known.extra)["x_floor"] == "wet"
    assert json.loads(known.records[-1].extra)["x_mine"] == [1, {"é": None}]


def test_what_waited_lies_on_the_map_once_the_longer_version_comes(tmp_path: Path) -> None:
    log = bump()
    short = {**log, "records": log["records"][:2]}
    grid = fused(tmp_path, short)
    assert placed(grid) == {0: (0.0, 0.0)}
    assert cells_of(grid) is None
    possmap.fuse(write_logs(tmp_path / "later", [log]), grid)
    assert placed(grid) == {0: (0.0, 0.0), 1: (0.5, 0.2), 2: (0.0, 0.0)}
    assert digest(grid) == digest(fused(tmp_path, log, name="at once"))
    assert cells_of(grid) is not None


def placed(grid: Path) -> dict[int, tuple[float, float]]:
    with possmap.open_grid(grid) as opened:
        (entry,) = opened.ledger.entries()
        return {number: (at.x, at.y) for number, at in opened.ledger.geometry(entry).items()}


def cells_of(grid: Path) -> Window | None:
    with possmap.open_grid(grid) as opened:
        return opened.window


def test_the_own_keys_of_what_waited_outlive_a_longer_version_without_them(tmp_path: Path) -> None:
    log = bump()
    pose, wall, last = log["records"]
    noted = [{**pose, "x_note": "door"}, {**wall, "x_note": "warm"}]
    grid = fused(tmp_path, {**log, "records": noted})
    possmap.fuse(write_logs(tmp_path / "later", [{**log, "records": [pose, wall, last]}]), grid)
    with possmap.open_grid(grid) as opened:
        (entry,) = opened.ledger.entries()
        extras = [record.extra for record in opened.ledger.version(entry).records]
    assert extras == ['{"x_note":"door"}', '{"x_note":"warm"}', ""]


# Outputs ----------------------------------------------------------------------------------------


def fail_midway(path: Path, error: BaseException) -> None:
    with replacing(path, overwrite=True) as stream:
        stream.write(b"half of it")
        raise error


@pytest.mark.parametrize("before", [[], [b"precious"]])
@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (ValueError("a bug"), ValueError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (OSError(28, "No space left on device"), OutputError),
    ],
)
def test_an_output_that_fails_midway_leaves_no_trace(
    error: BaseException, seen: type[BaseException], before: list[bytes], tmp_path: Path
) -> None:
    path = tmp_path / "out.npz"
    for content in before:
        path.write_bytes(content)
    with pytest.raises(seen):
        fail_midway(path, error)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == before


def test_an_output_appears_whole_and_as_readable_as_any_new_file(tmp_path: Path) -> None:
    path, ordinary = tmp_path / "out.npz", tmp_path / "ordinary"
    ordinary.touch()
    with replacing(path, overwrite=False) as stream:
        stream.write(b"all of it")
        stream.flush()
        assert not path.exists()
    assert path.read_bytes() == b"all of it"
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(ordinary.stat().st_mode)
    with pytest.raises(OutputError, match="exists already"), replacing(path, overwrite=False):
        pytest.fail("nothing is to be written")
    assert sorted(tmp_path.iterdir()) == [ordinary, path]
