"""``--animate``: each frame is what the host knew then, in the order in which logs arrived."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from literal.teams import Log
from numpy.typing import NDArray
from PIL import Image
from teams import fuse, write_logs
from versions import SETTINGS, log_of, prefix, written

import possmap
from possmap.pictures.film import By, animate
from possmap.pictures.render import Look, picture

DATA = Path(__file__).parents[2] / "data" / "json"
LOGS = sorted(DATA.glob("*.json"))
LOG_ENDS = (2, 4, 5, 6)
"""Deliveries after each log: the first two carry an excursion of r3."""
Pixels = NDArray[np.uint8]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with grids of the first 1, 2, 3 and 4 logs, fused one call a log."""
    path = tmp_path_factory.mktemp("film")
    for count in range(1, len(LOGS) + 1):
        for log in LOGS[:count]:
            possmap.fuse(log, path / f"{count}.possmap")
    return path


def whole_window(grid: Path) -> tuple[float, float, float, float]:
    with possmap.open_grid(grid) as opened:
        window = opened.window
        assert window is not None
        x0, y0 = opened.lattice.corner_of(window.row0, window.column0)
        x1, y1 = opened.lattice.corner_of(window.row1, window.column1)
        return x0, y0, x1, y1


def frames(path: Path) -> list[Pixels]:
    with Image.open(path) as image:
        found = []
        for number in range(getattr(image, "n_frames", 1)):
            image.seek(number)
            found.append(np.asarray(image.convert("RGB")))
        return found


def still(grid: Path, look: Look) -> Pixels:
    with possmap.open_grid(grid) as opened:
        return np.asarray(picture(opened, look).convert("RGB"))


def bare(layer: str = "map", palette: str = "viridis", **more: object) -> Look:
    return Look(layers=(layer,), palette=palette, bare=True, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("suffix", "layer", "palette"),
    [
        (".png", "map", "viridis"),
        (".png", "necessity", "gray"),
        (".apng", "probability", "magma"),
        (".gif", "map", "gray"),
        (".gif", "possibility", "viridis"),
        (".webp", "map", "viridis"),
    ],
)
def test_each_frame_is_the_picture_of_the_grid_of_the_logs_so_far(
    suffix: str, layer: str, palette: str, folder: Path, tmp_path: Path
) -> None:
    out, full = tmp_path / f"film{suffix}", folder / "4.possmap"
    look = bare(layer, palette)
    summary = animate(full, out, look, "excursion")
    shown = frames(out)
    assert summary.frames == len(shown) == 6
    window = whole_window(full)
    for count, end in enumerate(LOG_ENDS, 1):
        expected = still(folder / f"{count}.possmap", bare(layer, palette, window_m=window))
        away = np.abs(shown[end - 1].astype(int) - expected.astype(int)).max()
        assert away <= (12 if suffix == ".gif" else 0), f"after log {count}"  # GIF: 256 colours


@pytest.mark.parametrize("suffix", [".png", ".gif", ".webp"])
def test_the_last_frame_is_the_final_picture_furniture_and_all(
    suffix: str, folder: Path, tmp_path: Path
) -> None:
    out, full = tmp_path / f"film{suffix}", folder / "4.possmap"
    animate(full, out, Look(), "excursion")
    last, final = frames(out)[-1].astype(int), still(full, Look(max_size=720)).astype(int)
    assert last.shape == final.shape
    map_only = (slice(70, 500), slice(60, 640))  # above it, the caption says what has just come
    differ = np.abs(last - final)[map_only].max(axis=2)
    if suffix == ".gif":  # 256 colours for map and letters: what is rare is the nearest of them
        assert (differ > 24).mean() < 0.005 and differ.mean() < 0.5
    else:
        assert differ.max() == 0


def test_another_order_of_arrival_is_another_film_with_the_same_end(
    folder: Path, tmp_path: Path
) -> None:
    grid = tmp_path / "back.possmap"
    for log in reversed(LOGS):
        possmap.fuse(log, grid)
    animate(grid, tmp_path / "back.png", bare(), "excursion")
    animate(folder / "4.possmap", tmp_path / "there.png", bare(), "excursion")
    back, there = frames(tmp_path / "back.png"), frames(tmp_path / "there.png")
    assert (back[0] != there[0]).any()
    np.testing.assert_array_equal(back[-1], there[-1])


def moved(log: Log, dy: float) -> Log:
    """Return a log from so much further up."""
    records = [{**r, **{k: r[k] + dy for k in ("y", "y2") if k in r}} for r in log["records"]]
    return {**log, "records": records}


