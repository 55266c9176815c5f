"""Furniture: labels never overlap each other or the map, and nothing is cut off."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from PIL import Image, ImageDraw
from teams import fuse, write_logs

import possmap
from possmap.core.lattice import Window
from possmap.inspection import difference_picture as difference
from possmap.inspection.changes import Change
from possmap.pictures import frame, legend, text
from possmap.pictures.render import Look, picture, raster_of

DATA = Path(__file__).parents[2] / "data"
EXACT = {"along": 0, "across": 0, "turn_spread": 0}
EVERY = ("map", "belief", "plausibility", "contested", "ignorance", "pignistic", "points",
         "coverage")  # fmt: skip


class Box(NamedTuple):
    """Something drawn: what, and its left, top, right and bottom, the last two not in it."""

    what: str
    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box) -> bool:
        """Return whether they share a pixel."""
        return (
            self.left < other.right and other.left < self.right
            and self.top < other.bottom and other.top < self.bottom
        )  # fmt: skip


class Drawn:
    """What was written, ruled and pasted while a picture was made."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.texts: list[tuple[object, Box]] = []
        self.lines: list[tuple[object, Box]] = []
        self.pasted: list[tuple[tuple[int, int], Box]] = []
        write, line, paste = text.write, ImageDraw.ImageDraw.line, Image.Image.paste

        def note(
            draw: ImageDraw.ImageDraw, at: tuple[float, float], words: str, size: int,
            colour: tuple[int, int, int], anchor: str = "la",
        ) -> None:  # fmt: skip
            box = draw.textbbox(at, text.showable(words), font=text.font(size), anchor=anchor)
            self.texts.append((draw.im, Box(words, *box)))
            write(draw, at, words, size, colour, anchor)

        def rule(draw: ImageDraw.ImageDraw, xy: Any, *args: Any, **more: Any) -> None:
            if len(xy) == 4 and not isinstance(xy[0], tuple):
                x, y, x2, y2 = xy
                box = Box("line", min(x, x2), min(y, y2), max(x, x2) + 1, max(y, y2) + 1)
                self.lines.append((draw.im, box))
            line(draw, xy, *args, **more)

        def stick(image: Image.Image, other: Any, box: Any = None, mask: Any = None) -> None:
            if mask is None and isinstance(other, Image.Image) and isinstance(box, tuple):
                x, y = box[:2]
                place = Box("map or bar", x, y, x + other.width, y + other.height)
                self.pasted.append((image.size, place))
            paste(image, other, box, mask)

        for module in (frame, legend):
            monkeypatch.setattr(module, "write", note)
        monkeypatch.setattr(ImageDraw.ImageDraw, "line", rule)
        monkeypatch.setattr(Image.Image, "paste", stick)

    def complaints(self, sheet: Image.Image) -> Iterator[str]:
        """Say what is wrong in a finished sheet."""
        texts = [box for im, box in self.texts if im is sheet.im and box.what]
        lines = [box for im, box in self.lines if im is sheet.im]
        pasted = [box for size, box in self.pasted if size == sheet.size]
        assert texts and lines and pasted
        for box in (*texts, *lines, *pasted):
            if box.left < 0 or box.top < 0 or box.right > sheet.width or box.bottom > sheet.height:
                yield f"{box} is cut off by {sheet.size}"
        for one, other in itertools.combinations(texts, 2):
            if one.meets(other):
                yield f"{one} overlaps {other}"
        for box in texts:
            yield from (
                f"{box} lies over {other}" for other in (*pasted, *lines) if box.meets(other)
            )
        for one, other in itertools.combinations(pasted, 2):
            if one.meets(other):
                yield f"{one} overlaps {other}"


def log(robot: str, *records: dict[str, Any]) -> dict[str, Any]:
    numbered = [{"seq": seq, **record} for seq, record in enumerate(records)]
    return {"possmap_log": 1, "robot": robot, "excursion": "a", "records": numbered}


def pose(x: float, y: float) -> dict[str, Any]:
    return {"kind": "pose", "x": x, "y": y, "heading": 0}


def wall(x: float, y: float, x2: float, y2: float) -> dict[str, Any]:
    return {"kind": "wall", "x": x, "y": y, "x2": x2, "y2": y2}


def star(robots: int) -> list[dict[str, Any]]:
    """Return robots that leave home in all directions."""
    logs = []
    for number in range(robots):
        x, y = (6 * f(math.tau * number / robots) for f in (math.cos, math.sin))
        corner = {"kind": "corner", "x": round(x, 2), "y": round(y, 2), "corner": "end"}
        name = f"r{number}".ljust(64 if number == 3 else 3, "-")
        logs.append(log(name, pose(0, 0), pose(round(x, 2), round(y, 2)), corner, pose(0, 0)))
    return logs


