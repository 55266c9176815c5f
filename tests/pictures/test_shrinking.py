"""Big maps shrink by blocks: max of N, min of Π, and nothing thin is lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN
from possmap.core.lattice import Window
from possmap.core.patches import Crop, Patch
from possmap.core.pyramid import FULL
from possmap.pictures import compose, raster
from possmap.pictures.compose import Scene

Place = tuple[int, int]


@dataclass
class Sketch:
    """Cells by hand: a number for some (row, column) of each layer."""

    walls: dict[Place, int] = field(default_factory=dict)
    free: dict[Place, int] = field(default_factory=dict)
    points: dict[Place, int] = field(default_factory=dict)

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what there is, cell by cell."""
        layers = {Layer.WALLS: self.walls, Layer.FREE: self.free, Layer.POINTS: self.points}
        for layer, places in layers.items():
            for (row, column), value in places.items():
                cell = Window(row, row + 1, column, column + 1)
                if cell.intersection(window).cells:
                    others = {
                        one: Crop(cell, np.array([[values.get((row, column), 0)]]))
                        for one, values in layers.items()
                    }
                    yield {**others, layer: Crop(cell, np.array([[value]]))}


def gray(sketch: Sketch, layer: str, chosen: raster.Raster) -> NDArray[np.uint8]:
    return np.asarray(compose.bare(Scene(sketch, 0.1, "minimum"), layer, chosen, "gray"))


def coloured(sketch: Sketch, layer: str, chosen: raster.Raster) -> NDArray[np.uint8]:
    return np.asarray(
        compose.bare(Scene(sketch, 0.1, "minimum"), layer, chosen, "viridis").convert("RGB")
    )


def pixel_of(chosen: raster.Raster, row: int, column: int) -> tuple[int, int]:
    """Return row and column of the pixel that holds a cell."""
    x, y = chosen.to_pixel((column + 0.5) * 0.1, (row + 0.5) * 0.1, 0.1)
    return int(y), int(x)


windows = st.builds(
    lambda row, column, rows, columns: Window(row, row + rows, column, column + columns),
    st.integers(-700, 300),
    st.integers(-5000, 300),
    st.integers(1, 700),
    st.integers(1, 700),
)


@given(windows, st.integers(1, 400), st.data())
def test_a_wall_of_one_cell_stays_visible_at_every_size(
    window: Window, max_size: int, data: st.DataObject
) -> None:
    row = data.draw(st.integers(window.row0, window.row1 - 1))
    column = data.draw(st.integers(window.column0, window.column1 - 1))
    denied = data.draw(st.integers(0, FULL))
    around = {(row + k, column + m): denied for k in (-1, 0, 1) for m in (-1, 0, 1) if k or m}
    wall, none = Sketch({(row, column): CERTAIN}, around), Sketch({}, around)
    chosen = raster.plan(window, None, max_size)
    at = pixel_of(chosen, row, column)
    assert gray(wall, "necessity", chosen)[at] == 255
    assert gray(none, "necessity", chosen)[at] == 0
    with_wall = coloured(wall, "map", chosen).astype(int)
    without = coloured(none, "map", chosen).astype(int)
    assert np.abs(with_wall - without)[at].sum() > 60
    with_wall[at] = without[at]
    np.testing.assert_array_equal(with_wall, without)


@given(windows, st.integers(2, 400))
def test_the_longer_side_is_never_beyond_max_size(window: Window, max_size: int) -> None:
    assert max(raster.plan(window, None, max_size).size) <= max_size
    assert max(raster.plan(window, 7, max_size).size) <= max_size


@given(windows, st.integers(1, 400))
def test_the_picture_holds_its_window_and_no_block_beyond(window: Window, max_size: int) -> None:
    chosen = raster.plan(window, None, max_size)
    w = chosen.window
    assert w.intersection(window) == window
    assert window.row0 - w.row0 < chosen.shrink and w.row1 - window.row1 < chosen.shrink
    assert window.column0 - w.column0 < chosen.shrink
    assert w.column1 - window.column1 < chosen.shrink


def scattered(seed: int, rows: int, columns: int) -> Sketch:
    """Return cells of every sort, some unknown, over rows and columns from (-40, -30)."""
    rng = np.random.default_rng(seed)
    sketch = Sketch()
    for layer, most in ((sketch.walls, CERTAIN), (sketch.free, FULL), (sketch.points, CERTAIN)):
        for row, column in rng.integers((-40, -30), (rows - 40, columns - 30), (90, 2)):
            layer[int(row), int(column)] = int(rng.integers(1, most))
    return sketch


@pytest.mark.parametrize("shrink", [2, 3, 7, 300])
@pytest.mark.parametrize(("layer", "by"), [
    ("necessity", "max"), ("possibility", "min"), ("conflict", "max"), ("points", "max"),
    ("ignorance", "min"), ("belief", "max"), ("plausibility", "min"), ("contested", "max"),
])  # fmt: skip
def test_a_block_is_the_largest_or_smallest_of_its_cells(layer: str, by: str, shrink: int) -> None:
    sketch = scattered(shrink, 90, 70)
    window = Window(-40 // shrink * shrink, -(-50 // shrink) * shrink,
                    -30 // shrink * shrink, -(-40 // shrink) * shrink)  # fmt: skip
    every = gray(sketch, layer, raster.Raster(window))
    blocks = every.reshape(every.shape[0] // shrink, shrink, -1, shrink)
    expected = blocks.max(axis=(1, 3)) if by == "max" else blocks.min(axis=(1, 3))
    np.testing.assert_array_equal(gray(sketch, layer, raster.Raster(window, shrink)), expected)


@pytest.mark.parametrize("shrink", [2, 3, 7, 64])
def test_a_contradiction_survives_and_none_is_made_up(shrink: int) -> None:
    window = Window(0, 2 * shrink, 0, 2 * shrink)
    beside = Sketch({(0, 0): CERTAIN}, {(1, 1): FULL})
    within = Sketch({(1, 0): CERTAIN}, {(0, 0): FULL, (1, 1): FULL, (1, 0): FULL})
    chosen = raster.Raster(window, shrink)
    yellow = coloured(within, "map", raster.Raster(window))[2 * shrink - 2, 0]
    assert tuple(coloured(within, "map", chosen)[1, 0]) == tuple(yellow)
    assert tuple(coloured(beside, "map", chosen)[1, 0]) != tuple(yellow)


@pytest.mark.thorough
@given(st.integers(2, 40), st.integers(0, 10))
def test_what_is_unknown_hides_nothing_that_is_known_beside_it(shrink: int, seed: int) -> None:
    sketch = scattered(seed, 90, 70)
    window = Window(-40 // shrink * shrink, -(-50 // shrink) * shrink,
                    -30 // shrink * shrink, -(-40 // shrink) * shrink)  # fmt: skip
    unknown = coloured(Sketch(), "map", raster.Raster(Window(0, 1, 0, 1)))[0, 0]
    every = (coloured(sketch, "map", raster.Raster(window)) != unknown).any(axis=2)
    blocks = every.reshape(every.shape[0] // shrink, shrink, -1, shrink).any(axis=(1, 3))
    for layer in ("map", "necessity", "possibility", "probability"):
        shown = (coloured(sketch, layer, raster.Raster(window, shrink)) != unknown).any(axis=2)
        np.testing.assert_array_equal(shown, blocks, err_msg=layer)
