"""The report of an evaluation on one page: map beside truth, reliability, errors, scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from PIL import Image, ImageDraw

from possmap.lab.evaluate.results import Evaluation, MethodScore
from possmap.pictures import palettes
from possmap.pictures.charts import Axis, Chart, Mark, Point, Series
from possmap.pictures.palettes import Colour
from possmap.pictures.text import LINE, NORMAL, SMALL, fitted, width, write

COLOURS: tuple[Colour, ...] = (
    (0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0),
)  # fmt: skip
"""Told apart by people who see fewer colours (Okabe and Ito); marks and dashes tell them too."""

MARKS: tuple[Mark, ...] = ("disc", "square", "triangle", "cross")
_PAD = 18
_CHART = (500, 430)
_MOST_DOTS = 3000
_STRETCHES, _ENOUGH = 12, 5

Column = tuple[str, Callable[[MethodScore], float | None], bool]
"""Title, value, and whether higher is better."""

COLUMNS: tuple[Column, ...] = (
    ("AUC", lambda one: one.auc, True),
    ("F1 5 cm", lambda one: one.f1_5cm, True),
    ("F1 15 cm", lambda one: one.f1_15cm, True),
    ("precision", lambda one: one.precision_15cm, True),
    ("recall", lambda one: one.recall_15cm, True),
    ("Brier", lambda one: one.brier.score, False),
    ("log score", lambda one: one.log_score.score, False),
    ("dangerously free", lambda one: one.dangerous_free, False),
)


def report(evaluation: Evaluation, maps: Image.Image) -> Image.Image:
    """Return the report below a picture of map and truth.

    Parameters
    ----------
    maps
        Map beside truth, with everything that explains them.
    """
    charts = list(_charts(evaluation))
    wide = max(maps.width, 3 * _CHART[0] + 2 * _PAD)
    rows = -(-len(charts) // 3)
    table = _table(evaluation, wide - 2 * _PAD)
    sheet = Image.new(
        "RGB", (wide, maps.height + rows * (_CHART[1] + _PAD) + table.height + _PAD), palettes.PAPER
    )
    sheet.paste(maps, (0, 0))
    for number, chart in enumerate(charts):
        row, column = divmod(number, 3)
        place = _PAD + column * _CHART[0], maps.height + row * (_CHART[1] + _PAD)
        sheet.paste(chart.drawn(_CHART, legend_lines=3), place)
    sheet.paste(table, (_PAD, maps.height + rows * (_CHART[1] + _PAD)))
    return sheet


def _style(number: int) -> tuple[Colour, Mark, int]:
    """Return colour, mark and dash of a method by its place."""
    return COLOURS[number % len(COLOURS)], MARKS[number % len(MARKS)], (0, 5, 2)[number % 3]


def _charts(found: Evaluation) -> Iterator[Chart]:
    name = next(iter(found.intervals))
    of_name = "" if len(found.intervals) == 1 else f" of {name}"
    one = found.intervals[name]
    percent = Axis("frequency of a wall", 0, 1)
    kinds = (
        ("within its rectangle", "wall_local"),
        ("within 30 cm", "wall_30cm"),
        ("within 10 cm", "wall_10cm"),
        ("in the cell", "wall"),
    )
    for title, axis, bins, diagonal in (
        ("lower validity", "necessity N", one.lower_validity, "as often as N says"),
        ("upper validity", "possibility of a wall", one.upper_validity, ""),
    ):
        largest = max((part.cells for part in bins), default=1)
        series = []
        for number, (label, field) in enumerate(kinds):
            colour, mark, dash = _style(number)
            points = [(part.mean, float(getattr(part, field))) for part in bins]
            radii = [2 + 6 * math.sqrt(part.cells / largest) for part in bins]
            series.append(Series(label, points, colour, mark, dash=dash, radii=radii))
        lower = title.startswith("lower")
        yield Chart(
            f"{title}{of_name}: is what it says so?",
            Axis(f"{axis} (marks: the larger, the more cells)", 0, 1),
            percent,
            series,
            diagonal=diagonal,
            claims="claims more than is there" if lower else "",
        )
    yield _calibration(found)
    yield _precision_recall(found)
    yield _errors(found, name, of_name)
    yield _along_the_way(found, name, of_name)


def _calibration(found: Evaluation) -> Chart:
    series = []
    for number, (name, score) in enumerate(found.methods.items()):
        colour, mark, dash = _style(number)
        bins = score.probability_bins
        largest = max((cells for *_, cells in bins), default=1)
        radii = [2 + 6 * math.sqrt(cells / largest) for *_, cells in bins]
        points = [(said, true) for said, true, _ in bins]
        series.append(Series(name, points, colour, mark, dash=dash, radii=radii))
    return Chart(
        f"probability at a base rate of {found.base_rate:g}",
        Axis("probability of a wall (marks: the larger, the more cells)", 0, 1),
        Axis("frequency of a wall", 0, 1),
        series,
        diagonal="as often as it says",
    )


def _precision_recall(found: Evaluation) -> Chart:
    series = []
    for number, (name, score) in enumerate(found.methods.items()):
        colour, mark, dash = _style(number)
        curve = score.curve_15cm
        if curve is None:
            continue
        line = list(zip(curve.recall.tolist(), curve.precision.tolist(), strict=True))
        series.append(Series("", line, colour, "none", dash=dash))
        best = line[curve.best]
        series.append(Series(f"{name}, best F1", [best], colour, mark, radii=[7.0]))
    reference = found.reference.all_wall_f1_15cm
    if reference is not None:
        precision = reference / (2 - reference)
        series.append(Series("every cell", [(1.0, precision)], palettes.INK, "cross", line=False))
    return Chart(
        "walls within 15 cm, all thresholds",
        Axis("recall", 0, 1),
        Axis("precision", 0, 1),
        series,
        empty="no wall among the cells judged",
    )


def _errors(found: Evaluation, name: str, of_name: str) -> Chart:
    tracks = found.tracks[name]
    half = np.concatenate([np.empty(0), *(part for t in tracks for part in (t.half_x, t.half_y))])
    off = np.abs(
        np.concatenate([np.empty(0), *(part for t in tracks for part in (t.error_x, t.error_y))])
    )
    least = 1e-3
    largest = max(0.1, float(half.max(initial=0)), float(off.max(initial=0)))
    high = 10.0 ** math.ceil(math.log10(largest) - 1e-9)
    step = max(1, len(half) // _MOST_DOTS)
    dots: list[Point] = list(zip(half[::step].tolist(), off[::step].tolist(), strict=True))
    summed = found.rectangles[name]
    inside = "" if summed is None else f"{summed.coverage:.1%} of {summed.poses} places inside"
    return Chart(
        f"errors along the tracks{of_name}" + (f": {inside}" if inside else ""),
        Axis("half-width of the rectangle [m]", least, high, log=True),
        Axis("true error along the same axis [m]", least, high, log=True),
        [
            Series(
                "pose, along x or y",
                dots,
                COLOURS[0],
                "disc",
                line=False,
                radii=[2.0] * len(dots),
                alpha=70,
            )
        ],
        diagonal="edge of the rectangle" if dots else "",
        empty="no true tracks given",
    )


def _along_the_way(found: Evaluation, name: str, of_name: str) -> Chart:
    """Hold errors against half-widths by how far the robots had run: medians of many poses."""
    tracks = [one for one in found.tracks[name] if len(one.distance)]
    distance = np.concatenate([np.empty(0), *(one.distance for one in tracks)])
    half = np.concatenate([np.empty(0), *((one.half_x + one.half_y) / 2 for one in tracks)])
    off = np.concatenate(
        [np.empty(0), *((abs(one.error_x) + abs(one.error_y)) / 2 for one in tracks)]
    )
    farthest = float(distance.max(initial=1.0))
    which = np.minimum((distance / farthest * _STRETCHES).astype(int), _STRETCHES - 1)
    lines: list[list[Point]] = [[], []]
    for stretch in range(_STRETCHES):
        chosen = which == stretch
        if chosen.sum() >= _ENOUGH:
            middle = float(np.median(distance[chosen]))
            for line, values in zip(lines, (half, off), strict=True):
                line.append((middle, float(np.median(values[chosen]))))
    highest = max((y for line in lines for _, y in line), default=1.0) or 1.0
    return Chart(
        f"errors by distance run{of_name}: medians",
        Axis("run since home [m]", 0, farthest),
        Axis("mean over x and y [m]", 0, 1.05 * highest),
        [
            Series("half-width of the rectangle", lines[0], COLOURS[5], "square", dash=5),
            Series("true error", lines[1], COLOURS[0], "disc"),
        ],
        empty="no true tracks given" if not tracks else "too few poses",
    )


def _table(found: Evaluation, wide: int) -> Image.Image:
    """Return scores, the best of each column marked, and below what belongs to all of them."""
    lines = [*_sentences(found)]
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
        colour, _, _ = _style(row)
        draw.rectangle((0, y - 12, 10, y - 2), colour)
        write(draw, (18, y), fitted(name, NORMAL, first - 30), NORMAL, palettes.INK, "ls")
        for number, (_, value, _) in enumerate(COLUMNS):
            text, right = _number(value(score)), first + (number + 1) * step - 12
            if row in best[number]:
                left = right - width(text, NORMAL)
                draw.rectangle((left - 5, y - 14, right + 4, y + 4), palettes.UNKNOWN)
            write(draw, (right, y), text, NORMAL, palettes.INK, "rs")
    y += 12
    draw.line((0, y, wide, y), palettes.FAINT)
    for line in lines:
        y += LINE
        write(draw, (0, y), fitted(line, SMALL, wide), SMALL, palettes.INK, "ls")
    return sheet


def _best(values: Sequence[float | None], higher: bool) -> set[int]:
    """Return the rows that hold the best of a column, as it is printed."""
    known = [round(value, 3) for value in values if value is not None]
    if len(known) < 2:
        return set()
    top = max(known) if higher else min(known)
    return {row for row, v in enumerate(values) if v is not None and round(v, 3) == top}


def _sentences(found: Evaluation) -> Iterator[str]:
    walls = f"{found.wall_cells} of {found.mask_cells} cells judged are wall"
    reference = found.reference
    yield (
        f"{walls}. For scale: calling every cell wall has F1 15 cm "
        f"{_number(reference.all_wall_f1_15cm)}, the same records at their true poses "
        f"{_number(reference.true_pose_f1_15cm)}."
    )
    for name, one in found.intervals.items():
        explored, summed = found.explored[name], found.rectangles[name]
        parts = [
            f"{one.sharpness:.2f} of 1 left open",
            f"{one.contradicted:.1%} of the cells contradicted",
            f"mean conflict {one.mean_conflict:.3f}",
        ]
        if summed is not None:
            parts.append(
                f"rectangles hold {summed.coverage:.1%} of {summed.poses} places, mean half-width "
                f"{summed.mean_half_width:.2f} m"
            )
        if explored.free is not None:
            parts.append(f"{explored.free:.0%} of the floor explored")
        if explored.wall is not None:
            parts.append(f"{explored.wall:.0%} of the walls")
        yield f"{name}: {', '.join(parts)}."
    yield from (f"Note: {note}." for note in found.notes)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
