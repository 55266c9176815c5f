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
from possmap.inspection.diff_summary import Cells, Change

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


def literally(a: Path, b: Path, window: Window, resolution: float, largest: int) -> Cells:
    """Compare whole arrays, and sort every change there is."""
    values = []
    for path in (a, b):
        with possmap.open_grid(path) as grid:
            values.append([grid.necessity(window), grid.possibility(window), grid.points(window)])
    known = [(n > 0) | (p < 1) | (points > 0) for n, p, points in values]
    contradicted = [n > p for n, p, _ in values]
    change = np.abs(np.array(values[1]) - np.array(values[0]))
    either = int((known[0] | known[1]).sum())

    ranked = []
    for row, column in np.argwhere(change.max(axis=0) > 0):
        quantity = int(change[:, row, column].argmax())
        at = (int(row) + window.row0, int(column) + window.column0)
        tile = (at[0] // TILE, at[1] // TILE)
        ranked.append((-change[quantity, row, column], tile, at, quantity))
    chosen: list[tuple[tuple[int, int], int]] = []
    for _, _, (row, column), quantity in sorted(ranked):
        if len(chosen) < largest and all(
            max(abs(row - r), abs(column - c)) >= APART[resolution] for (r, c), _ in chosen
        ):
            chosen.append(((row, column), quantity))

    names = ("necessity", "possibility", "point")
    return Cells(
        in_a=int(known[0].sum()),
        in_b=int(known[1].sum()),
        in_both=int((known[0] & known[1]).sum()),
        in_either=either,
        beyond={
            name: tuple(int((one > t).sum()) for t in (0.01, 0.1, 0.5))
            for name, one in zip(names, change, strict=True)
        },
        mean={
            name: float(one.sum()) / max(1, either) for name, one in zip(names, change, strict=True)
        },
        became_contradicted=int((contradicted[1] & ~contradicted[0]).sum()),
        ceased_contradicted=int((contradicted[0] & ~contradicted[1]).sum()),
        largest=tuple(
            Change(
                (column + 0.5) * resolution,
                (row + 0.5) * resolution,
                names[quantity],
                float(values[0][quantity][row - window.row0, column - window.column0]),
                float(values[1][quantity][row - window.row0, column - window.column0]),
            )
            for (row, column), quantity in chosen
        ),
    )


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
    for largest in (0, 1, 7, 30):
        found = diff(a, b, largest=largest, window_m=window_m).cells
        assert found is not None and found.in_either > 1000
        expected = literally(a, b, window, resolution, largest)
        assert found.mean == pytest.approx(expected.mean, rel=1e-12)
        for name in ("in_a", "in_b", "in_both", "in_either", "beyond", "became_contradicted",
                     "ceased_contradicted", "largest"):  # fmt: skip
            assert getattr(found, name) == getattr(expected, name), name


def test_the_other_way_round_every_change_is_the_opposite(tmp_path: Path) -> None:
    a, b = two_grids(tmp_path, 1, 0.05)
    there, back = diff(a, b).cells, diff(b, a).cells
    assert there is not None and back is not None
    assert (there.in_a, there.in_b, there.in_both) == (back.in_b, back.in_a, back.in_both)
    assert (there.beyond, there.mean) == (back.beyond, back.mean)
    assert there.became_contradicted == back.ceased_contradicted > 0
    assert [(one.x, one.y, one.a, one.b) for one in there.largest] == [
        (one.x, one.y, one.b, one.a) for one in back.largest
    ]