def test_logs_fused_in_one_call_arrive_in_the_order_given(tmp_path: Path) -> None:
    relayed = moved(log_of("r9", 9), 9)
    logs = written(
        tmp_path / "logs",
        a={**moved(log_of("r1"), 1), "carried": [prefix(relayed, 3)]},
        b=moved(log_of("r2", 5), 2),
        c={**moved(log_of("r3", 3), 3), "carried": [relayed]},
    )
    fuse(logs, tmp_path / "all", SETTINGS)
    fuse(logs[:2], tmp_path / "two", SETTINGS)
    window = whole_window(tmp_path / "all")
    animate(tmp_path / "all", tmp_path / "film.png", bare(), "excursion")
    shown = frames(tmp_path / "film.png")
    assert len(shown) == 5
    np.testing.assert_array_equal(shown[2], still(tmp_path / "two", bare(window_m=window)))


@pytest.mark.parametrize(("by", "asked", "expected"), [
    ("excursion", None, 6), ("excursion", 3, 3), ("excursion", 1, 1), ("excursion", 50, 6),
    ("record", 1, 1), ("record", 7, 7), ("record", None, 100), ("record", 397, 397),
])  # fmt: skip
def test_there_are_as_many_frames_as_asked_for_or_as_there_is_news(
    by: By, asked: int | None, expected: int, folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "film.gif"
    window = (-0.5, -0.5, 0.0, 0.0)
    look = bare(window_m=window)
    assert animate(folder / "4.possmap", out, look, by, frames=asked).frames == expected


def test_a_film_by_records_grows_and_ends_with_the_final_picture(
    folder: Path, tmp_path: Path
) -> None:
    out, full = tmp_path / "film.webp", folder / "4.possmap"
    animate(full, out, bare("possibility", "gray"), "record", frames=12)
    shown = frames(out)
    assert len(shown) == 12
    for one, other in itertools.pairwise(shown):
        assert (other <= one).all()  # Π only ever falls
    np.testing.assert_array_equal(shown[-1], still(full, bare("possibility", "gray")))


@pytest.mark.parametrize("suffix", [".png", ".gif", ".webp"])
def test_every_frame_has_the_size_of_the_last_however_much_there_is_to_say(
    suffix: str, tmp_path: Path
) -> None:
    corner = {"seq": 6, "kind": "corner", "x": 5.0, "y": 0.3, "corner": "end"}
    seen = {**moved(log_of("r".ljust(64, "z")), 2), "excursion": "y" * 64}
    seen["records"] += [corner, {"seq": 7, "kind": "pose", "x": 3.0, "y": 2.0, "heading": 0}]
    logs = [log_of("r1"), log_of("r2"), log_of("r3"), seen]
    fuse(write_logs(tmp_path / "logs", logs), tmp_path / "g", SETTINGS)
    out, look = tmp_path / f"film{suffix}", Look(tracks=True)
    summary = animate(tmp_path / "g", out, look, "excursion")
    final = still(tmp_path / "g", Look(tracks=True, max_size=720))
    assert {frame.shape for frame in frames(out)} == {final.shape}
    assert (summary.height, summary.width) == final.shape[:2]


def test_frames_are_shown_as_long_as_asked_and_the_last_four_times_so(
    folder: Path, tmp_path: Path
) -> None:
    for suffix in (".png", ".gif", ".webp"):
        out = tmp_path / f"film{suffix}"
        animate(folder / "4.possmap", out, bare(), "excursion", frame_ms=250)
        with Image.open(out) as image:
            assert image.info["loop"] == 0
            durations = []
            for number in range(image.n_frames):  # type: ignore[attr-defined]
                image.seek(number)
                image.load()
                durations.append(round(image.info["duration"]))
        assert durations == [250] * 5 + [1000], suffix


def test_the_same_grid_gives_the_same_film(folder: Path, tmp_path: Path) -> None:
    for suffix in (".png", ".gif", ".webp"):
        films = [tmp_path / f"{number}{suffix}" for number in (1, 2)]
        for film in films:
            animate(folder / "3.possmap", film, bare(), "excursion")
        assert films[0].read_bytes() == films[1].read_bytes()


def test_an_animated_png_says_what_it_shows(folder: Path, tmp_path: Path) -> None:
    animate(folder / "4.possmap", tmp_path / "film.png", bare("necessity"), "excursion")
    with (
        Image.open(tmp_path / "film.png") as image,
        possmap.open_grid(folder / "4.possmap") as grid,
    ):
        assert image.info["possmap:digest"] == grid.digest()
        assert image.info["possmap:view"] == "necessity"
