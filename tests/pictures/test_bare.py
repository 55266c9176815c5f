"""``--bare``: a pixel is a cell, and its value can be read back (CLI.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import possmap
from possmap.core.lattice import Window
from possmap.exports.export import export
from possmap.pictures.render import Look, picture, render

DATA = Path(__file__).parents[2] / "data" / "json"
LAYERS = ("necessity", "possibility", "ignorance", "conflict", "probability", "points")
PALETTES = ("viridis", "magma", "gray")
WINDOWS = (None, (-7.5, -4.3, -3.31, 0.02), (-9.0, 5.0, 1.0, 9.0), (0.0, 0.0, 0.05, 0.05))
Pixels = NDArray[np.uint8]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bare") / "site.possmap"
    possmap.fuse(DATA, path)
    return path


def bare(path: Path, layer: str, palette: str = "gray", **more: object) -> Image.Image:
    look = Look(layers=(layer,), palette=palette, bare=True, **more)  # type: ignore[arg-type]
    with possmap.open_grid(path) as grid:
        return picture(grid, look)


def values(
    path: Path, layer: str, window_m: tuple[float, float, float, float] | None
) -> NDArray[np.float64]:
    """Return a layer's values from the Python API, the highest y first."""
    with possmap.open_grid(path) as grid:
        window = None if window_m is None else grid.lattice.window_of(*window_m)
        return grid.view(layer, window)[::-1]


def colours(image: Image.Image) -> Pixels:
    return np.asarray(image.convert("RGB"))


def known(path: Path) -> NDArray[np.bool_]:
    """Return where the grid knows anything, the highest y first."""
    with possmap.open_grid(path) as grid:
        return ((grid.necessity() > 0) | (grid.possibility() < 1) | (grid.points() > 0))[::-1]


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("layer", LAYERS)
def test_a_gray_pixel_is_255_times_the_value_rounded(
    site: Path, layer: str, window: tuple[float, float, float, float] | None
) -> None:
    image = bare(site, layer, window_m=window)
    assert image.mode == "L"
    np.testing.assert_array_equal(np.asarray(image), np.rint(255 * values(site, layer, window)))


@pytest.mark.parametrize("layer", LAYERS)
def test_with_a_scale_each_cell_is_a_square_of_its_value(site: Path, layer: str) -> None:
    window = (-7.5, -4.3, -3.31, 0.02)
    one, three = (np.asarray(bare(site, layer, window_m=window, scale=s)) for s in (1, 3))
    np.testing.assert_array_equal(three, np.kron(one, np.ones((3, 3), dtype=np.uint8)))


def test_the_first_row_of_pixels_is_the_highest_y_and_columns_run_with_x(tmp_path: Path) -> None:
    log = tmp_path / "a.csv"
    log.write_text(
        "robot,excursion,seq,kind,x,y,heading,x2,y2\n"
        "r,a,0,pose,-0.25,-0.25,0,,\nr,a,1,wall,0.05,0.35,,0.05,0.35\nr,a,2,pose,-0.25,-0.25,0,,\n"
        "r,a,3,wall,-0.25,-0.15,,-0.15,-0.15\nr,a,4,pose,-0.25,-0.25,0,,\n"
    )
    exact = {"along": 0, "across": 0, "turn_spread": 0, "resolution": 0.1}
    assert possmap.fuse(log, tmp_path / "g", exact).count("refused") == 0
    pixels = np.asarray(bare(tmp_path / "g", "necessity"))
    assert ["".join("?#"[int(value > 0)] for value in row) for row in pixels] == [
        "???#",
        "????",
        "????",
        "????",
        "????",
        "##??",
    ]


