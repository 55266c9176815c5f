"""The furniture of a picture: title, axes, scale bar and keys, laid out so that none collide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw

from possmap.pictures import palettes
from possmap.pictures.legend import Key, in_rows
from possmap.pictures.raster import Raster
from possmap.pictures.text import LARGE, LINE, NORMAL, SMALL, fitted, width, write

PAD = 18
_TICK = 5
_GAP = 22
_IN_A_ROW = 3
"""Panels, at most."""
_LEAST = 460
"""Room for a title [pixels]."""
_AXES = "axes in metres"
_WIDE = 2.2
"""A map so many times as wide as high has its keys below it."""


@dataclass(frozen=True)
class Panel:
    """One map: its picture, cells drawn by ``raster``, and a title if there are several."""

    picture: Image.Image
    raster: Raster
    title: str = ""


def framed(
    panels: Sequence[Panel], keys: Sequence[Key], title: str, subtitle: str, resolution: float
) -> Image.Image:
    """Return panels side by side with everything that explains them.

    Parameters
    ----------
    panels
        Of one raster.
    keys
        Beside the panels, or below where they are wide.
    resolution
        Metres per cell.
    """
    raster = panels[0].raster
    map_width, map_height = panels[0].picture.size
    y_step, y_labels = ticks_of(raster, resolution, vertical=True)
    axis = max((width(label(v, y_step), SMALL) for v in y_labels), default=0) + _TICK + 6
    rows = -(-len(panels) // _IN_A_ROW)
    columns = -(-len(panels) // rows)
    heading = LINE + 4 if any(panel.title for panel in panels) else 0
    top = PAD + LARGE + 8 + LINE + 6
    row_height = heading + map_height + _TICK + LINE + 8
    bar, bar_label = scale_of(raster, resolution)
    bar_width = math.ceil(bar) + 8 + width(bar_label, SMALL)
    titles = max(width(panel.title, NORMAL) for panel in panels)
    column_width = max(map_width, titles) if columns > 1 else map_width
    maps_width = max(columns * column_width + (columns - 1) * _GAP, bar_width)
    maps_height = rows * row_height + LINE
    if maps_width > _WIDE * maps_height:
        key_places, key_size = in_rows([key.size for key in keys], max(maps_width, 420))
        content = max(maps_width, key_size[0])
        total_height = top + maps_height + 10 + key_size[1] + PAD
        key_x, key_y = PAD + axis, top + maps_height + 10
    else:
        key_places, key_size = in_rows([key.size for key in keys], 0)  # one below the other
        content = maps_width + 24 + key_size[0]
        total_height = top + max(maps_height, heading + key_size[1]) + PAD
        key_x, key_y = PAD + axis + maps_width + 24, top + heading
    content = max(content, _LEAST)
    sheet = Image.new("RGB", (PAD + axis + content + PAD, total_height), palettes.PAPER)
    draw = ImageDraw.Draw(sheet)
    left = PAD + axis
    write(draw, (left, PAD), fitted(title, LARGE, content), LARGE, palettes.INK)
    below = (left, PAD + LARGE + 8)
    write(draw, below, fitted(subtitle, NORMAL, content), NORMAL, palettes.FAINT)
    for number, panel in enumerate(panels):
        row, column = divmod(number, columns)
        x, y = left + column * (column_width + _GAP), top + row * row_height + heading
        _panel(sheet, panel, x, y, resolution, with_labels=column == 0)
    foot = top + rows * row_height + LINE // 2
    if width(_AXES, SMALL) + 16 + bar_width <= maps_width:
        write(draw, (left, foot), _AXES, SMALL, palettes.FAINT, "lm")
    _scale_bar(draw, left + maps_width, foot, bar, bar_label)
    for key, (dx, dy) in zip(keys, key_places, strict=True):
        key.draw(sheet, key_x + dx, key_y + dy)
    return sheet


def _panel(
    sheet: Image.Image, panel: Panel, x: int, y: int, resolution: float, with_labels: bool
) -> None:
    """Draw one map with its ticks; only the first has labels along y."""
    draw = ImageDraw.Draw(sheet)
    map_width, map_height = panel.picture.size
    if panel.title:
        write(draw, (x, y - 8), panel.title, NORMAL, palettes.INK, "ls")
    sheet.paste(panel.picture, (x, y))
    draw.rectangle((x - 1, y - 1, x + map_width, y + map_height), outline=palettes.FAINT)
    step, values = ticks_of(panel.raster, resolution, vertical=False)
    for value in values:
        at, foot = x + panel.raster.to_pixel(value, 0, resolution)[0], y + map_height + _TICK
        draw.line((at, y + map_height + 1, at, foot), palettes.FAINT)
        write(draw, (at, foot + 3), label(value, step), SMALL, palettes.INK, "ma")
    step, values = ticks_of(panel.raster, resolution, vertical=True)
    for value in values:
        at = y + panel.raster.to_pixel(0, value, resolution)[1]
        draw.line((x - _TICK - 1, at, x - 2, at), palettes.FAINT)
        if with_labels:
            write(draw, (x - _TICK - 5, at), label(value, step), SMALL, palettes.INK, "rm")


def round_step(least: float) -> float:
    """Return the smallest 1, 2 or 5 times a power of ten that is at least ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    for factor in (1, 2, 5, 10):
        if factor * power >= least * (1 - 1e-9):
            return factor * power
    return 10 * power


def round_length(most: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is at most ``most``."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(f * power for f in (0.5, 1, 2, 5) if f * power <= most * (1 + 1e-9))


def multiples(step: float, low: float, high: float) -> list[float]:
    """Return the multiples of ``step`` from ``low`` to ``high``."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def label(value: float, step: float) -> str:
    """Return a tick's label with as many decimals as its step needs."""
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{value + 0.0:.{decimals}f}"


def ticks_of(raster: Raster, resolution: float, vertical: bool) -> tuple[float, list[float]]:
    """Return step and values of an axis's labels [m], far enough apart never to touch."""
    per_metre = raster.pixels_per_metre(resolution)
    window = raster.window
    low, high = (window.row0, window.row1) if vertical else (window.column0, window.column1)
    low_m, high_m = low * resolution, high * resolution
    apart = 34 if vertical else 40
    step = round_step(apart / per_metre)
    while not vertical:
        values = multiples(step, low_m, high_m)
        widest = max((width(label(v, step), SMALL) for v in values), default=0)
        if step * per_metre >= widest + 16:
            break
        step = round_step(step * 1.01)
    return step, multiples(step, low_m, high_m)


def scale_of(raster: Raster, resolution: float) -> tuple[float, str]:
    """Return the length of a bar of round metres [pixels], and its label."""
    per_metre = raster.pixels_per_metre(resolution)
    length = round_length(max(60.0, raster.size[0] / 4) / per_metre)
    return length * per_metre, f"{length:g} m" if length < 1e4 else f"{length / 1000:g} km"


def _scale_bar(
    draw: ImageDraw.ImageDraw, right: float, y: float, length: float, words: str
) -> None:
    """Draw a bar that ends at ``right``, its label to the left of it."""
    left = right - length
    draw.line((left, y, right, y), palettes.INK, 2)
    for end in (left, right):
        draw.line((end, y - 4, end, y + 4), palettes.INK, 2)
    write(draw, (left - 8, y), words, SMALL, palettes.INK, "rm")
