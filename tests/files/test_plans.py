"""Floor plans as images: what is drawn is what stands, and bombs do not go off."""

from __future__ import annotations

import contextlib
import struct
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from possmap.errors import SettingsError
from possmap.truth.plans import Plan, read_image, read_ros_map

REAL = Path(__file__).resolve().parents[3] / "shared" / "realdata" / "worlds"

DRAWN = """
#######
#..#..#
#.....#
#######
"""
OUTLINE = {  # of DRAWN, at 1 m per pixel, from the lower left corner
    (1, 1, 6, 1),
    (1, 3, 3, 3),
    (4, 3, 6, 3),
    (3, 2, 4, 2),
    (1, 1, 1, 3),
    (6, 1, 6, 3),
    (3, 2, 3, 3),
    (4, 2, 4, 3),
}


def pixels(drawn: str) -> np.ndarray:
    """Return a grey image: white where a dot is."""
    rows = drawn.strip().splitlines()
    return np.array([[255 if mark == "." else 0 for mark in row] for row in rows], dtype=np.uint8)


def outline(plan: Plan) -> set[tuple[float, ...]]:
    return {tuple(wall) for wall in plan.walls().tolist()}


def saved(folder: Path, image: Image.Image | np.ndarray, name: str = "plan.png") -> Path:
    path = folder / name
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path)
    return path


def ros_map(folder: Path, drawn: np.ndarray, changes: Mapping[str, str | None]) -> Path:
    """Write a map.yaml with its image; a change of None leaves a key out."""
    saved(folder, drawn)
    keys: dict[str, str | None] = {
        "image": "plan.png",
        "resolution": "1.0",
        "origin": "[0.0, 0.0, 0.0]",
        "negate": "0",
        "occupied_thresh": "0.65",
        "free_thresh": "0.25",
        **changes,
    }
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in keys.items() if value))
    return path


def refusal(path: Path) -> str:
    """Return why a plan is refused, after the file's folder."""
    with pytest.raises(SettingsError) as caught:
        read_ros_map(path) if path.suffix == ".yaml" else read_image(path, 0.05)
    message = str(caught.value)
    assert message.isprintable(), "one line, no terminal codes"
    assert message.startswith(f"{path.parent}/")
    return message.removeprefix(f"{path.parent}/")


def test_walls_are_the_outlines_of_what_is_not_white_with_the_first_row_on_top(
    tmp_path: Path,
) -> None:
    plan = read_image(saved(tmp_path, pixels(DRAWN)), 1.0)
    assert outline(plan) == OUTLINE
    assert plan.is_free(1.5, 1.5) and plan.is_free(2.5, 2.5)
    assert not plan.is_free(3.5, 2.5) and not plan.is_free(-1, 1) and not plan.is_free(1.5, 9)
    there = read_image(saved(tmp_path, pixels(DRAWN)), 0.05, (-3.0, 2.0))
    assert (-2.95, 2.05, -2.7, 2.05) in outline(there)