def test_export_and_render_cover_the_same_cells_and_agree(site: Path, tmp_path: Path) -> None:
    window = (-3.0, -2.0, 1.0, 9.0)
    export(site, tmp_path / "a.npz", window)
    with np.load(tmp_path / "a.npz") as arrays:
        for layer in ("necessity", "possibility"):
            out = tmp_path / f"{layer}.png"
            look = Look(layers=(layer,), palette="gray", bare=True, window_m=window)
            render(site, out, look)
            with Image.open(out) as image:
                found = np.asarray(image).astype(int)
            exported = 255 * arrays[layer][::-1].astype(float)
            assert found.shape == exported.shape
            assert np.abs(found - exported).max() <= 0.5 + 1e-4  # float32 may round the other way


def test_probability_follows_the_base_rate(site: Path) -> None:
    with possmap.open_grid(site) as grid:
        expected = np.rint(255 * grid.view("probability", base_rate=0.1)[::-1])
    pixels = np.asarray(bare(site, "probability", base_rate=0.1))
    np.testing.assert_array_equal(pixels, expected)


@pytest.mark.parametrize("palette", ["viridis", "magma"])
@pytest.mark.parametrize("layer", LAYERS)
def test_a_coloured_pixel_maps_back_to_its_value(site: Path, layer: str, palette: str) -> None:
    image = bare(site, layer, palette)
    assert image.mode == "P"
    found, of_pixel = np.unique(colours(image).reshape(-1, 3), axis=0, return_inverse=True)
    of_pixel = of_pixel.ravel()
    table = np.array(palette_rows(palette)).astype(int)
    distances = ((found[:, None, :].astype(int) - table[None]) ** 2).sum(axis=2)
    wanted = values(site, layer, None).ravel()
    is_known = known(site).ravel()
    shown = of_pixel[is_known]
    assert distances[shown].min(axis=1).max() == 0
    # 255 colours for values, of which viridis has two twice
    assert np.abs(distances.argmin(axis=1)[shown] / 255 - wanted[is_known]).max() < 2.1 / 255
    assert distances[of_pixel[~is_known]].min() > 200  # unknown is no value's colour


def palette_rows(palette: str) -> list[tuple[int, int, int]]:
    """Return a shipped palette as a reader of the file would."""
    text = (Path(possmap.__file__).parent / "pictures" / "palettes.txt").read_text()
    lines = [line.strip() for line in text.splitlines()]
    start = lines.index(palette) + 1
    words = " ".join(lines[start : start + 16]).split()
    assert len(words) == 256
    return [(int(word[:2], 16), int(word[2:4], 16), int(word[4:], 16)) for word in words]


@pytest.mark.parametrize("palette", PALETTES)
def test_what_is_unknown_has_one_tone_that_no_value_has(site: Path, palette: str) -> None:
    is_known = known(site)
    for layer in (*LAYERS, "coverage", "map"):
        if palette == "gray" and layer != "map":
            continue  # values to read back: ignorance has no tone of its own
        found = colours(bare(site, layer, palette))
        tones = np.unique(found[~is_known], axis=0)
        assert len(tones) == 1
        assert not (found[is_known] == tones[0]).all(axis=1).any(), layer


def test_a_part_of_the_map_is_the_same_part_of_the_whole(site: Path) -> None:
    with possmap.open_grid(site) as grid:
        whole = grid.window
        assert whole is not None
        part = Window(-3, 61, -77, 20)
        x0, y0 = grid.lattice.corner_of(part.row0, part.column0)
        x1, y1 = grid.lattice.corner_of(part.row1, part.column1)
    rows = slice(whole.row1 - part.row1, whole.row1 - part.row0)
    columns = slice(part.column0 - whole.column0, part.column1 - whole.column0)
    window = (x0, y0, x1, y1)
    for layer in (*LAYERS, "map"):
        every = colours(bare(site, layer, "viridis"))[rows, columns]
        np.testing.assert_array_equal(colours(bare(site, layer, "viridis", window_m=window)), every)
    counts = np.asarray(bare(site, "coverage"))[rows, columns]
    np.testing.assert_array_equal(np.asarray(bare(site, "coverage", window_m=window)), counts)
