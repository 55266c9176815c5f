"""Small charts in the style of the maps: axes, curves, dots, and a legend below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Literal, TypeAlias

from PIL import Image, ImageDraw

from possmap.pictures import frame, palettes
from possmap.pictures.legend import LegendEntry, in_rows
from possmap.pictures.palettes import Colour
from possmap.pictures.text import LINE, NORMAL, SMALL, fitted, write

Mark: TypeAlias = Literal["disc", "square", "triangle", "cross", "none"]
Point: TypeAlias = tuple[float, float]

_FINE = 2
"""Curves are drawn so much larger and then reduced: smooth, without a drawing library."""
_LEFT, _TOP, _BELOW = 50, 46, 44
_SIGN = 30
_LONGEST_LINE = 100_000


@dataclass(frozen=True)
class Axis:
    """What runs along a side. ``log``: in powers of ten; values below ``low`` lie at its end."""

    title: str
    low: float
    high: float
    log: bool = False

    def share(self, value: float) -> float:
        """Return how far along a value lies, 0 to 1."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def labels(self) -> list[tuple[float, str]]:
        """Return values to mark, with what to write at them."""
        if self.log:
            first, last = math.ceil(math.log10(self.low)), math.floor(math.log10(self.high))
            return [(10.0**k, f"{10.0**k:g}") for k in range(first, last + 1)]
        step = frame.round_step((self.high - self.low) / 5)
        values = frame.multiples(step, self.low, self.high)
        return [(value, frame.label(value, step)) for value in values]


@dataclass(frozen=True)
class Series:
    """Points that belong together.

    line : joined by one; dash : with gaps of so many pixels, 0 for none.
    radii : of the marks, one each [pixels]; empty: all alike.
    alpha : of the marks, 0 to 255.
    """

    name: str
    points: Sequence[Point]
    colour: Colour
    mark: Mark = "disc"
    line: bool = True
    dash: int = 0
    radii: Sequence[float] = ()
    alpha: int = 255


