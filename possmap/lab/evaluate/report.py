"""The report of an evaluation on one page: map beside truth, validity, errors, scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from possmap.atomic import replacing
from possmap.core.lattice import Window
from possmap.grid.grid import Grid
from possmap.lab.evaluate.raster import Segments
from possmap.lab.evaluate.results import Evaluation, GridScore
from possmap.lab.evaluate.scores import MethodScore
from possmap.lab.evaluate.tracks import Rectangles
from possmap.lab.evaluate.validity import Bin
from possmap.pictures import compose, overlays, palettes
from possmap.pictures.charts import Axis, Chart, Mark, Point, Series
from possmap.pictures.frame import Panel, framed
from possmap.pictures.layers import MAP
from possmap.pictures.legend import Group, LegendEntry, line
from possmap.pictures.overlays import Overlays
from possmap.pictures.palettes import Colour, write_png
from possmap.pictures.raster import Raster, plan
from possmap.pictures.render import Look, scene_of
from possmap.pictures.text import LINE, NORMAL, SMALL, fitted, width, write
from possmap.release import version

COLOURS: tuple[Colour, ...] = (
    (0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0),
)  # fmt: skip
"""Told apart by people who see fewer colours (Okabe and Ito); marks and dashes tell them too."""

MARKS: tuple[Mark, ...] = ("disc", "square", "triangle", "cross")
_PAD = 18
_CHART = (750, 430)
_MOST_DOTS = 3000
_LONGEST = 700
"""The longer side of the map, and of the truth beside it [pixels]."""

Column = tuple[str, Callable[[MethodScore], float | None], bool]
"""Title, value, and whether higher is better; None: neither."""

COLUMNS: tuple[Column, ...] = (
    ("AUC", lambda one: one.auc, True),
    ("F1 5 cm", lambda one: one.f1_5cm, True),
    ("F1 15 cm", lambda one: one.f1_15cm, True),
    ("precision", lambda one: one.precision_15cm, True),
    ("recall", lambda one: one.recall_15cm, True),
    ("Brier", lambda one: one.brier, False),
    ("log score", lambda one: one.log_score, False),
    ("walls called free", lambda one: one.dangerous_free, False),
    ("floor called free", lambda one: one.called_free, True),
    ("walls, equal floor", lambda one: one.dangerous_at_equal_floor, False),
)


def draw_report(path: Path, found: Evaluation, output: Path, overwrite: bool) -> None:
    """Draw the report of a grid's evaluation into a PNG file.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    with Grid(path) as grid, grid.snapshot():
        window = _shown(grid, found)
        maps = _maps(grid, found.walls, plan(window, None, _LONGEST, _LONGEST))
        digest = grid.digest()
    with replacing(output, overwrite) as stream:
        text = {"Software": f"possmap {version()}", "possmap:digest": digest}
        write_png(report(found, maps), stream, text)


def _shown(grid: Grid, found: Evaluation) -> Window:
    """Return what holds evidence of what was judged."""
    shown = (grid.window or found.window).intersection(found.window)
    return shown if shown.cells else found.window


def _maps(grid: Grid, walls: Segments, chosen: Raster) -> Image.Image:
    """Return map and truth side by side."""
    look = Look(title=f"How true {grid.path.stem} is")
    scene = scene_of(grid, look, chosen)
    picture = compose.bare(scene, MAP, chosen, look.palette).convert("RGB")
    overlays.paint(picture, scene.overlays, chosen, grid.resolution)
    truth = Image.new("RGB", picture.size, palettes.UNKNOWN)
    true_walls = tuple((x, y, x2, y2) for x, y, x2, y2 in walls.tolist())
    overlays.paint(truth, Overlays(truth=true_walls), chosen, grid.resolution)
    keys = [
        *compose.keys(scene.overlays, {MAP: 1}, look.palette),
        Group([LegendEntry(line(palettes.TRUTH), "true wall")]),
    ]
    panels = [Panel(picture, chosen, "map"), Panel(truth, chosen, "truth")]
    return framed(panels, keys, scene.title, scene.subtitle, grid.resolution)


