"""The picture of what changed: a colour means one change, and no change is lost."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, UNIT
from possmap.core.lattice import Window
from possmap.core.patches import Crop, cropped
from possmap.core.pyramid import FULL
from possmap.inspection import difference_picture as difference
from possmap.inspection.changes import Change, changes
from possmap.inspection.difference_picture import Canvas
from possmap.pictures import palettes
from possmap.pictures.raster import Raster

NONE, UNKNOWN, MOST, LEAST = 127, 255, 254, 0
FAIR = UNIT
"""The weight of N = 1 - 1/e, which is 80/127."""


def blank(window: Window) -> dict[Layer, NDArray[np.int64]]:
    return {layer: np.zeros(window.shape, dtype=np.int64) for layer in Layer}


def canvas(
    a: dict[Layer, NDArray[np.int64]],
    b: dict[Layer, NDArray[np.int64]],
    window: Window,
    shrink: int = 1,
) -> Canvas:
    made = Canvas(Raster(window, shrink))
    patches = [{layer: Crop(window, cells) for layer, cells in one.items()} for one in (a, b)]
    rows = window.shape[0]
    for row in range(0, rows, 3):  # in pieces that blocks do not respect
        part = Window(
            window.row0 + row, window.row0 + min(row + 3, rows), window.column0, window.column1
        )
        one, other = (cropped(patch, part) for patch in patches)
        made.add(changes(part, one, other, ("minimum", "minimum")))
    return made


def test_every_cell_shows_its_change_the_highest_y_first() -> None:
    window = Window(-2, 2, 5, 7)
    a, b = blank(window), blank(window)
    b[Layer.WALLS][0, 0] = CERTAIN
    a[Layer.WALLS][1, 0] = CERTAIN
    a[Layer.WALLS][2, 0] = b[Layer.WALLS][2, 0] = FAIR
    b[Layer.WALLS][3, 0] = FAIR
    b[Layer.FREE][0, 1] = FULL
    a[Layer.FREE][1, 1] = FULL
    a[Layer.FREE][2, 1], b[Layer.FREE][2, 1] = FULL // 4, FULL // 2
    b[Layer.POINTS][3, 1] = CERTAIN
    drawn = canvas(a, b, window)
    assert drawn.indices(0)[::-1].tolist() == [[MOST, NONE], [LEAST, NONE], [NONE, NONE],
                                               [NONE + 80, NONE]]  # fmt: skip
    assert drawn.indices(1)[::-1].tolist() == [[NONE, LEAST], [NONE, MOST], [NONE, NONE - 32],
                                               [NONE, NONE]]  # fmt: skip


def test_what_neither_knows_is_unknown() -> None:
    window = Window(0, 1, 0, 4)
    a, b = blank(window), blank(window)
    a[Layer.FREE][0, 1], b[Layer.WALLS][0, 2], b[Layer.POINTS][0, 3] = 1, 1, 1
    assert canvas(a, b, window).indices(0).tolist() == [[UNKNOWN, NONE, NONE, NONE]]


@pytest.mark.parametrize("shrink", [2, 5])
def test_a_block_shows_the_largest_change_of_its_cells_either_way(shrink: int) -> None:
    rng = np.random.default_rng(shrink)
    window = Window(-20, 20, 10, 40)
    a, b = blank(window), blank(window)
    for layers in (a, b):
        layers[Layer.WALLS][...] = rng.integers(0, 3 * UNIT, window.shape) * (
            rng.random(window.shape) < 0.1
        )
        layers[Layer.FREE][...] = rng.integers(0, FULL, window.shape) * (
            rng.random(window.shape) < 0.1
        )
    single = [canvas(a, b, window).indices(number)[::-1].astype(int) for number in (0, 1)]
    drawn = canvas(a, b, window, shrink)
    for number in (0, 1):
        for (row, column), index in np.ndenumerate(drawn.indices(number)[::-1]):
            block = single[number][
                row * shrink : (row + 1) * shrink, column * shrink : (column + 1) * shrink
            ]
            known = block[block != UNKNOWN] - NONE
            if not known.size:
                assert index == UNKNOWN
            else:
                assert abs(int(index) - NONE) == np.abs(known).max()
                assert int(index) - NONE in known


def light(colour: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
    return float(colour @ np.array([0.299, 0.587, 0.114]))


def test_colours_are_the_darker_the_larger_the_change_and_the_sides_differ() -> None:
    table = difference.table()
    assert table.shape == (256, 3)
    assert tuple(table[NONE]) == palettes.PAPER and tuple(table[UNKNOWN]) == palettes.UNKNOWN
    lights = np.array([light(colour) for colour in table[:UNKNOWN]])
    assert (np.diff(lights[: NONE + 1]) > 0).all() and (np.diff(lights[NONE:]) < 0).all()
    red, blue = table[:UNKNOWN, 0].astype(int), table[:UNKNOWN, 2].astype(int)
    # Blue against yellow: what nearly all who confuse red and green tell apart.
    assert (blue - red)[: NONE - 8].min() > 2 and (red - blue)[NONE + 9 :].min() > 2
    assert len({tuple(colour) for colour in table.tolist()}) == 256


def test_marks_stand_beside_their_places_and_never_over_each_other() -> None:
    window = Window(0, 100, 0, 100)
    empty = canvas(blank(window), blank(window), window)
    empty.raster = chosen = Raster(window, 1, 4)

    def change(x: float, y: float, quantity: str) -> Change:
        return Change(x, y, quantity, 0.0, 1.0)

    def sheet(*marks: Change) -> Image.Image:
        return empty.drawn(("a", "b"), 0.1, marks)

    first = change(5.0, 5.0, "belief")
    assert sheet().tobytes() != sheet(first).tobytes()
    beside = sheet(first, change(5.1, 5.1, "belief"))
    assert beside.tobytes() == sheet(first).tobytes(), "it would lie over the first"
    assert sheet(first, change(5.1, 5.1, "plausibility")).tobytes() != beside.tobytes()
    assert sheet(change(5.0, 5.0, "point")).tobytes() == sheet().tobytes(), "no mark, no entry"
    for x in (0.05, 9.95):
        for y in (0.05, 9.95):
            assert sheet(change(x, y, "plausibility")).size == sheet(first).size
    assert chosen.size == (400, 400)