WORLDS: dict[str, list[dict[str, Any]]] = {
    "point": [log("r", pose(3, -7), wall(3, -7, 3, -7), pose(3, -7))],
    "far": [log("r", pose(9e5, -9e5), wall(9e5, -9e5, 9e5, -9e5), pose(9e5, -9e5))],
    "long": [log("r", pose(0, 1), wall(0, 0, 100, 0), wall(0, 2, 100, 2), pose(100, 1))],
    "high": [log("r", pose(1, 0), wall(0, 0, 0, 100), wall(2, 0, 2, 100), pose(1, 100))],
    "robots": star(12),
    "a name that goes on and on, longer than any map of a single point could ever be wide": [
        log("r", pose(0, 0), wall(1, 1, 2, 2), pose(1, 0))
    ],
}


@pytest.fixture(scope="module")
def grids(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("layout")
    for name, logs in WORLDS.items():
        fuse(write_logs(folder / name, logs), folder / f"{name}.possmap", EXACT)
    possmap.fuse(DATA / "json", folder / "site.possmap")
    return {name: folder / f"{name}.possmap" for name in (*WORLDS, "site")}


TRUTH = DATA / "truth.json"
CASES = [
    *((name, Look()) for name in (*WORLDS, "site")),
    *((name, Look(layers=("map", "coverage"))) for name in WORLDS),
    ("site", Look(layers=EVERY, tracks=True, truth=TRUTH)),
    ("long", Look(layers=EVERY)),
    ("high", Look(layers=EVERY[:4])),
    ("robots", Look(tracks=True)),
    ("robots", Look(tracks=True, layers=EVERY[:2], palette="gray")),
    *((name, Look(max_size=size)) for name in ("site", "long", "high") for size in (20, 100, 300)),
    ("site", Look(max_size=100, layers=EVERY)),
    ("site", Look(scale=1)),
    ("site", Look(window_m=(0, 0, 0.05, 0.05), scale=1)),
    ("site", Look(window_m=(0, 0, 0.05, 0.05))),
    ("site", Look(window_m=(0, -4, 0.1, 4))),
    ("site", Look(window_m=(0, 0, 0.5, 4), scale=1)),
    ("site", Look(window_m=(-7, 0, 7, 0.1))),
    ("site", Look(window_m=(-500, -500, 500, 500), max_size=400)),
    ("far", Look(window_m=(9e5 - 1, -9e5 - 1, 9e5 + 1, -9e5 + 1), scale=2)),
    ("point", Look(title="")),
    ("point", Look(title="one line\nand another\tone")),
]


@pytest.mark.parametrize(("name", "look"), CASES)
def test_no_label_overlaps_or_is_cut_off(
    name: str, look: Look, grids: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    with possmap.open_grid(grids[name]) as grid:
        drawn = Drawn(monkeypatch)
        sheet = picture(grid, look)
        assert list(drawn.complaints(sheet)) == []


@pytest.mark.parametrize("name", ["site", "a name that goes on " * 9])
@pytest.mark.parametrize("shape", [(1, 1), (3, 900), (900, 3), (60, 80), (40_000, 30_000)])
@pytest.mark.parametrize("marked", [False, True])
def test_no_label_of_a_difference_overlaps_or_is_cut_off(
    shape: tuple[int, int], name: str, marked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = difference.raster_for(Window(-9, shape[0] - 9, 7, shape[1] + 7), exact=False)
    canvas = difference.Canvas(chosen)
    drawn = Drawn(monkeypatch)
    largest = [Change(0.4, -0.4, "plausibility", 1.0, 0.0)] if marked else []
    sheet = canvas.drawn((name, name), 0.05, largest)
    assert list(drawn.complaints(sheet)) == []


@pytest.mark.parametrize("name", [*WORLDS, "site"])
def test_a_map_is_not_crowded_out(
    name: str, grids: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    with possmap.open_grid(grids[name]) as grid:
        drawn = Drawn(monkeypatch)
        sheet = picture(grid, Look())
    maps = [box for size, box in drawn.pasted if size == sheet.size]
    largest = max((box.right - box.left) * (box.bottom - box.top) for box in maps)
    assert largest > 0.2 * sheet.width * sheet.height


@pytest.mark.parametrize(("size", "least"), [(50, 25), (100, 50), (300, 140)])
def test_a_small_picture_gives_its_pixels_to_the_evidence(
    size: int, least: int, grids: dict[str, Path]
) -> None:
    with possmap.open_grid(grids["site"]) as grid:
        chosen = raster_of(grid, Look(max_size=size))
        assert grid.window is not None
        assert max(chosen.size) <= size
        assert max(grid.window.shape) * chosen.scale / chosen.shrink >= least


def test_a_scale_that_is_asked_for_is_kept(grids: dict[str, Path]) -> None:
    with possmap.open_grid(grids["site"]) as grid:
        for scale in (1, 2, 10):
            assert raster_of(grid, Look(scale=scale)).scale == scale


def test_a_title_without_end_does_not_make_a_picture_without_end(grids: dict[str, Path]) -> None:
    with possmap.open_grid(grids["point"]) as grid:
        assert picture(grid, Look(title="x" * 2000)).width < 1500
