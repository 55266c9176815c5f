"""What is drawn over the cells: singular points, homes, tracks, and the true walls where known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw

from possmap.pictures import palettes
from possmap.pictures.legend import diamond
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


class Thinned:
    """Places of which a picture shows one a pixel: a site has more corners than pixels."""

    def __init__(self, raster: Raster, resolution: float) -> None:
        self._raster, self._resolution = raster, resolution
        self._kept: dict[tuple[int, int], tuple[Place, float]] = {}

    def add(self, place: Place, certainty: float) -> None:
        """Add a point with its certainty in [0, 1]; in a pixel the most certain stays."""
        at = pixel_of(self._raster, place, self._resolution)
        if at not in self._kept or certainty > self._kept[at][1]:
            self._kept[at] = place, certainty

    def all(self) -> list[tuple[Place, float]]:
        """Return the points kept."""
        return list(self._kept.values())


def pixel_of(raster: Raster, place: Place, resolution: float) -> tuple[int, int]:
    """Return the column and row of the pixel in which a place lies."""
    x, y = raster.to_pixel(*place, resolution)
    return int(x // 1), int(y // 1)


def paint(image: Image.Image, overlays: Overlays, raster: Raster, resolution: float) -> None:
    """Draw the overlays over a picture of the raster's cells, in place.

    Tracks let through what is below them, however many lie over each other.
    """
    width, height = image.size
    fine = _FINE if width * height * _FINE**2 <= _FINE_PIXELS else 1
    for sheet in _sheets(overlays, raster, resolution, fine):
        for top in range(0, height, _STRIP):  # reducing takes as much again as what is reduced
            bottom = min(height, top + _STRIP)
            part = sheet.crop((0, top * fine, width * fine, bottom * fine))
            if fine > 1:
                part = part.resize((width, bottom - top), Image.Resampling.BOX)
            image.paste(part, (0, top), part)


def _sheets(
    overlays: Overlays, raster: Raster, resolution: float, fine: int
) -> Iterator[Image.Image]:
    """Yield transparent sheets, first what lies lowest."""
    width, height = raster.size

    def at(place: Place) -> tuple[float, float]:
        x, y = raster.to_pixel(*place, resolution)
        return x * fine, y * fine

    def blank() -> Image.Image:
        return Image.new("RGBA", (width * fine, height * fine))

    if overlays.tracks:
        sheet = blank()
        draw = ImageDraw.Draw(sheet)
        for (_, colour), (_, excursions) in zip(
            overlays.robot_colours(), overlays.tracks, strict=True
        ):
            for places in excursions:
                if len(places) > 1:
                    line = [at(place) for place in places]
                    draw.line(line, (*colour, 125), round(1.3 * fine), "curve")
        yield sheet
    if not (overlays.points or overlays.homes or overlays.truth):
        return
    sheet = blank()
    draw = ImageDraw.Draw(sheet)
    for x, y, x2, y2 in overlays.truth:
        draw.line((*at((x, y)), *at((x2, y2))), (*palettes.TRUTH, 255), round(1.5 * fine))
    largest = min(4.0, max(1.5, 0.1 * raster.pixels_per_metre(resolution)))
    for place, certainty in sorted(overlays.points, key=lambda point: point[1]):
        alpha = round(40 + 200 * certainty)
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
    yield sheet
