"""What is drawn over the cells: singular points, home, tracks, and the true walls where known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw

from possmap.pictures import palettes
from possmap.pictures.keys import diamond
from possmap.pictures.raster import Raster
from possmap.pictures.text import font

Place = tuple[float, float]
"""x, y [m]."""

_FINE = 2
"""Lines are drawn so much larger and then reduced: smooth, without a drawing library."""
_FINE_PIXELS = 16_000_000
_STRIP = 256
"""Rows that are reduced together [pixels]."""


@dataclass(frozen=True)
class Overlays:
    """Things with places in metres.

    points : singular points, each with its certainty in [0, 1].
    homes : where excursions began.
    tracks : robot -> the corrected places of each of its excursions.
    truth : true walls, as x, y, x2, y2.
    """

    points: Sequence[tuple[Place, float]] = ()
    homes: Sequence[Place] = ()
    tracks: Sequence[tuple[str, Sequence[Sequence[Place]]]] = ()
    truth: Sequence[tuple[float, float, float, float]] = ()

    def robot_colours(self) -> list[tuple[str, palettes.Colour]]:
        """Return the colour of each robot's track."""
        return [(robot, palettes.robot(k)) for k, (robot, _) in enumerate(self.tracks)]


def paint(image: Image.Image, overlays: Overlays, raster: Raster, resolution: float) -> None:
    """Draw the overlays over a picture of the raster's cells, in place."""
    if not (overlays.points or overlays.homes or overlays.tracks or overlays.truth):
        return
    width, height = image.size
    fine = _FINE if width * height * _FINE**2 <= _FINE_PIXELS else 1
    sheet = Image.new("RGBA", (width * fine, height * fine))
    draw = ImageDraw.Draw(sheet)

    def at(place: Place) -> tuple[float, float]:
        x, y = raster.to_pixel(*place, resolution)
        return x * fine, y * fine

    for x, y, x2, y2 in overlays.truth:
        draw.line((*at((x, y)), *at((x2, y2))), (*palettes.TRUTH, 255), round(1.5 * fine))
    colours = [colour for _, colour in overlays.robot_colours()]
    for (_, excursions), colour in zip(overlays.tracks, colours, strict=True):
        for places in excursions:
            if len(places) > 1:
                casing = (*palettes.PAPER, 150)
                draw.line([at(place) for place in places], casing, round(3 * fine), "curve")
                draw.line(
                    [at(place) for place in places], (*colour, 235), round(1.6 * fine), "curve"
                )
    largest = min(4.5, max(1.5, 0.12 * raster.pixels_per_metre(resolution)))
    for place, certainty in sorted(overlays.points, key=lambda point: point[1]):
        alpha = round(60 + 195 * certainty)
        size = (0.45 + 0.55 * certainty) * largest * fine
        diamond(draw, *at(place), size, (*palettes.POINT, alpha), (*palettes.PAPER, alpha))
    radius = min(9.0, max(5.0, max(width, height) / 70)) * fine
    # On a map of kilometres the sign would hide all that is known around it.
    ground = 190 if raster.pixels_per_metre(resolution) > 8 else 0
    for place in overlays.homes:
        x, y = at(place)
        circle = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(circle, (*palettes.PAPER, ground), (*palettes.INK, 255), fine)
        draw.text((x, y), "I", (*palettes.INK, 255), font(round(1.5 * radius)), "mm")
    for top in range(0, height, _STRIP):  # reducing takes as much again as what is reduced
        bottom = min(height, top + _STRIP)
        part = sheet.crop((0, top * fine, width * fine, bottom * fine))
        if fine > 1:
            part = part.resize((width, bottom - top), Image.Resampling.BOX)
        image.paste(part, (0, top), part)