def report(found: Evaluation, maps: Image.Image) -> Image.Image:
    """Return four charts and a table of scores below a picture of map and truth."""
    name, one = next(iter(found.grids.items()))
    of_name = "" if len(found.grids) == 1 else f" of {name}"
    charts = [
        _validity(f"lower validity{of_name}", "belief Bel", one.lower_validity, is_lower=True),
        _validity(f"upper validity{of_name}", "plausibility Pl", one.upper_validity),
        _precision_recall(found),
        _errors(one, of_name),
    ]
    wide = max(maps.width, 2 * (_CHART[0] + _PAD))
    table = _table(found, wide - 2 * _PAD)
    below = maps.height + len(charts) // 2 * (_CHART[1] + _PAD)
    sheet = Image.new("RGB", (wide, below + table.height + _PAD), palettes.PAPER)
    sheet.paste(maps, (0, 0))
    for number, chart in enumerate(charts):
        row, column = divmod(number, 2)
        place = _PAD + column * _CHART[0], maps.height + row * (_CHART[1] + _PAD)
        sheet.paste(chart.drawn(_CHART, legend_lines=3), place)
    sheet.paste(table, (_PAD, below))
    return sheet


def _style(number: int) -> tuple[Colour, Mark, int]:
    """Return colour, mark and dash of a method by its place."""
    return COLOURS[number % len(COLOURS)], MARKS[number % len(MARKS)], (0, 5, 2)[number % 3]


def _validity(title: str, axis: str, bins: Sequence[Bin], is_lower: bool = False) -> Chart:
    largest = max((part.cells for part in bins), default=1)
    radii = [2 + 6 * math.sqrt(part.cells / largest) for part in bins]
    series = []
    for number, (label, field) in enumerate(
        (
            ("within its rectangle", "wall_local"),
            ("within 30 cm", "wall_30cm"),
            ("within 10 cm", "wall_10cm"),
            ("in the cell", "wall"),
        )
    ):
        colour, mark, dash = _style(number)
        points = [(part.mean, float(getattr(part, field))) for part in bins]
        series.append(Series(label, points, colour, mark, dash=dash, radii=radii))
    return Chart(
        f"{title}: is what it says so?",
        Axis(f"{axis} (marks: the larger, the more cells)", 0, 1),
        Axis("frequency of a wall", 0, 1),
        series,
        diagonal="as often as it says" if is_lower else "",
        claims="claims more than is there" if is_lower else "",
    )


def _precision_recall(found: Evaluation) -> Chart:
    series = []
    for number, (name, score) in enumerate(found.methods.items()):
        colour, mark, dash = _style(number)
        curve = score.curve_15cm
        if curve is None:
            continue
        some = np.linspace(0, len(curve.f1) - 1, 500).astype(np.int64)
        line = list(zip(curve.recall[some].tolist(), curve.precision[some].tolist(), strict=True))
        best = float(curve.recall[curve.best]), float(curve.precision[curve.best])
        series.append(Series("", line, colour, "none", dash=dash))
        series.append(Series(f"{name}, best F1", [best], colour, mark, radii=[7.0]))
    if found.all_wall_f1_15cm is not None:
        precision = found.all_wall_f1_15cm / (2 - found.all_wall_f1_15cm)
        series.append(Series("every cell", [(1.0, precision)], palettes.INK, "cross", line=False))
    return Chart(
        "walls within 15 cm, all thresholds",
        Axis("recall", 0, 1),
        Axis("precision", 0, 1),
        series,
        empty="no wall among the cells judged",
    )


