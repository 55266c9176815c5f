"""``--memory`` bounds what a command takes; what does not fit is refused, and nothing differs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from maps import drawn_grid

import possmap
from possmap.budget import LEAST_MIB, Budget
from possmap.cli.main import main
from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, TileLayers, blank
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.patches import extent_of
from possmap.core.settings import EvidenceSettings
from possmap.errors import BudgetError
from possmap.grid.grid import Grid
from possmap.pictures import raster
from possmap.pictures.render import Look, render

DATA = Path(__file__).parents[2] / "data" / "json"


def tile(row: int, column: int) -> TileLayers:
    """Return a tile with a run through it, and a wall beside the run."""
    free, walls = blank(Layer.FREE), blank(Layer.WALLS)
    at = 40 + (7 * row + 3 * column) % 150
    free[at : at + 12] = 50_000
    walls[at + 20 : at + 24, 10:200] = CERTAIN // 3
    return {Layer.FREE: free, Layer.WALLS: walls}


def lattice(path: Path, rows: int, columns: int) -> Path:
    """Write a grid of tiles that no excursion reported."""
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(EvidenceSettings(), {})
        for key in np.ndindex(rows, columns):
            grid.tiles.write(TileKey(*key), tile(*key))
    return path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lattice(tmp_path_factory.mktemp("lattice") / "site.possmap", 40, 30)


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


def peak_mib(*args: object) -> float:
    """Return the peak memory of a command in a process of its own, which must succeed."""
    measure = (
        "import resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = [sys.executable, "-m", "possmap", "-q", *map(str, args)]
    done = subprocess.run(
        [sys.executable, "-c", measure, *command], check=True, capture_output=True, text=True
    )
    return int(done.stdout) / 1024


# Numbers ----------------------------------------------------------------------------------------


def test_more_memory_never_means_less_of_anything() -> None:
    budgets = [Budget(mib) for mib in (LEAST_MIB, 200, 256, 1024, 100_000)]
    for name in ("cache_kib", "held", "batch_records"):
        values = [getattr(budget, name) for budget in budgets]
        assert values == sorted(values) and values[0] > 0, name


def test_what_a_refusal_asks_for_is_enough_and_no_more() -> None:
    for size in (Budget().held + 1, 10**9 + 7, 3 * 10**11):
        needed = Budget().needed_for(size)
        Budget(needed).check_held("it", size)
        with pytest.raises(BudgetError, match=f"^it needs --memory {needed}, found {needed - 1}$"):
            Budget(needed - 1).check_held("it", size)


# Pictures ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "look",
    [
        Look(),
        Look(bare=True),
        Look(bare=True, layers=("necessity",), palette="gray"),
        Look(bare=True, max_size=333),
        Look(layers=("probability",), max_size=500),
    ],
    ids=str,
)
def test_bands_draw_the_same_picture_byte_for_byte(
    site: Path, tmp_path: Path, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, banded = (tmp_path / f"{name}.png" for name in ("whole", "banded"))
    render(site, whole, look)
    monkeypatch.setattr(raster, "_BAND_BLOCKS", 1000)
    render(site, banded, look)
    assert whole.read_bytes() == banded.read_bytes()


def test_bands_of_a_picture_hold_each_row_of_blocks_once() -> None:
    whole = raster.Raster(Window(-30, 3570, 6, 9006), 30)
    bands = list(whole.bands())
    assert [first for first, _ in bands] == [
        sum(band.blocks[0] for _, band in bands[:at]) for at in range(len(bands))
    ]
    assert bands[0][1].window.row0 == -30 and bands[-1][1].window.row1 == 3570


def test_a_picture_that_does_not_fit_is_refused_with_what_would_help(
    site: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.png"
    result = run("render", site, "-o", out, "--scale", 1)
    assert (result.exit_code, result.stdout) == (1, "")
    assert re.fullmatch(
        r"possmap: 1 × \d+ × \d+ pixels with axes and keys, expected at most 40,000,000; "
        r"--max-size PIXELS shrinks it, --window X0,Y0,X1,Y1 takes a part, "
        r"--bare leaves all but the cells\n",
        result.stderr,
    )
    assert not out.exists()


def test_tiles_that_do_not_fit_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(DATA, grid)
    out = tmp_path / "out.png"
    monkeypatch.setattr("possmap.pictures.tiles.MOST_TILES", 1)
    result = run("render", grid, "-o", out, "--animate", "excursion")
    assert result.exit_code == 1 and not out.exists()
    assert result.stderr == (
        f"possmap: {grid}: more than 1 tiles laid out again, expected fewer; "
        "take a part of it: --window X0,Y0,X1,Y1\n"
    )


# What a file holds ------------------------------------------------------------------------------


def sparse(path: Path) -> dict[TileKey, set[Layer]]:
    """Write tiles here and there, each with some of its layers; return which."""
    rng = np.random.default_rng(7)
    found: dict[TileKey, set[Layer]] = {}
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(EvidenceSettings(), {})
        for row, column in rng.integers(-60, 60, (90, 2)).tolist():
            key = TileKey(row, column)
            layers: TileLayers = {}
            for layer in rng.permutation(list(Layer))[: rng.integers(1, 4)]:
                array = layers[Layer(layer)] = blank(Layer(layer))
                array[tuple(rng.integers(0, TILE, 2))] = 9
            grid.tiles.write(key, layers)
            found.setdefault(key, set()).update(layers)
    return found


def test_rows_columns_bounds_and_count_are_those_of_all_tiles(tmp_path: Path) -> None:
    path = tmp_path / "site.possmap"
    held = sparse(path)
    with Grid(path) as grid:
        directory, everything = grid.tiles.directory, Window(-60 * TILE, 60 * TILE, -(9**9), 9**9)
        assert directory.rows() == sorted({key.row for key in held})
        assert directory.rows(everything) == directory.rows()
        assert directory.rows(Window(0, 256, 0, 0)) == []
        for row in directory.rows():
            assert directory.columns(row, everything) == sorted(
                k.column for k in held if k.row == row
            )
        assert directory.count() == len(held)
        bounds = directory.bounds()
        crops = [crop.window for patch in grid.tiles.patches(everything) for crop in patch.values()]
    assert bounds == Window(
        min(one.row0 for one in crops), max(one.row1 for one in crops),
        min(one.column0 for one in crops), max(one.column1 for one in crops),
    )  # fmt: skip


def test_patches_hold_what_windows_hold(site: Path) -> None:
    window = Window(100, 3000, 130, 2000)
    with Grid(site) as grid:
        for layer in Layer:
            whole = np.zeros(window.shape, dtype=blank(layer).dtype)
            for patch in grid.tiles.patches(window):
                assert extent_of(patch).intersection(window) == extent_of(patch)
                if layer in patch:
                    crop = patch[layer]
                    target = whole[crop.window.slices_in(window)]
                    assert not (target.any() and crop.cells.any() and (target * crop.cells).any())
                    target += crop.cells
            assert np.array_equal(whole, grid.tiles.read_window(layer, window))


def test_an_array_that_does_not_fit_is_refused(site: Path) -> None:
    with Grid(site, budget=Budget(LEAST_MIB)) as grid:
        with pytest.raises(BudgetError) as refused:
            grid.necessity()
        assert str(refused.value) == (
            f"{site}: an array of 10155 × 7680 cells needs --memory 850, found 128; or read parts "
            "of it"
        )
        assert grid.necessity(Window(0, 300, 0, 300)).max() > 0


def test_a_digest_is_computed_anew_after_a_change(tmp_path: Path) -> None:
    grid_path = drawn_grid(tmp_path / "site.possmap", ["#.?"])
    with Grid(grid_path) as reader:
        before = reader.digest()
        with Grid(grid_path, write=True) as writer:
            assert writer.digest() == before
            with writer.transaction():
                writer.tiles.write(TileKey(0, 0), tile(0, 0))
                after = writer.digest()
        assert before != after == reader.digest()


# Whole processes --------------------------------------------------------------------------------


def bounded(folder: Path, rows: int, columns: int) -> Iterator[tuple[str, float]]:
    """Yield commands on a site, and the peak memory of each [MiB]."""
    grid = lattice(folder / "site.possmap", rows, columns)
    other = folder / "other.possmap"
    other.write_bytes(grid.read_bytes())
    possmap.fuse(DATA, other)
    for name, *args in (
        ("info", "info", grid, "--json"),
        ("query", "query", grid, 3, 3),
        ("map", "render", grid, "-o", folder / "map.png"),
        (
            "layer",
            "render",
            grid,
            "-o",
            folder / "n.png",
            "--layer",
            "necessity",
            "--max-size",
            900,
        ),
        ("npz", "export", grid, "-o", folder / "site.npz", "--window", "0,0,400,300"),
        ("diff", "diff", grid, other),
    ):
        yield name, peak_mib(*args)


@pytest.mark.thorough
def test_commands_stay_within_their_memory(tmp_path: Path) -> None:
    peaks = dict(bounded(tmp_path, 40, 50))
    assert max(peaks.values()) < 160, peaks


@pytest.mark.slow
def test_commands_stay_within_their_memory_on_20_000_tiles(tmp_path: Path) -> None:
    peaks = dict(bounded(tmp_path, 160, 125))
    assert max(peaks.values()) < 160, peaks
    assert json.loads(run("info", tmp_path / "site.possmap", "--json").stdout)["tiles"] == 20_000
