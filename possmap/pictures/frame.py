"""The furniture of a picture: title, axes, scale bar and keys, laid out so that none collide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw

from possmap.pictures import axes, palettes
from possmap.pictures.legend import Key, in_column, in_rows
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
    y_step, y_labels = axes.ticks_of(raster, resolution, vertical=True)
    axis = max((width(axes.label(v, y_step), SMALL) for v in y_labels), default=0) + _TICK + 6
    rows = -(-len(panels) // _IN_A_ROW)
    columns = -(-len(panels) // rows)
    heading = LINE + 4 if any(panel.title for panel in panels) else 0
    top = PAD + LARGE + 8 + LINE + 6
    row_height = heading + map_height + _TICK + LINE + 8
    bar, bar_label = axes.scale_of(raster, resolution)
    bar_width = math.ceil(bar) + 8 + width(bar_label, SMALL)
    titles = max(width(panel.title, NORMAL) for panel in panels)
    column_width = max(map_width, titles) if columns > 1 else map_width
    maps_width = max(columns * column_width + (columns - 1) * _GAP, bar_width)
    maps_height = rows * row_height + LINE
    if maps_width > _WIDE * maps_height:
        key_places, key_size = in_rows(keys, max(maps_width, 420))
        content = max(maps_width, key_size[0])
        total_height = top + maps_height + 10 + key_size[1] + PAD
        key_x, key_y = PAD + axis, top + maps_height + 10
    else:
        key_places, key_size = in_column(keys)
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
    axes.draw_scale_bar(draw, left + maps_width, foot, bar, bar_label)
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
    step, values = axes.ticks_of(panel.raster, resolution, vertical=False)
    for value in values:
        at = x + panel.raster.to_pixel(value, 0, resolution)[0]
        draw.line((at, y + map_height + 1, at, y + map_height + _TICK), palettes.FAINT)
        write(
            draw,
            (at, y + map_height + _TICK + 3),
            axes.label(value, step),
            SMALL,
            palettes.INK,
            "ma",
        )
    step, values = axes.ticks_of(panel.raster, resolution, vertical=True)
    for value in values:
        at = y + panel.raster.to_pixel(0, value, resolution)[1]
        draw.line((x - _TICK - 1, at, x - 2, at), palettes.FAINT)
        if with_labels:
            write(draw, (x - _TICK - 5, at), axes.label(value, step), SMALL, palettes.INK, "rm")