def _errors(one: GridScore, of_name: str) -> Chart:
    none = np.empty(0)
    half = np.concatenate([none, *(part for t in one.tracks for part in (t.half_x, t.half_y))])
    off = np.concatenate([none, *(part for t in one.tracks for part in (t.error_x, t.error_y))])
    largest = max(0.1, float(half.max(initial=0)), float(np.abs(off).max(initial=0)))
    high = 10.0 ** math.ceil(math.log10(largest) - 1e-9)
    step = max(1, len(half) // _MOST_DOTS)
    dots: list[Point] = list(zip(half[::step].tolist(), np.abs(off)[::step].tolist(), strict=True))
    summed = one.rectangles
    inside = "" if summed is None else f": {summed.coverage:.1%} of {summed.poses} places inside"
    radii = [2.0] * len(dots)
    return Chart(
        f"errors along the tracks{of_name}{inside}",
        Axis("half-width of the rectangle [m]", 1e-3, high, log=True),
        Axis("true error along the same axis [m]", 1e-3, high, log=True),
        [Series("pose, along x or y", dots, COLOURS[0], "disc", line=False, radii=radii, alpha=70)],
        diagonal="edge of the rectangle" if dots else "",
        empty="no true tracks given",
    )


def _table(found: Evaluation, wide: int) -> Image.Image:
    """Return scores, the best of each column marked, and below what belongs to all of them."""
    lines = list(_sentences(found))
    high = (len(found.methods) + 2) * (LINE + 6) + len(lines) * LINE + 12
    sheet = Image.new("RGB", (wide, high), palettes.PAPER)
    draw = ImageDraw.Draw(sheet)
    first = 220
    step = (wide - first) // len(COLUMNS)
    y = LINE
    for number, (title, _, higher) in enumerate(COLUMNS):
        right = first + (number + 1) * step - 12
        write(draw, (right, y - 9), title, NORMAL, palettes.INK, "rs")
        better = "higher is better" if higher else "lower is better"
        write(draw, (right, y + 5), better, SMALL, palettes.FAINT, "rs")
    y += 12
    draw.line((0, y, wide, y), palettes.FAINT)
    best = [_best([value(one) for one in found.methods.values()], up) for _, value, up in COLUMNS]
    for row, (name, score) in enumerate(found.methods.items()):
        y += LINE + 6
        draw.rectangle((0, y - 12, 10, y - 2), _style(row)[0])
        write(draw, (18, y), fitted(name, NORMAL, first - 30), NORMAL, palettes.INK, "ls")
        for number, (_, value, _) in enumerate(COLUMNS):
            text, right = number_words(value(score)), first + (number + 1) * step - 12
            if row in best[number]:
                left = right - width(text, NORMAL)
                draw.rectangle((left - 5, y - 14, right + 4, y + 4), palettes.UNKNOWN)
            write(draw, (right, y), text, NORMAL, palettes.INK, "rs")
    y += 12
    draw.line((0, y, wide, y), palettes.FAINT)
    for sentence in lines:
        y += LINE
        write(draw, (0, y), fitted(sentence, SMALL, wide), SMALL, palettes.INK, "ls")
    return sheet


def _best(values: Sequence[float | None], higher: bool) -> set[int]:
    """Return the rows that hold the best of a column, as it is printed."""
    known = [round(value, 3) for value in values if value is not None]
    if len(known) < 2:
        return set()
    top = max(known) if higher else min(known)
    return {row for row, v in enumerate(values) if v is not None and round(v, 3) == top}


def _sentences(found: Evaluation) -> Iterator[str]:
    yield (
        f"{found.wall_cells} of {found.mask_cells} cells judged are wall. For scale: calling every "
        f"cell wall has F1 15 cm {number_words(found.all_wall_f1_15cm)}, the same records at their "
        f"true poses {number_words(found.true_pose_f1_15cm)}."
    )
    for name, one in found.grids.items():
        words = list(grid_words(one))
        for start in range(0, len(words), 5):
            yield f"{name}: {', '.join(words[start : start + 5])}."
    yield from (f"Note: {note}." for note in found.notes)


def grid_words(one: GridScore) -> Iterator[str]:
    """Yield what only a grid of possmap has to answer for, in a few words each."""
    yield f"{one.sharpness:.3f} of 1 left open on average"
    yield f"{one.contested:.1%} of the cells contested"
    yield f"{one.contradicted:.1%} contradicted"
    yield f"mean conflict {one.mean_conflict:.4f}"
    yield f"AUC of N alone {number_words(one.auc_necessity)}"
    if one.rectangles is not None:
        yield from rectangle_words(one.rectangles)
    if one.explored_free is not None:
        yield f"{one.explored_free:.1%} of the floor explored"
    if one.explored_wall is not None:
        yield f"{one.explored_wall:.1%} of the walls"


def rectangle_words(held: Rectangles) -> Iterator[str]:
    """Yield how many rectangles hold, and how large they are."""
    yield f"rectangles hold the true place at {held.coverage:.1%} of {held.poses} poses"
    yield f"mean half-width {held.mean_half_width:.2f} m"


def number_words(value: float | None) -> str:
    """Return a number as tables have it."""
    return "-" if value is None else f"{value:.3f}"
