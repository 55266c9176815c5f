"""Axes of maps and charts: round numbers for ticks, and the scale bar."""

from __future__ import annotations

import math

from PIL import ImageDraw

from possmap.pictures import palettes
from possmap.pictures.raster import Raster
from possmap.pictures.text import SMALL, width, write


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


def draw_scale_bar(
    draw: ImageDraw.ImageDraw, right: float, y: float, length: float, label: str
) -> None:
    """Draw a bar that ends at ``right``, its label to the left of it."""
    left = right - length
    draw.line((left, y, right, y), palettes.INK, 2)
    for end in (left, right):
        draw.line((end, y - 4, end, y + 4), palettes.INK, 2)
    write(draw, (left - 8, y), label, SMALL, palettes.INK, "rm")