@dataclass(frozen=True)
class Chart:
    """A chart to be drawn.

    diagonal : what the line from corner to corner means; empty: there is none.
    claims : shade what lies below the diagonal, and call it so.
    empty : what to say where there is nothing to draw.
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series] = field(default_factory=tuple)
    diagonal: str = ""
    claims: str = ""
    empty: str = ""

    def drawn(self, size: tuple[int, int], legend_lines: int) -> Image.Image:
        """Return its picture, of a size [pixels], with room for so many lines of legend."""
        sheet = Image.new("RGB", size, palettes.PAPER)
        draw = ImageDraw.Draw(sheet)
        area = _LEFT, _TOP, size[0] - 14, size[1] - _BELOW - legend_lines * LINE
        write(draw, (_LEFT, 4), fitted(self.title, NORMAL, size[0] - _LEFT), NORMAL, palettes.INK)
        self._axes(draw, area)
        if any(series.points for series in self.series):
            plot = self._plot(area)
            sheet.paste(plot, area[:2], plot)
        else:
            middle = (area[0] + area[2]) // 2, (area[1] + area[3]) // 2
            write(draw, middle, self.empty, NORMAL, palettes.FAINT, "mm")
        draw.rectangle(area, outline=palettes.FAINT)
        if self.claims:
            at = area[2] - 8, area[3] - 8
            write(draw, at, self.claims, SMALL, palettes.FAINT, "rs")
        self._legend(draw, area[3] + _BELOW - 4, size[0])
        return sheet

    def _axes(self, draw: ImageDraw.ImageDraw, area: tuple[int, int, int, int]) -> None:
        left, top, right, bottom = area
        for value, text in self.x.labels():
            at = left + self.x.share(value) * (right - left)
            draw.line((at, bottom, at, bottom + 4), palettes.FAINT)
            draw.line((at, top, at, bottom), palettes.UNKNOWN)
            write(draw, (at, bottom + 7), text, SMALL, palettes.INK, "ma")
        for value, text in self.y.labels():
            at = bottom - self.y.share(value) * (bottom - top)
            draw.line((left - 4, at, left, at), palettes.FAINT)
            draw.line((left, at, right, at), palettes.UNKNOWN)
            write(draw, (left - 7, at), text, SMALL, palettes.INK, "rm")
        write(draw, (right, bottom + 22), self.x.title, SMALL, palettes.FAINT, "ra")
        write(draw, (left, top - 8), self.y.title, SMALL, palettes.FAINT, "ls")

    def _plot(self, area: tuple[int, int, int, int]) -> Image.Image:
        wide, high = area[2] - area[0], area[3] - area[1]
        sheet = Image.new("RGBA", (wide * _FINE, high * _FINE))
        draw = ImageDraw.Draw(sheet)

        def at(point: Point) -> Point:
            x, y = self.x.share(point[0]), self.y.share(point[1])
            return x * (wide * _FINE - 1), (1 - y) * (high * _FINE - 1)

        if self.diagonal or self.claims:
            low, up = max(self.x.low, self.y.low), min(self.x.high, self.y.high)
            ends = at((low, low)), at((up, up))
            if self.claims:
                corner = ends[1][0], ends[0][1]
                draw.polygon((*ends, corner), (*palettes.UNKNOWN, 110))
            _line(draw, ends, palettes.FAINT, 1, 4)
        for series in self.series:
            places = [at(point) for point in series.points]
            if series.line and len(places) > 1:
                _line(draw, places, series.colour, 2, series.dash)
            # Dots that overlap must not hide what is below: each is laid over the rest.
            dots = Image.new("RGBA", sheet.size) if series.alpha < 255 else sheet
            on = ImageDraw.Draw(dots)
            for number, place in enumerate(places):
                radius = series.radii[number] if series.radii else 4.0
                _mark(on, place, series.mark, radius * _FINE, (*series.colour, series.alpha))
            if dots is not sheet:
                sheet.alpha_composite(dots)
        return sheet.resize((wide, high), Image.Resampling.BOX)

    def _legend(self, draw: ImageDraw.ImageDraw, y: int, wide: int) -> None:
        entries = [
            LegendEntry(partial(_sign, series), series.name, SMALL, _SIGN)
            for series in self.series
            if series.name and series.points
        ]
        if self.diagonal:
            diagonal = Series("", (), palettes.FAINT, "none", dash=4)
            entries.append(LegendEntry(partial(_sign, diagonal), self.diagonal, SMALL, _SIGN))
        places, _ = in_rows([entry.size for entry in entries], wide - _LEFT - 16, (16, 0))
        for entry, (dx, dy) in zip(entries, places, strict=True):
            entry.draw(draw, _LEFT + dx, y + dy)


def _sign(series: Series, draw: ImageDraw.ImageDraw, x: int, y: int) -> None:
    """Draw a series as it looks, for the legend."""
    if series.line:
        thick = 1 if series.colour == palettes.FAINT else 2
        _line(draw, [(x, y), (x + 22, y)], series.colour, thick / _FINE, series.dash // _FINE)
    _mark(draw, (x + 11.0, y), series.mark, 4.0, series.colour)


def _line(
    draw: ImageDraw.ImageDraw, places: Sequence[Point], colour: Colour, thick: float, dash: int
) -> None:
    """Draw a line, with gaps if ``dash`` is not 0."""
    broad = max(1, round(thick * _FINE))
    if not dash:
        draw.line([*places], (*colour, 255), broad, "curve")
        return
    gone = 0.0  # the dashes go on round the corners
    period = 2.0 * dash * _FINE
    for start, end in pairwise(places):
        length = math.dist(start, end)
        at = 0.0
        while at < min(length, _LONGEST_LINE):
            phase = (gone + at) % period
            step = min((period / 2 if phase < period / 2 else period) - phase + 1e-9, length - at)
            if phase < period / 2:
                cut = [_between(start, end, place / length) for place in (at, at + step)]
                draw.line(cut, (*colour, 255), broad)
            at += step
        gone += length


def _between(start: Point, end: Point, share: float) -> Point:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def _mark(
    draw: ImageDraw.ImageDraw, at: Point, mark: Mark, radius: float, colour: tuple[int, ...]
) -> None:
    x, y = at
    box = (x - radius, y - radius, x + radius, y + radius)
    if mark == "disc":
        draw.ellipse(box, colour)
    elif mark == "square":
        draw.rectangle(box, colour)
    elif mark == "triangle":
        corners = [(x, y - radius), (x + radius, y + radius), (x - radius, y + radius)]
        draw.polygon(corners, colour)
    elif mark == "cross":
        broad = max(1, round(radius / 2))
        draw.line(box, colour, broad)
        draw.line((x - radius, y + radius, x + radius, y - radius), colour, broad)
