"""The map: its tones, and two small pictures that it must not change unnoticed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from teams import ROBUST

import possmap
from possmap.core.evidence import Layer
from possmap.core.fusion import UNIT
from possmap.core.lattice import Window
from possmap.core.patches import Crop, Patch, cropped
from possmap.pictures import compose, layers, palettes
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
SIDE = 64
WEIGHTS = np.linspace(0, 8, SIDE)
WINDOW = Window(0, SIDE, 0, SIDE)
PALETTES = ("viridis", "magma", "gray")


class Ramps:
    """Cells whose weight for a wall grows with x and that against it with y; perhaps points."""

    def __init__(self, point: float = 0.0) -> None:
        weights = np.rint(WEIGHTS * UNIT).astype(np.int64)
        self.patch: Patch = {
            Layer.WALLS: Crop(WINDOW, np.tile(weights, (SIDE, 1))),
            Layer.FREE: Crop(WINDOW, np.tile(weights[:, None], (1, SIDE))),
            Layer.POINTS: Crop(
                WINDOW, np.full((SIDE, SIDE), round(-np.log1p(-point) * UNIT), dtype=np.int64)
            ),
        }

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield all that there is."""
        yield cropped(self.patch, window)


def tones(palette: str, point: float = 0.0) -> NDArray[np.int64]:
    """Return the colours of the ramps, [weight against, weight for]."""
    scene = Scene(Ramps(point), 0.1, "dempster")
    image = compose.bare(scene, "map", Raster(WINDOW), palette)
    return np.asarray(image.convert("RGB")).astype(np.int64)[::-1]


def drawn(point: float = 0.0) -> NDArray[np.uint8]:
    return layers.indices("map", Ramps(point), Raster(WINDOW), 0.5, "dempster")


def light(colour: NDArray[np.int64]) -> NDArray[np.float64]:
    luminance: NDArray[np.float64] = colour @ np.array([0.2126, 0.7152, 0.0722])
    return luminance


def apart(one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
    away: NDArray[np.int64] = np.abs(one - other).sum(axis=-1)
    return away


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "site.possmap"
    possmap.fuse(DATA, path, ROBUST)
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


@pytest.mark.parametrize("palette", PALETTES)
def test_free_space_is_the_darker_the_smaller_the_plausibility_of_a_wall(palette: str) -> None:
    falling = np.diff(light(tones(palette)[1:, 0]))
    assert (falling <= 0.5).all() and falling.sum() < -50


def test_a_wall_is_the_lighter_the_smaller_the_belief_in_it() -> None:
    falling = np.diff(light(tones("viridis")[0, 1:]))
    assert (falling <= 0.5).all() and falling.sum() < -100


@pytest.mark.parametrize("palette", PALETTES)
def test_what_is_contested_is_shown_as_strength_and_never_as_opaque_paint(palette: str) -> None:
    found = tones(palette)
    balanced = found[np.arange(SIDE), np.arange(SIDE)]
    tint = np.array(palettes.CONTESTED)
    away = apart(balanced, tint)
    assert (np.diff(away) <= 40).all() and away[-1] < away[0] / 2, "the more, the nearer"
    assert apart(palettes.map_table(palette).astype(int), tint).min() > 30, (
        "something shows through"
    )
    for settled in (found[0, -1], found[-1, 0]):
        assert apart(settled, balanced[-1]) > 150
    # A little evidence against much hardly tints it.
    assert apart(found[8, -1], found[0, -1]) < apart(balanced[-1], found[0, -1]) / 4


@pytest.mark.parametrize("palette", PALETTES)
def test_nothing_known_looks_unknown(palette: str) -> None:
    table = palettes.map_table(palette).astype(int)
    used = np.unique(np.concatenate([
        drawn(point).ravel()
        for point in (0.0, 0.02, 0.3, 0.9)
    ]))  # fmt: skip
    assert apart(table[used[used != 0]], table[0]).min() > 0


def test_unknown_wall_free_and_contested_stay_apart_for_the_colour_blind() -> None:
    found = tones("viridis")
    four = np.array([found[0, 0], found[0, -1], found[-1, 0], found[-1, -1]]) / 255
    linear = np.where(four <= 0.04045, four / 12.92, ((four + 0.055) / 1.055) ** 2.4)
    # Deuteranopia after Machado, Oliveira and Fernandes (2009), severity 1.
    seen = np.clip(linear @ np.array([
        [0.367322, 0.280085, -0.011820],
        [0.860646, 0.672501, 0.042940],
        [-0.227968, 0.047413, 0.968881],
    ]), 0, 1) ** (1 / 2.2)  # fmt: skip
    for number, one in enumerate(seen):
        for other in seen[number + 1 :]:
            assert np.abs(one - other).sum() > 0.4


def test_a_weak_singular_point_hides_neither_wall_nor_path() -> None:
    with_points, without = tones("viridis", 0.05), tones("viridis")
    certain = 1 - np.exp(-WEIGHTS)
    strong = np.maximum(certain[:, None], certain[None, :]) > 0.3
    np.testing.assert_array_equal(with_points[strong], without[strong])


def test_a_strong_singular_point_is_seen() -> None:
    assert apart(tones("viridis", 0.999)[0, 0], np.array(palettes.POINT)) < 30


def test_letters_say_the_same_as_colours() -> None:
    letters = np.array(list(layers.letters("map")))
    shown = letters[drawn()[::-1]]
    assert shown[0, 0] == " " and shown[63, 63] == "!"
    assert set(shown[0, 1:]) == {"#"} and set(shown[1:, 0]) == {"."}
    assert shown[10, 63] == "#" and shown[63, 10] == "."
    assert len(letters) == 256


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        grid_path = Path(folder) / "site.possmap"
        possmap.fuse(DATA, grid_path, ROBUST)
        with possmap.open_grid(grid_path) as opened:
            for file_name, look in LOOKS.items():
                picture(opened, look).save(GOLDEN / file_name, optimize=True)
