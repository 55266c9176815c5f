"""The report of a calibration: per robot scatter, growth with distance, turns, and the words."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw

from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import JOINT, directions, lengths, rectangle_factor
from possmap.lab.calibrate.odd import notes
from possmap.lab.calibrate.robots import Calibration, RobotResult
from possmap.lab.calibrate.trials import UNIT_TURN_DEG, Floats, TrialTable
from possmap.lab.calibrate.words import findings, plain
from possmap.pictures import palettes
from possmap.pictures.charts import Axis, Chart, Mark, Series
from possmap.pictures.palettes import Colour
from possmap.pictures.text import LARGE, LINE, NORMAL, SMALL, fitted, width, write

BLACK: Colour = (0, 0, 0)
BLUE: Colour = (0, 114, 178)
ORANGE: Colour = (230, 159, 0)
VERMILION: Colour = (213, 94, 0)
"""Told apart by people who see fewer colours (Okabe and Ito); marks and dashes tell them too."""

MOST = 7
"""Robots drawn; the text has the others."""

_PAD, _CHART = 18, (480, 400)
_WIDE = 3 * _CHART[0]
_MOST_DOTS = 2000
_FEW_LINES, _CIRCLE = 14, 96


def sheet(found: Calibration) -> Image.Image:
    """Return the report: a row of three charts and some words for each robot, and for all."""
    everyone = found.everyone
    shown = everyone if len(everyone) <= MOST else (*everyone[: MOST - 1], everyone[-1])
    rows = [_row(one) for one in shown]
    top = _PAD + LARGE + 10
    more = len(everyone) - len(shown)
    high = top + sum(row.height + _PAD for row in rows) + (LINE + _PAD if more else 0)
    page = Image.new("RGB", (_WIDE + 2 * _PAD, high), palettes.PAPER)
    draw = ImageDraw.Draw(page)
    write(draw, (_PAD, _PAD), "How wrong the robots are", LARGE, palettes.INK)
    y = top
    for row in rows:
        page.paste(row, (_PAD, y))
        y += row.height + _PAD
    if more:
        words = f"{more} more robots are in the text and in the model"
        write(draw, (_PAD, y), words, NORMAL, palettes.FAINT)
    return page


def _row(one: RobotResult) -> Image.Image:
    lines = list(_words(one))
    charts = [_scatter(one), _growth(one), _turns(one)]
    head = LINE + 10
    high = head + _CHART[1] + len(lines) * LINE + 6
    row = Image.new("RGB", (_WIDE, high), palettes.PAPER)
    draw = ImageDraw.Draw(row)
    draw.line((0, 0, _WIDE, 0), palettes.FAINT)
    factor = one.parameters.get("factor")
    title = f"{one.robot or 'all together'}: {len(one.trials)} trials" + (
        "" if factor is None else f", half-widths of {factor:.3f} standard deviations"
    )
    write(draw, (0, LINE), fitted(title, NORMAL, _WIDE), NORMAL, palettes.INK, "ls")
    for number, chart in enumerate(charts):
        row.paste(chart.drawn(_CHART, legend_lines=2), (number * _CHART[0], head))
    for number, line in enumerate(lines):
        write(draw, (0, head + _CHART[1] + (number + 1) * LINE), line, SMALL, palettes.INK, "ls")
    return row


def _words(one: RobotResult) -> Iterator[str]:
    """Yield lines: the model, then what the trials say, as long as there is room."""
    model = ", ".join(
        f"{name} {value:.4g}" for name, value in one.parameters.items() if name != "factor"
    )
    lines: list[str] = []
    for sentence in (plain(one), f"Model: {model}.", *notes(one), *findings(one)):
        lines += _wrapped(sentence)
    if len(lines) > _FEW_LINES:
        lines = [*lines[: _FEW_LINES - 1], "... the text says the rest."]
    yield from lines


def _wrapped(text: str) -> Iterator[str]:
    line = ""
    for word in text.replace("±", "+-").replace("°", " deg").split():
        longer = f"{line} {word}".strip()
        if line and width(longer, SMALL) > _WIDE - 10:
            yield line
            longer = f"   {word}"
        line = longer
    yield fitted(line, SMALL, _WIDE - 10)


def _left(one: RobotResult) -> tuple[Floats, Floats, Floats]:
    """Return distance [m], and what is left along and across [m per m], of each run."""
    table, fit = TrialTable.of(one.trials), one.fit
    if fit.heading.runs < LEAST:
        return np.empty(0), np.empty(0), np.empty(0)
    along = lengths(table, fit.heading.effect("drift")) / fit.scale - 1
    off, _ = directions(table, fit.heading)
    return table.distance[table.run], along, np.tan(np.radians(off))


def _dots(name: str, x: Floats, y: Floats, colour: Colour = BLUE, mark: Mark = "disc") -> Series:
    step = max(1, len(x) // _MOST_DOTS)
    points = list(zip(x[::step].tolist(), y[::step].tolist(), strict=True))
    return Series(name, points, colour, mark, False, radii=[3.0] * len(points), alpha=130)


def _line(name: str, points: Floats, colour: Colour = BLACK, dash: int = 0) -> Series:
    """Return a curve through points, shape (2, n)."""
    return Series(name, list(zip(*points.tolist(), strict=True)), colour, "none", dash=dash)


def _scatter(one: RobotResult) -> Chart:
    _, along, across = _left(one)
    along, across = 100 * along, 100 * across
    series: list[Series] = []
    reach = [1.0, 1.0]
    if len(along) >= LEAST:
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]).T
        half = rectangle_factor(len(along)) * np.array([across.std(ddof=1), along.std(ddof=1)])
        box, ellipse = half[:, None] * corners, _ellipse(across, along)
        series = [
            _dots("run", across, along),
            _line("rectangle for a new run", box, VERMILION),
            _line("ellipse", ellipse, dash=4),
        ]
        outline = np.maximum(half, np.abs(ellipse).max(axis=1)).tolist()
        for k, values in enumerate((across, along)):  # what lies far outside is drawn at the end
            farthest = max(outline[k], float(np.abs(values).max()))
            reach[k] = min(2.5 * outline[k], 1.15 * farthest)
    return Chart(
        f"ends of runs, what is known taken out, and where {JOINT:.0%} of new ones lie",
        Axis("across [cm per m run], left is positive", -reach[0], reach[0]),
        Axis("along [cm per m run]", -reach[1], reach[1]),
        series,
        empty="too few runs",
    )


def _ellipse(x: Floats, y: Floats) -> Floats:
    """Return the ellipse that holds 95 % of new runs, if errors are normal (Hotelling's T²)."""
    from scipy import stats

    count = len(x)
    values, axes = np.linalg.eigh(np.cov(x, y))
    # Of few trials none is honest: it would be endless.
    df = max(1, count - 2)
    square = 2 * (count - 1) * (count + 1) / (count * df) * float(stats.f.ppf(JOINT, 2, df))
    angles = np.linspace(0, 2 * math.pi, _CIRCLE)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    found: Floats = axes @ (np.sqrt(np.maximum(values, 0) * square)[:, None] * circle)
    found += np.array([[x.mean()], [y.mean()]])
    return found


def _growth(one: RobotResult) -> Chart:
    distance, along, across = _left(one)
    series: list[Series] = []
    far = high = 1.0
    if len(distance) >= LEAST:
        ends = np.array([0.0, 1.08 * float(distance.max())])
        kinds: tuple[tuple[str, Floats, Colour, Mark, int], ...] = (
            ("across", across, BLUE, "disc", 0), ("along", along, ORANGE, "square", 6),
        )  # fmt: skip
        for name, own, colour, mark, dash in kinds:
            slope = rectangle_factor(len(distance)) * float(own.std(ddof=1))
            series.append(_dots(name, distance, np.abs(own) * distance, colour, mark))
            series.append(_line(f"half-width {name}", np.stack([ends, slope * ends]), colour, dash))
        far = float(ends[1])
        high = 1.1 * max(y for one_series in series for _, y in one_series.points)
    return Chart(
        "error against distance: in proportion?",
        Axis("distance run [m]", 0, far),
        Axis("error, what is known taken out [m]", 0, high),
        series,
        empty="too few runs",
    )


def _turns(one: RobotResult) -> Chart:
    fit, table = one.fit.heading, TrialTable.of(one.trials)
    errors = table.angle - fit.effect("drift") * table.reach
    which = table.turns & ~np.isnan(errors)
    turn, errors = table.turn_told[which], errors[which]
    series: list[Series] = []
    wide = high = 1.0
    if fit.turns >= LEAST and len(turn):
        wide = 1.1 * float(np.abs(turn).max())
        at = np.linspace(-wide, wide, 81)
        parts, still = np.abs(at) / UNIT_TURN_DEG, np.zeros_like(at)
        known = fit.known(parts, at, still)
        spread = np.sqrt(fit.spread(bool(table.distance[which].any()), parts, still))
        half = rectangle_factor(max(LEAST, fit.turns)) * spread
        high = 1.1 * float(max(np.abs(errors).max(), np.abs(known).max() + half.max()))
        series = [
            _dots("trial", turn, errors),
            _line("known part", np.stack([at, known]), VERMILION),
            _line("half-width about it", np.stack([at, known + half]), dash=4),
            _line("", np.stack([at, known - half]), dash=4),
        ]
    return Chart(
        "heading error against turn: always to one side?",
        Axis("turn [deg], left is positive", -wide, wide),
        Axis("heading error, drift taken out [deg]", -high, high),
        series,
        empty="too few turns",
    )
