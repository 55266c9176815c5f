"""The map: its tones, and two small pictures that it must not change unnoticed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import possmap
from possmap.core.evidence import Layer
from possmap.core.fusion import UNIT, LayerArray
from possmap.core.lattice import Window, joined, tiles_of
from possmap.core.pyramid import FULL
from possmap.core.settings import FreeFusion
from possmap.pictures import compose, composite
from possmap.pictures.compose import Scene
from possmap.pictures.raster import Raster
from possmap.pictures.render import Look, picture

DATA = Path(__file__).parents[2] / "data" / "json"
GOLDEN = Path(__file__).with_name("golden")
LOOKS = {
    "map.png": Look(bare=True),
    "map-gray-shrunk.png": Look(bare=True, palette="gray", max_size=150),
}
"""Drawn anew, after a change that is meant, by ``python tests/pictures/test_composite.py``."""
LEVELS = np.linspace(0, 1, 64)


class Ramps:
    """Cells whose N grows with x and whose denial with y; singular points where asked."""

    free_fusion: FreeFusion = "minimum"

    def __init__(self, points: float = 0.0) -> None:
        shares = np.minimum(LEVELS, 1 - np.exp(-16))
        self.weights = np.tile(np.rint(-np.log1p(-shares) * UNIT).astype(np.int64), (64, 1))
        self.denials = np.tile(np.rint(LEVELS * FULL).astype(np.int64)[:, None], (1, 64))
        self.points = np.full((64, 64), round(-np.log1p(-points) * UNIT), dtype=np.int64)

    def areas(self, window: Window) -> Iterator[Window]:
        """Yield the window in tiles, whether they hold anything or not."""
        yield from joined(tiles_of(window), window)

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window within 64 × 64 cells."""
        whole = {Layer.WALLS: self.weights, Layer.FREE: self.denials, Layer.POINTS: self.points}
        return whole[layer][window.row0 : window.row1, window.column0 : window.column1]


def tones(palette: str, points: float = 0.0) -> NDArray[np.int64]:
    """Return the colours of the ramps, [denial, N]."""
    image = compose.bare(Scene(Ramps(points), 0.1), "map", Raster(Window(0, 64, 0, 64)), palette)
    return np.asarray(image.convert("RGB")).astype(np.int64)[::-1]


def light(colour: NDArray[np.int64]) -> NDArray[np.float64]:
    luminance: NDArray[np.float64] = colour @ np.array([0.2126, 0.7152, 0.0722])
    return luminance


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "site.possmap"
    possmap.fuse(DATA, path)
    return path


@pytest.mark.parametrize("name", LOOKS)
def test_the_map_of_the_shipped_data_is_the_golden_one(site: Path, name: str) -> None:
    with possmap.open_grid(site) as grid, Image.open(GOLDEN / name) as golden:
        drawn = picture(grid, LOOKS[name])
        assert drawn.size == golden.size
        np.testing.assert_array_equal(
            np.asarray(drawn.convert("RGB")), np.asarray(golden.convert("RGB"))
        )


def test_golden_pictures_are_small() -> None:
    files = list(GOLDEN.iterdir())
    assert sorted(file.name for file in files) == sorted(LOOKS)
    assert all(file.stat().st_size < 20_000 for file in files)


@pytest.mark.parametrize("palette", ["viridis", "magma", "gray"])
def test_a_path_is_the_darker_the_smaller_its_possibility(palette: str) -> None:
    falling = np.diff(light(tones(palette)[1:, 0]))
    assert (falling <= 0.5).all() and falling.sum() < -100


def test_a_wall_is_the_lighter_the_smaller_its_necessity() -> None:
    falling = np.diff(light(tones("viridis")[0, 1:]))
    assert (falling <= 0.5).all() and falling.sum() < -100


@pytest.mark.parametrize("palette", ["viridis", "magma", "gray"])
def test_contradiction_has_one_tone_that_nothing_else_has(palette: str) -> None:
    found = tones(palette)
    n, p = np.meshgrid(LEVELS, 1 - LEVELS)
    sure = np.abs(n - p) > 0.01
    yellow = found[63, 63]
    is_yellow = (found == yellow).all(axis=2)
    np.testing.assert_array_equal(is_yellow[sure], (n > p)[sure])
    others = composite.table(palette).astype(int)
    away = np.abs(others - yellow).sum(axis=1)
    assert (away == 0).sum() == 1 and np.sort(away)[1] > 60


@pytest.mark.parametrize("palette", ["viridis", "magma", "gray"])
def test_nothing_known_looks_unknown(palette: str) -> None:
    table = composite.table(palette).astype(int)
    used = np.unique(np.concatenate([
        composite.drawn(Ramps(points), Raster(Window(0, 64, 0, 64))).ravel()
        for points in (0.0, 0.02, 0.3, 0.9)
    ]))  # fmt: skip
    away = np.abs(table[used[used != composite.UNKNOWN]] - table[composite.UNKNOWN]).sum(axis=1)
    assert away.min() > 0


def test_a_weak_singular_point_hides_neither_wall_nor_path() -> None:
    with_points, without = tones("viridis", 0.05), tones("viridis")
    strong = np.maximum(LEVELS[:, None], LEVELS[None, :]) > 0.06
    np.testing.assert_array_equal(with_points[strong], without[strong])


def test_a_strong_singular_point_is_seen() -> None:
    table = composite.table("viridis").astype(int)
    with_points = tones("viridis", 0.999)
    assert np.abs(with_points[0, 0] - table[255]).sum() < 30


def test_a_faint_wall_of_one_cell_is_seen_beside_a_certain_path() -> None:
    found = tones("viridis")
    for denial in (0, 1, 32, 63):
        assert (found[denial, 1] != found[denial, 0]).any()


def test_letters_say_the_same_as_colours() -> None:
    letters = np.array(list(composite.letters()))
    index = composite.drawn(Ramps(), Raster(Window(0, 64, 0, 64)))[::-1]
    drawn = letters[index]
    assert drawn[0, 0] == " " and drawn[63, 63] == "!"
    assert set(drawn[0, 1:]) == {"#"} and set(drawn[1:, 0]) == {"."}
    assert drawn[3, 3] == "+" and drawn[60, 2] == "+"
    assert len(letters) == 256


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        grid_path = Path(folder) / "site.possmap"
        possmap.fuse(DATA, grid_path)
        with possmap.open_grid(grid_path) as opened:
            for file_name, look in LOOKS.items():
                picture(opened, look).save(GOLDEN / file_name, optimize=True)
