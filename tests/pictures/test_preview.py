"""``--show``: the map in the terminal, with half blocks in colour or in letters without."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from teams import fuse, write_logs

import possmap
from possmap.pictures import terminal
from possmap.pictures.layers import letters
from possmap.pictures.render import Look, picture
from possmap.pictures.terminal import preview

DATA = Path(__file__).parents[2] / "data" / "json"
SETTINGS = {"along": 0, "across": 0, "turn_spread": 0, "resolution": 0.5}
HALF = re.compile(r"(?:\x1b\[38;2;(\d+);(\d+);(\d+)m(?:\x1b\[48;2;(\d+);(\d+);(\d+)m)?)?▀")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a grid of 8 × 6 cells with a wall, a path, and a contradiction where they cross."""
    records = [
        {"kind": "pose", "x": 0.2, "y": 0.2, "heading": 0},
        {"kind": "pose", "x": 3.7, "y": 0.2, "heading": 0},
        {"kind": "wall", "x": 2.2, "y": -0.8, "x2": 2.2, "y2": 1.7},
        {"kind": "wall", "x": 0.2, "y": 1.7, "x2": 1.2, "y2": 1.7},
        {"kind": "pose", "x": 3.7, "y": 0.2, "heading": 0},
    ]
    numbered = [{"seq": seq, **record} for seq, record in enumerate(records)]
    log = {"possmap_log": 1, "robot": "r", "excursion": "a", "records": numbered}
    folder = tmp_path_factory.mktemp("tiny")
    fuse(write_logs(folder / "logs", [log]), folder / "tiny.possmap", SETTINGS)
    return folder / "tiny.possmap"


def test_without_colour_it_is_plain_text(tiny: Path) -> None:
    assert preview(tiny, Look(), 80, 24, "none").splitlines() == [
        "### #",
        "....#...",
        "    #",
    ]


def test_values_are_tenths_and_what_is_unknown_is_blank(tiny: Path) -> None:
    necessity = Look(layers=("necessity",))
    assert preview(tiny, necessity, 80, 24, "none").splitlines() == [
        "999 9",
        "00009000",
        "    9",
    ]


@pytest.mark.parametrize("row", range(4))
def test_no_row_of_blocks_is_left_out_without_colour(row: int) -> None:
    index = np.full((4, 3), 255, dtype=np.uint8)
    index[row, 1] = 254
    drawn = terminal.in_letters(index, letters("necessity"))
    assert drawn.count("9") == 1


@pytest.mark.parametrize("layer", ["map", "possibility", "coverage"])
def test_with_colour_the_half_blocks_are_the_bare_picture(tiny: Path, layer: str) -> None:
    look = Look(layers=(layer,), bare=True)
    with possmap.open_grid(tiny) as grid:
        pixels = np.asarray(picture(grid, look).convert("RGB"))
    lines = preview(tiny, Look(layers=(layer,)), 80, 24, "24 bits").splitlines()
    assert len(lines) == 3 and all(line.endswith("▀\x1b[0m") for line in lines)
    for number, line in enumerate(lines):
        last: tuple[int, ...] = ()
        for column, match in enumerate(HALF.finditer(line)):
            if match.group(1):
                last = tuple(int(part) for part in match.groups())
            pair = pixels[2 * number : 2 * number + 2, column].ravel()
            assert last == tuple(pair.tolist())
        assert column == pixels.shape[1] - 1


@pytest.mark.parametrize(("columns", "lines"), [(80, 24), (40, 10), (200, 60), (2, 8), (3, 100)])
def test_a_preview_fits_its_terminal(tmp_path: Path, columns: int, lines: int) -> None:
    possmap.fuse(DATA, tmp_path / "site")
    shown = preview(tmp_path / "site", Look(), columns, lines, "none").splitlines()
    assert len(shown) <= lines and max(map(len, shown)) <= columns
    assert len(shown) > lines / 2 or max(map(len, shown)) > columns / 2


def test_walls_stay_visible_in_a_small_terminal(tmp_path: Path) -> None:
    possmap.fuse(DATA, tmp_path / "site")
    shown = preview(tmp_path / "site", Look(), 60, 18, "none").splitlines()
    assert shown[1].count("#") + shown[1].count("!") + shown[1].count("+") > 25  # the north wall
    assert shown[-1].count("#") + shown[-2].count("#") > 25
