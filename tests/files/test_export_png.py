"""The PNG of a layer holds numbers to read back, and its world file says where they lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maps import cells_of, drawn_grid, write_grid
from PIL import Image

from possmap.exports import job as export_job
from possmap.exports.export import export
from possmap.exports.job import LAYERS, Choices
from possmap.grid.grid import Grid

DRAWN = ["3#..?", "?!7.?", "????9"]


def pixels(path: Path) -> np.ndarray:
    """Return an image's numbers, the lowest row first, as possmap's arrays have it."""
    with Image.open(path) as image:
        assert image.mode == "I;16"
        return np.asarray(image)[::-1].astype(float)


@pytest.mark.parametrize("layer", LAYERS)
def test_every_cell_of_every_layer_reads_back(layer: str, tmp_path: Path) -> None:
    path = drawn_grid(tmp_path / "site.possmap", DRAWN, -2, -3)
    out = tmp_path / "site.png"
    window = (-3.0, -2.0, 2.0, 1.0)  # cells without evidence on all sides
    export(path, out, window, choices=Choices(layer=layer, base_rate=0.2))
    with Grid(path) as grid:
        expected = grid.view(layer, grid.lattice.window_of(*window), 0.2)
    assert (np.abs(pixels(out) - 65535 * expected) <= 0.5 + 1e-9).all()


def test_a_world_file_places_the_centre_of_the_upper_left_pixel(tmp_path: Path) -> None:
    path = drawn_grid(tmp_path / "site.possmap", DRAWN, -2, -3)
    export(path, tmp_path / "site.png")
    a, d, b, e, c, f = map(float, (tmp_path / "site.pgw").read_text().split())
    values = pixels(tmp_path / "site.png")[::-1]
    with Grid(path) as grid:
        for (row, column), value in np.ndenumerate(values):
            x, y = a * column + b * row + c, d * column + e * row + f
            cell = grid.lattice.cell_of(x, y)
            assert grid.lattice.centre_of(*cell) == pytest.approx((x, y), abs=1e-9)
            window = grid.lattice.window_of(x - 0.1, y - 0.1, x + 0.1, y + 0.1)
            assert round(65535 * float(grid.view("belief", window)[0, 0])) == value


def test_its_text_says_what_it_is(tmp_path: Path) -> None:
    path = drawn_grid(tmp_path / "site.possmap", DRAWN, -2, -3)
    export(path, tmp_path / "site.png", choices=Choices(layer="possibility"))
    with Grid(path) as grid, Image.open(tmp_path / "site.png") as image:
        assert image.info["possmap:digest"] == grid.digest()
        assert image.info["possmap:view"] == "possibility"
        assert image.info["possmap:resolution"] == "0.5"
        assert image.info["possmap:origin"] == "-1.5,-1.0"
        assert image.info["possmap:frame"].startswith("site: ")
        assert image.info["Software"].startswith("possmap ")


def test_bands_and_pieces_of_rows_show_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = {**cells_of(DRAWN, -2, -3), **cells_of(DRAWN, 300, 520)}
    path = write_grid(tmp_path / "site.possmap", cells)
    export(path, tmp_path / "1.png")
    whole = pixels(tmp_path / "1.png")
    assert whole.shape == (305, 528)
    for most in (2000, 100):
        monkeypatch.setattr(export_job.bands, "__defaults__", (False, most))
        export(path, tmp_path / "2.png", overwrite=True)
        assert (pixels(tmp_path / "2.png") == whole).all()
