"""``possmap render``: pictures, films and previews, and everything that can be wrong with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import files, fused, refused, run
from PIL import Image

import possmap.pictures.film
import possmap.pictures.render
from possmap.cli import render as cli_render

# A robot without errors, 0.5 m cells: it drives from cell (0, 0) to (row 0, column 2), sees a wall
# in row 2, columns -2 to 0, and a bump in (row -1, column 3).
LOG: Any = {
    "possmap_log": 1,
    "robot": "r1",
    "excursion": "a",
    "model": {"along": 0, "across": 0, "turn_spread": 0},
    "records": [
        {"seq": 0, "kind": "pose", "x": 0.2, "y": 0.2, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
        {"seq": 2, "kind": "wall", "x": -0.8, "y": 1.2, "x2": 0.2, "y2": 1.2},
        {"seq": 3, "kind": "wall", "x": 1.7, "y": -0.2, "x2": 1.7, "y2": -0.2},
        {"seq": 4, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
    ],
}
LAYERS = (
    "map, belief, plausibility, contested, ignorance, pignistic, probability, necessity, "
    "possibility, conflict, contradicted, points, coverage"
)
IS_NONE = f'unknown layer "", expected one of {LAYERS}'


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return fused(tmp_path / "site.possmap", LOG, options=("--resolution", "0.5"))


def test_a_picture_is_written_and_its_size_said(grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "site.png"
    result = run("render", grid, "-o", out)
    with Image.open(out) as image:
        width, height = image.size
    assert result.stdout == f"{out}: {width} x {height} pixels\n"
    assert (result.stderr, result.exit_code) == ("", 0)
    assert list(files(tmp_path)) == ["site-0.json", "site.png", "site.possmap"]


def test_bare_gray_pixels_are_values_and_the_first_row_is_the_highest_y(
    grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / "n.png"
    args = ("render", grid, "-o", out, "--bare", "--palette", "gray", "--layer")
    assert run(*args, "necessity").stdout == f"{out}: 6 x 4 pixels\n"
    with Image.open(out) as image:
        assert np.asarray(image).tolist() == [
            [255, 255, 255, 0, 0, 0], [0] * 6, [0] * 6, [0, 0, 0, 0, 0, 255],
        ]  # fmt: skip
    run(*args, "possibility", "--overwrite")
    with Image.open(out) as image:
        free = [255, 255, 0, 0, 0, 255]
        assert np.asarray(image).tolist() == [[255] * 6, [255] * 6, free, [255] * 6]
    run(*args, "coverage", "--overwrite", "--scale", 2, "--window", "1,-0.5,2,0.5")
    with Image.open(out) as image:
        assert np.asarray(image).tolist() == [[1, 1, 0, 0]] * 2 + [[0, 0, 1, 1]] * 2


def test_every_layer_and_palette_can_be_drawn(grid: Path, tmp_path: Path) -> None:
    for layer in LAYERS.split(", "):
        for palette in ("viridis", "magma", "gray"):
            out = tmp_path / f"{layer}-{palette}.png"
            result = run("-q", "render", grid, "-o", out, "--layer", layer, "--palette", palette)
            assert (result.output, result.exit_code) == ("", 0)
            with Image.open(out) as image:
                assert image.size > (100, 100)


def test_a_film_by_suffix_with_its_frames_said(grid: Path, tmp_path: Path) -> None:
    for suffix, kind in ((".png", "PNG"), (".gif", "GIF"), (".webp", "WEBP")):
        out = tmp_path / f"film{suffix}"
        result = run("render", grid, "-o", out, "--animate", "record", "--frames", 2)
        assert result.stdout.endswith(" pixels, 2 frames\n") and result.exit_code == 0
        with Image.open(out) as image:
            assert (image.format, image.n_frames) == (kind, 2)  # type: ignore[attr-defined]


def test_the_palettes_are_listed_without_a_grid() -> None:
    result = run("render", "--palette", "list")
    assert (result.stderr, result.exit_code) == ("", 0)
    assert [line.split()[0] for line in result.stdout.splitlines()] == ["viridis", "magma", "gray"]


def test_an_existing_picture_is_replaced_only_with_overwrite(grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "site.png"
    out.write_text("precious")
    for more in ((), ("--animate", "excursion")):
        complaint = refused(run("render", grid, "-o", out, *more), 1)
        assert complaint == f"{out}: exists already; --overwrite replaces it"
        assert out.read_text() == "precious"
    assert run("render", grid, "-o", out, "--overwrite").exit_code == 0
    with Image.open(out) as image:
        assert image.format == "PNG"


def test_the_grid_itself_is_never_replaced(grid: Path, tmp_path: Path) -> None:
    named_so = tmp_path / "grid.png"
    grid.rename(named_so)
    before = named_so.read_bytes()
    assert run("render", named_so, "-o", named_so, "--overwrite").exit_code == 1
    assert named_so.read_bytes() == before


@pytest.mark.parametrize(("name", "args", "complaint"), [
    ("no/site.png", (), "{out}: the folder {folder} does not exist"),
    ("no/f.gif", ("--animate", "record"), "{out}: the folder {folder} does not exist"),
    ("site.jpg", (), '{out}: unknown suffix ".jpg", expected .png '
     "(a film: --animate with .png, .gif or .webp)"),
    ("site", (), '{out}: unknown suffix "", expected .png '
     "(a film: --animate with .png, .gif or .webp)"),
    ("f.mp4", ("--animate", "record"),
     '{out}: unknown suffix ".mp4", expected one of .png, .apng, .gif, .webp'),
    (".png", ("--window", "50,50,51,51"), None),
    ("site.png", ("--window", "50,50,51,51"),
     "{grid}: nothing in the window; all evidence lies within -1.00,-0.50,2.00,1.50"),
    ("a.png", ("--bare", "--scale", "10000"), "a picture of 60000 × 40000 pixels, expected at most "
     "10⁸; --max-size PIXELS shrinks it, --window X0,Y0,X1,Y1 takes a part"),
    ("a.png", ("--scale", "10000"), None),
    ("a.png", ("--bare", "--window", "-1e5,-1e5,1e5,1e5"), None),
])  # fmt: skip
def test_what_cannot_be_drawn_is_refused_in_one_line(
    name: str, args: tuple[str, ...], complaint: str | None, grid: Path, tmp_path: Path
) -> None:
    out, before = tmp_path / name, files(tmp_path)
    said = refused(run("render", grid, "-o", out, *args), 1)
    if complaint:
        assert said == complaint.format(out=out, folder=out.parent, grid=grid)
    assert files(tmp_path) == before


@pytest.mark.parametrize("args", [
    ("-o", "x.png"), ("-o", "x.png", "--bare"), ("-o", "x.gif", "--animate", "record"), ("--show",),
])  # fmt: skip
def test_an_empty_grid_has_no_picture(
    args: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.json").write_text(json.dumps({**LOG, "records": []}))
    run("fuse", "a.json", "-g", "empty.possmap")
    said = refused(run("render", "empty.possmap", *args), 1)
    assert said == "empty.possmap: holds no evidence, so there is nothing to show"
    assert list(files(tmp_path)) == ["a.json", "empty.possmap"]


@pytest.mark.parametrize(("args", "complaint"), [
    (("--layer", "neccessity"), "Invalid value for '--layer': "
     'unknown layer "neccessity", did you mean "necessity"?'),
    (("--layer", "xyz"), "Invalid value for '--layer': "
     f'unknown layer "xyz", expected one of {LAYERS}'),
    (("--layer", ""), f"Invalid value for '--layer': {IS_NONE}"),
    (("--panels", ""), f"Invalid value for '--panels': {IS_NONE}"),
    (("--panels", "map,,points"),
     f"Invalid value for '--panels': {IS_NONE}"),
    (("--panels", "map,confict"), "Invalid value for '--panels': "
     'unknown layer "confict", did you mean "conflict"?'),
    (("--palette", "virids"), "Invalid value for '--palette': "
     'unknown palette "virids", did you mean "viridis"?'),
    (("--layer", "map", "--panels", "map"), "Give --layer or --panels, not both."),
    (("--panels", "map,points", "--bare"), "--bare draws one layer: give --layer, not --panels."),
    (("--scale", "0"), "Invalid value for '--scale': 0 is not in the range x>=1."),
    (("--window", "1,0,0,1"), None),
    (("--base-rate", "1"), None),
    (("--animate", "day"), None),
    (("--truth", "missing.json"), None),
    (("--frames", "3"), None),
])  # fmt: skip
def test_wrong_usage_is_said_and_nothing_written(
    args: tuple[str, ...], complaint: str | None, grid: Path, tmp_path: Path
) -> None:
    before = files(tmp_path)
    said = refused(run("render", grid, "-o", tmp_path / "x.png", *args), 2)
    assert complaint is None or said == complaint
    assert files(tmp_path) == before


def test_an_output_or_a_preview_must_be_asked_for(grid: Path) -> None:
    said = refused(run("render", grid), 2)
    assert said == "Give -o OUT.png for a picture, or --show for a preview."


@pytest.mark.parametrize(("text", "complaint"), [
    ('{"possmap_truth": 1,\n "walls": [[0, 0, 1', "{truth}:2: not JSON: "),
    ('{"possmap_truth": 1, "walls": [[0, 0, 1]]}',
     "{truth}: walls[0]: found [0, 0, 1], expected [x, y, x2, y2]"),
    ('{"walls": []}', "{truth}: possmap_truth: is missing or not 1, expected a truth file"),
    ('{"possmap_truth": 1, "walls": 7}', "{truth}: walls: found 7, expected a list"),
    ('{"possmap_truth": 1, "walls": [[0, 0, 1, "x"]]}', "{truth}: walls[0]: "),
    ("", "{truth}"),
])  # fmt: skip
@pytest.mark.parametrize("name", ["site.png", "film.gif"])
def test_a_damaged_truth_file_is_refused(
    text: str, complaint: str, name: str, grid: Path, tmp_path: Path
) -> None:
    truth = tmp_path / "truth.json"
    truth.write_text(text)
    before = files(tmp_path)
    more = ("--animate", "record") if name.endswith("gif") else ()
    said = refused(run("render", grid, "-o", tmp_path / name, "--truth", truth, *more), 1)
    assert said.startswith(complaint.format(truth=truth))
    assert files(tmp_path) == before


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize("film", [False, True])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_picture_that_fails_half_way_leaves_nothing_behind(
    error: BaseException, film: bool, existing: bool, grid: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def fail(image: Any, *args: Any) -> None:
        stream = next(arg for arg in args if hasattr(arg, "write"))
        stream.write(b"\x89PNG, and no more")
        raise error

    out = tmp_path / "site.png"
    if existing:
        out.write_text("precious")
    before = files(tmp_path)
    monkeypatch.setattr(possmap.pictures.render, "write_png", fail)
    monkeypatch.setattr(possmap.pictures.film, "_write", fail)
    more = ("--animate", "excursion") if film else ()
    result = run("render", grid, "-o", out, "--overwrite", *more)
    assert result.exit_code == 1
    if isinstance(error, OSError):
        assert refused(result, 1) == f"{out}: cannot be written: No space left on device"
    assert files(tmp_path) == before
    assert not existing or out.read_text() == "precious"


def test_show_prints_letters_where_there_is_no_terminal(grid: Path) -> None:
    result = run("render", grid, "--show")
    assert result.stdout == "###\n  ...#\n"
    assert (result.stderr, result.exit_code) == ("", 0)


class Terminal:
    """A sys module whose stdout is a terminal."""

    class stdout:  # noqa: N801
        """Standard output."""

        @staticmethod
        def isatty() -> bool:
            """Say so."""
            return True


COLOURFUL: dict[str, str | None] = {
    "TERM": "xterm-256color", "COLORTERM": "truecolor", "NO_COLOR": None,
}  # fmt: skip


@pytest.mark.parametrize(("more", "colour"), [
    ({}, True), ({"NO_COLOR": "1"}, False), ({"NO_COLOR": ""}, True), ({"TERM": "dumb"}, False),
])  # fmt: skip
def test_show_has_colour_on_a_terminal_that_wants_it(
    grid: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, str], colour: bool
) -> None:
    monkeypatch.setattr(cli_render, "sys", Terminal)
    shown = run("render", grid, "--show", env={**COLOURFUL, **more}).stdout
    assert ("\x1b[38;2;" in shown) == colour
    assert shown.count("▀") == (12 if colour else 0)
    assert shown.endswith("\n") and shown.count("\n") == 2


def test_the_help_names_every_layer_and_an_example() -> None:
    shown = " ".join(run("render", "--help").stdout.split())
    assert LAYERS in shown and "Example: possmap render " in shown
