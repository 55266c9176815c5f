"""The files: metadata, palette mode, the same bytes for the same grid, and a notebook's picture."""

from __future__ import annotations

import io
import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import possmap
from possmap.pictures.render import Look, render

DATA = Path(__file__).parents[2] / "data" / "json"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("png") / "site.possmap"
    possmap.fuse(DATA, path)
    return path


def texts(path: Path) -> dict[str, str]:
    with Image.open(path) as image:
        return dict(image.text)  # type: ignore[attr-defined]


def test_a_picture_says_what_it_shows(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    look = Look(layers=("necessity",), bare=True, scale=3, window_m=(-7.0, -4.0, -3.0, 0.5))
    render(site, out, look)
    with possmap.open_grid(site) as grid:
        expected = {
            "Software": f"possmap {possmap.version()}",
            "possmap:digest": grid.digest(),
            "possmap:view": "necessity",
            "possmap:palette": "viridis",
            "possmap:resolution": "0.05",
            "possmap:origin": "-7.0,-4.0",
            "possmap:cells": "80x90",
            "possmap:pixels_per_cell": "3.0",
        }
    assert texts(out) == expected
    with Image.open(out) as image:
        assert image.size == (240, 270)


def test_metadata_lead_from_a_pixel_back_to_its_place(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    render(site, out, Look(layers=("necessity",), palette="gray", bare=True, max_size=100))
    found = texts(out)
    resolution, per_cell = (
        float(found["possmap:resolution"]),
        float(found["possmap:pixels_per_cell"]),
    )
    x0, y0 = map(float, found["possmap:origin"].split(","))
    columns, rows = map(int, found["possmap:cells"].split("x"))
    with Image.open(out) as image, possmap.open_grid(site) as grid:
        assert image.size == (round(columns * per_cell), round(rows * per_cell))
        pixels = np.asarray(image)
        row, column = np.argwhere(pixels == pixels.max())[0]
        cell = resolution / per_cell
        x, y = x0 + column * cell, y0 + (image.height - 1 - row) * cell
        tiny = resolution / 10
        block = grid.lattice.window_of(x + tiny, y + tiny, x + cell - tiny, y + cell - tiny)
        assert np.rint(255 * grid.necessity(block).max()) == pixels.max()


@pytest.mark.parametrize("look", [
    Look(), Look(bare=True), Look(layers=("map", "coverage"), tracks=True),
    Look(layers=("necessity",), palette="gray", bare=True),
])  # fmt: skip
def test_the_same_grid_gives_the_same_bytes(site: Path, tmp_path: Path, look: Look) -> None:
    copy = tmp_path / site.name
    copy.write_bytes(site.read_bytes())
    render(site, tmp_path / "1.png", look)
    render(copy, tmp_path / "2.png", look)
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "2.png").read_bytes()


@pytest.mark.parametrize("layer", ["map", "necessity", "points", "coverage"])
def test_bare_pictures_are_in_palette_mode_and_values_in_gray(
    site: Path, tmp_path: Path, layer: str
) -> None:
    for palette, mode in (
        ("viridis", "P"),
        ("magma", "P"),
        ("gray", "P" if layer == "map" else "L"),
    ):
        out = tmp_path / f"{palette}.png"
        render(site, out, Look(layers=(layer,), palette=palette, bare=True))
        with Image.open(out) as image:
            assert image.mode == mode
            assert image.format == "PNG" and "transparency" not in image.info


def test_the_default_picture_is_under_200_kb(site: Path, tmp_path: Path) -> None:
    render(site, tmp_path / "a.png", Look())
    assert (tmp_path / "a.png").stat().st_size < 200_000


def test_a_notebook_shows_a_grid_as_its_default_picture(site: Path, tmp_path: Path) -> None:
    render(site, tmp_path / "a.png", Look())
    with closing(possmap.open_grid(site)) as grid:
        data = grid._repr_png_()
    assert data is not None and data.startswith(b"\x89PNG\r\n\x1a\n")
    with Image.open(io.BytesIO(data)) as shown, Image.open(tmp_path / "a.png") as file:
        np.testing.assert_array_equal(np.asarray(shown), np.asarray(file))


def test_a_notebook_shows_nothing_of_an_empty_grid(tmp_path: Path) -> None:
    log = {"possmap_log": 1, "robot": "r1", "excursion": "a", "records": []}
    (tmp_path / "a.json").write_text(json.dumps(log))
    possmap.fuse(tmp_path / "a.json", tmp_path / "empty.possmap")
    with closing(possmap.open_grid(tmp_path / "empty.possmap")) as grid:
        assert grid._repr_png_() is None