@given(arrays(np.bool_, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_walls_enclose_just_the_free_cells(free: np.ndarray) -> None:
    walls = Plan(free, 1.0, (0.0, 0.0)).walls()
    for row in range(free.shape[0]):
        for column in range(free.shape[1]):
            # Going east from a cell's centre one leaves free floor at every wall, or enters it.
            x, y = column + 0.5, row + 0.5
            upright = walls[(walls[:, 0] == walls[:, 2]) & (walls[:, 1] < y) & (walls[:, 3] > y)]
            assert bool((upright[:, 0] > x).sum() % 2) == free[row, column]
            level = walls[(walls[:, 1] == walls[:, 3]) & (walls[:, 0] < x) & (walls[:, 2] > x)]
            assert bool((level[:, 1] > y).sum() % 2) == free[row, column]


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "LA", "I;16"])
def test_any_kind_of_image_says_the_same(tmp_path: Path, mode: str) -> None:
    grey = Image.fromarray(pixels(DRAWN))
    if mode == "I;16":
        image = Image.fromarray(pixels(DRAWN).astype(np.uint16) * 257)
    else:
        image = grey.convert(mode)
    assert image.mode == mode
    assert outline(read_image(saved(tmp_path, image), 1.0)) == OUTLINE


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("ascii.pgm", b"P2\n# drawn\n3 1\n9\n9 0 9\n"),
        ("raw.pgm", b"P5 3 1 255\n\xff\x00\xff"),
        ("deep.pgm", b"P5 3 1 65535\n\xff\xff\x00\x00\xff\xff"),
        ("bits.pbm", b"P1 3 1 0 1 0\n"),
    ],
)
def test_portable_graymaps_are_read(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    assert read_image(tmp_path / name, 1.0).free.tolist() == [[True, False, True]]


def test_of_a_bare_image_only_white_is_free_and_paper_shows_through(tmp_path: Path) -> None:
    greys = np.array([[255, 254, 206, 205, 128, 0]], dtype=np.uint8)
    plan = read_image(saved(tmp_path, greys), 1.0)
    assert plan.free.tolist() == [[True, True, True, False, False, False]]  # 205: ROS's unknown
    clear = np.array([[[0, 0, 0, 0], [0, 0, 0, 255], [0, 0, 0, 200]]], dtype=np.uint8)
    assert read_image(saved(tmp_path, clear), 1.0).free.tolist() == [[True, False, False]]


GREYS = np.array([[0, 80, 130, 200, 205, 254, 255]], dtype=np.uint8)


@pytest.mark.parametrize(
    ("changes", "free"),
    [
        ({}, "...FFFF"),
        ({"free_thresh": "0.196"}, ".....FF"),
        ({"free_thresh": "0.5"}, "..FFFFF"),
        ({"negate": "1"}, "F......"),
        ({"negate": "true", "free_thresh": "0.4"}, "FF....."),
        ({"free_thresh": "0"}, "......F"),
    ],
)
def test_thresholds_are_those_of_map_server(
    tmp_path: Path, changes: dict[str, str], free: str
) -> None:
    plan = read_ros_map(ros_map(tmp_path, GREYS, changes))
    assert plan.free.tolist() == [[mark == "F" for mark in free]]


@pytest.mark.parametrize("mode", ["trinary", "Scale"])
def test_of_a_map_only_what_is_opaque_is_known(tmp_path: Path, mode: str) -> None:
    image = np.array(
        [[[255, 255, 255, 255], [255, 255, 255, 0], [255, 255, 255, 254]]], dtype=np.uint8
    )
    plan = read_ros_map(ros_map(tmp_path, image, {"mode": mode}))
    assert plan.free.tolist() == [[True, False, False]]
    image[..., 3] = 128
    found = refusal(ros_map(tmp_path, image, {"mode": mode}))
    assert "nothing in the image is free, expected some floor, light and opaque" in found


def test_a_map_has_its_own_place_and_its_image_beside_it(tmp_path: Path) -> None:
    changes = {
        "resolution": "0.050000",
        "origin": "[-12.20, 1e-1, 1e-17]",
        "robots_own_key": "kept",
    }
    plan = read_ros_map(ros_map(tmp_path, pixels(DRAWN), changes))
    assert plan.resolution == 0.05 and plan.origin == (-12.2, 0.1)
    assert (-12.15, 0.15, -11.9, 0.15) in outline(plan)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"resolution": None}, "map.yaml:1: resolution is missing"),
        ({"resolution": "-0.05"}, 'map.yaml:2: resolution, found "-0.05", expected a number >= '),
        ({"origin": "[0, 0]"}, "map.yaml:3: origin, found [0, 0], expected [x, y, yaw]"),
        ({"origin": "[0, 0, 0.3]"}, "map.yaml:3: origin, found [0, 0, 0.3], expected a yaw of 0"),
        ({"negate": "2"}, 'map.yaml:4: negate, found "2", expected 0, 1'),
        ({"free_thresh": "0.7"}, "map.yaml:6: free_thresh, found 0.7, expected less than occ"),
        ({"mode": "raw"}, "map.yaml:7: mode, found raw, expected trinary or scale"),
        ({"image": "gone.pgm"}, "gone.pgm: cannot be read: No such file or directory"),
        ({"image": '"\\0"'}, "map.yaml:1: image, found "),
    ],
)
def test_a_map_that_is_none_is_refused(
    tmp_path: Path, changes: dict[str, str | None], problem: str
) -> None:
    assert refusal(ros_map(tmp_path, pixels(DRAWN), changes)).startswith(problem)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, *more: bytes) -> bytes:
    """Return a PNG that claims a size."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(more)


@pytest.mark.parametrize("side", [5001, 12_000, 60_000, 2**31 - 1])
def test_an_image_of_too_many_pixels_is_not_unpacked(tmp_path: Path, side: int) -> None:
    path = tmp_path / "bomb.png"
    path.write_bytes(png(side, side, chunk(b"IDAT", zlib.compress(b"")), chunk(b"IEND", b"")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "at most 25 million" in refusal(path)


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"", "not an image, expected PNG, PGM or BMP"),
        (b"walls: []", "not an image, expected PNG, PGM or BMP"),
        (b"GIF89a\x01\x00\x01\x00\x00\x00\x00;", "not an image, expected PNG, PGM or BMP"),
        (b"P5 30 10 255\nshort", ""),
        (b"P5 0 0 255\n", ""),
        (b"P5 -3 4 255\n", ""),
        (png(8, 8), ""),
        (png(8, 8, chunk(b"IDAT", b"junk"), chunk(b"IEND", b"")), ""),
        (png(8, 8, chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(5_000_000)))), ""),
    ],
)
def test_a_damaged_image_is_refused_in_one_line(tmp_path: Path, data: bytes, problem: str) -> None:
    path = tmp_path / "plan.png"
    path.write_bytes(data)
    assert problem in refusal(path)


@budget(max_examples=60, deadline=None)
@given(st.integers(0, 200), st.integers(0, 255))
def test_one_wrong_byte_never_ends_in_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, at: int, byte: int
) -> None:
    path = saved(tmp_path_factory.mktemp("wrong"), pixels(DRAWN))
    data = bytearray(path.read_bytes())
    data[at % len(data)] = byte
    path.write_bytes(bytes(data))
    with contextlib.suppress(SettingsError):
        read_image(path, 0.05)


@pytest.mark.skipif(not REAL.exists(), reason="../shared is absent")
@pytest.mark.parametrize(
    ("name", "inside"), [("office_a", (10, 5)), ("Freiburg79_scan", (20, 14)), ("NLB", (25, 3.5))]
)
def test_plans_drawn_by_others_are_read(name: str, inside: tuple[float, float]) -> None:
    plan = read_image(REAL / f"{name}.png", 0.05)
    assert 500 < len(plan.walls()) < 5000
    assert plan.is_free(*inside)
