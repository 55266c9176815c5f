"""What changed from one grid to another: belief and plausibility side by side, B - A.

Brown is towards a wall, blue away from it, as in the map; white is known and unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from PIL import Image, ImageDraw

from possmap.core.lattice import Window
from possmap.inspection.changes import Change, Changes
from possmap.pictures import palettes
from possmap.pictures.frame import Panel, framed
from possmap.pictures.legend import ColourBar, Group, Key, LegendEntry, box, circled
from possmap.pictures.overlays import Place
from possmap.pictures.palettes import Indices, Table, image_of
from possmap.pictures.raster import Raster, furnished_raster
from possmap.pictures.text import font

PANELS = ("belief", "plausibility")
"""What is drawn, of ``changes.QUANTITIES``, in that order."""

LONGEST = 640
"""A panel's longer side, at most [pixels]."""

_STEPS = 127
_UNCHANGED, _UNKNOWN = _STEPS, 255
"""Indices: 0 … 254 for changes of -1 … +1, and what neither grid knows."""

_RADIUS, _AWAY = 8, 18
"""Of a mark's circle, and how far it stands right of and above its place [pixels]."""
_FINE = 4
"""Marks are drawn so much larger and then reduced."""


class Canvas:
    """Gathers changes into the blocks of a picture: it is as large as that, not as the grids.

    A block shows the largest change of its cells, either way: a mean would hide changed walls.
    """

    def __init__(self, raster: Raster) -> None:
        self.raster = raster
        self._known = np.zeros(self.raster.blocks, dtype=np.uint8)
        shape = (len(PANELS), *self.raster.blocks)
        self._up, self._down = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.uint8)

    def add(self, found: Changes) -> None:
        """Add cells, and what changes among them."""
        window = found.window
        self.raster.raise_to(self._known, window, (found.known_a | found.known_b).view(np.uint8))
        if not found.row.size:
            return
        at = (found.row - window.row0, found.column - window.column0)
        for number in range(len(PANELS)):
            level = np.rint(_STEPS * (found.b[number] - found.a[number])).astype(np.int16)
            for whole, change in ((self._up, level), (self._down, -level)):
                cells = np.zeros(window.shape, dtype=np.uint8)
                cells[at] = np.maximum(change, 0)
                self.raster.raise_to(whole[number], window, cells)

    def indices(self, number: int) -> Indices:
        """Return the palette indices of a panel, the first row the highest y."""
        up, down = self._up[number], self._down[number]
        index = np.where(up >= down, _UNCHANGED + up, _UNCHANGED - down)
        index[self._known == 0] = _UNKNOWN
        found: Indices = index[::-1].astype(np.uint8)
        return found

    def drawn(
        self, names: tuple[str, str], resolution: float, largest: Sequence[Change]
    ) -> Image.Image:
        """Return the picture.

        names : of A and B.
        largest : changes to number as they are listed.
        """
        panels = []
        for number, quantity in enumerate(PANELS):
            index = self.indices(number)
            picture = image_of(index, self.raster.scale, table()).convert("RGB")
            marks = [
                (place, (one.x, one.y))
                for place, one in enumerate(largest, 1)
                if one.quantity == quantity
            ]
            _paint(picture, marks, self.raster, resolution)
            panels.append(Panel(picture, self.raster, f"{quantity} of a wall: B - A"))
        scale = table()[:_UNKNOWN]
        ends = ("-1", "+1")
        entries = [
            LegendEntry(box(palettes.PAPER), "known, no change"),
            LegendEntry(box(palettes.UNKNOWN), "unknown in both"),
        ]
        if any(one.quantity in PANELS for one in largest):
            entries.append(LegendEntry(circled("1"), "largest changes, as listed"))
        keys: list[Key] = [
            ColourBar("belief: B - A", scale, ends, ("less wall", "more wall")),
            ColourBar("plausibility: B - A", scale, ends, ("denies more", "denies less")),
            Group(entries),
        ]
        subtitle = f"A: {names[0]}; B: {names[1]}; {resolution:g} m per cell"
        if self.raster.shrink > 1:
            shrink = self.raster.shrink
            subtitle += f"; a pixel is the largest change of {shrink} x {shrink} cells"
        return framed(panels, keys, f"{names[0]} -> {names[1]}", subtitle, resolution)


def raster_for(window: Window, exact: bool) -> Raster:
    """Choose how the panels are drawn; ``exact``: without a margin."""
    return furnished_raster(window, exact, None, LONGEST)


@cache
def table() -> Table:
    """Return the 256 colours of a panel."""
    less = palettes.ramp((palettes.PAPER, *palettes.FREE_STOPS), _STEPS + 1)
    more = palettes.ramp((palettes.PAPER, *palettes.WALL_STOPS), _STEPS + 1)
    colours: Table = np.rint(np.vstack([less[::-1], more[1:], [palettes.UNKNOWN]])).astype(np.uint8)
    return colours


def _paint(
    image: Image.Image, marks: Sequence[tuple[int, Place]], raster: Raster, resolution: float
) -> None:
    """Draw numbers in circles beside places, with lines to them, so that they hide no change there.

    A number that would lie over an earlier one is left out.
    """
    if not marks:
        return
    sheet = Image.new("RGBA", (image.width * _FINE, image.height * _FINE))
    draw = ImageDraw.Draw(sheet)
    ink, paper = (*palettes.INK, 255), (*palettes.PAPER, 255)
    dot, circle = 2 * _FINE, _RADIUS * _FINE
    taken: list[Place] = []
    for number, place in marks:
        x, y = raster.to_pixel(*place, resolution)
        u = x + (_AWAY if x + _AWAY + _RADIUS < image.width else -_AWAY)
        v = y + (-_AWAY if y - _AWAY - _RADIUS > 0 else _AWAY)
        if any(math.dist((u, v), other) <= 2 * _RADIUS + 1 for other in taken):
            continue
        taken.append((u, v))
        x, y, u, v = (at * _FINE for at in (x, y, u, v))
        draw.line((x, y, u, v), paper, 3 * _FINE)
        draw.line((x, y, u, v), ink, _FINE)
        draw.ellipse((x - dot, y - dot, x + dot, y + dot), ink, paper, _FINE)
        draw.ellipse((u - circle, v - circle, u + circle, v + circle), paper, ink, _FINE)
        letters = font(round((1.4 if number < 10 else 1.1) * circle))
        draw.text((u, v), str(number), ink, letters, "mm")
    sheet = sheet.resize(image.size, Image.Resampling.BOX)
    image.paste(sheet, (0, 0), sheet)
