"""What ``diff`` says is what a literal comparison of whole arrays says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import possmap
from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, TileLayers, blank
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.pyramid import FULL
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid
from possmap.inspection.diff import diff

APART = {0.05: 20, 0.3: 4, 2.0: 1}
"""Cells between changes that are named, by resolution: at least 1 m."""


def scribbled(rng: np.random.Generator) -> TileLayers:
    """Return a tile with rectangles of evidence; some have values in common, and some tie."""
    layers: TileLayers = {}
    for layer, full in ((Layer.WALLS, CERTAIN), (Layer.FREE, FULL), (Layer.POINTS, CERTAIN)):
        array = blank(layer)
        for _ in range(rng.integers(0, 5)):
            row, column = rng.integers(0, TILE - 1, 2)
            height, width = rng.integers(1, 130, 2)
            array[row : row + height, column : column + width] = full // rng.choice([1, 3, 8, 90])
        if array.any():
            layers[layer] = array
    return layers


def two_grids(folder: Path, seed: int, resolution: float) -> tuple[Path, Path]:
    """Write two grids with tiles of their own, tiles in common, and tiles that differ a little."""
    rng = np.random.default_rng(seed)
    a, b = folder / "a.possmap", folder / "b.possmap"
    settings = EvidenceSettings(resolution=resolution)
    with (
        Grid(a, write=True) as of_a,
        Grid(b, write=True) as of_b,
        of_a.transaction(),
        of_b.transaction(),
    ):
        for grid in (of_a, of_b):
            grid.prepare(settings, {})
        for place in np.ndindex(3, 3):
            key, kind = TileKey(place[0] - 1, place[1] - 2), rng.integers(0, 5)
            tile = scribbled(rng)
            if kind in (0, 2, 3):
                of_a.tiles.write(key, tile)
            if kind in (1, 2):
                of_b.tiles.write(key, tile)
            if kind == 3:
                of_b.tiles.write(key, {**tile, **scribbled(rng)})
    return a, b


QUANTITIES = ("belief", "plausibility", "points")


@pytest.mark.parametrize("resolution", APART)
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("part", [False, True])
def test_tile_by_tile_is_the_same_as_at_once(
    seed: int, resolution: float, part: bool, tmp_path: Path
) -> None:
    a, b = two_grids(tmp_path, seed, resolution)
    window = Window(-TILE, 2 * TILE, -2 * TILE, TILE)
    window_m = None
    if part:
        window = Window(-100, 300, -301, 77)
        x0, x1 = (column * resolution for column in (window.column0, window.column1))
        window_m = (x0, window.row0 * resolution, x1, window.row1 * resolution)
    found = diff(a, b, largest=7, window_m=window_m)
    values, known, contested = [], [], []
    for path in (a, b):
        with possmap.open_grid(path) as grid:
            values.append([grid.view(name, window) for name in QUANTITIES])
            known.append((grid.necessity(window) > 0) | (grid.possibility(window) < 1)
                         | (grid.points(window) > 0))  # fmt: skip
            contested.append(grid.view("contested", window) > 0.5)
    change = np.abs(np.array(values[1]) - np.array(values[0]))
    cells = found.cells
    assert cells is not None and cells.in_either > 1000
    assert cells.in_a == known[0].sum() and cells.in_b == known[1].sum()
    assert cells.in_both == (known[0] & known[1]).sum()
    assert cells.in_either == (known[0] | known[1]).sum()
    assert cells.beyond.tolist() == [
        [(one > threshold).sum() for threshold in (0.01, 0.1, 0.5)] for one in change
    ]
    np.testing.assert_allclose(cells.moved, change.sum(axis=(1, 2)), rtol=1e-12)
    assert cells.became == (contested[1] & ~contested[0]).sum()
    assert cells.ceased == (contested[0] & ~contested[1]).sum()
    sizes = [abs(one.b - one.a) for one in found.largest]
    assert len(sizes) == 7 and sizes == sorted(sizes, reverse=True)
    assert sizes[0] == change.max()
    places = []
    for one in found.largest:
        row, column = round(one.y / resolution - 0.5), round(one.x / resolution - 0.5)
        at = (row - window.row0, column - window.column0)
        number = ("belief", "plausibility", "point").index(one.quantity)
        assert (one.a, one.b) == (values[0][number][at], values[1][number][at])
        for r, c in places:
            assert max(abs(row - r), abs(column - c)) >= APART[resolution]
        places.append((row, column))


def test_the_other_way_round_every_change_is_the_opposite(tmp_path: Path) -> None:
    a, b = two_grids(tmp_path, 1, 0.05)
    one, other = diff(a, b), diff(b, a)
    there, back = one.cells, other.cells
    assert there is not None and back is not None
    assert (there.in_a, there.in_b, there.in_both) == (back.in_b, back.in_a, back.in_both)
    assert (there.beyond == back.beyond).all() and (there.moved == back.moved).all()
    assert there.became == back.ceased
    assert [(one.x, one.y, one.a, one.b) for one in one.largest] == [
        (one.x, one.y, one.b, one.a) for one in other.largest
    ]
