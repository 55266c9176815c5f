"""What is drawn over the cells: singular points, homes, tracks, and the true walls where known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from possmap.core.pyramid import Floats, Ints
from possmap.grid.grid import Grid
from possmap.pictures import palettes
from possmap.pictures.legend import cross, diamond
from possmap.pictures.raster import Raster
from possmap.pictures.text import font

Place = tuple[float, float]
"""x, y [m]."""

HOME_M = 1.0
"""Robots that set out so near to each other set out from one home [m]."""

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
    fixes : where somebody knew that robots truly were.
    """

    points: Sequence[tuple[Place, float]] = ()
    homes: Sequence[Place] = ()
    tracks: Sequence[tuple[str, Sequence[Sequence[Place]]]] = ()
    truth: Sequence[tuple[float, float, float, float]] = ()
    fixes: Sequence[Place] = ()

    def robot_colours(self) -> list[tuple[str, palettes.Colour]]:
        """Return the colour of each robot's track."""
        return [(robot, palettes.robot(k)) for k, (robot, _) in enumerate(self.tracks)]


class Marks:
    """The places of corners, homes and tracks in a picture, gathered once.

    Of corners a pixel shows one, the most certain; of tracks it shows what goes on to another
    pixel: a site has more of both than pixels.

    tracks : whether the tracks are wanted too.
    """

    def __init__(self, grid: Grid, raster: Raster, tracks: bool) -> None:
        self._raster, self._resolution = raster, grid.resolution
        x0, y0 = grid.lattice.corner_of(raster.window.row0, raster.window.column0)
        x1, y1 = grid.lattice.corner_of(raster.window.row1, raster.window.column1)
        window = x0, y0, x1, y1
        self._entries = {entry.identity: entry for entry in grid.ledger.entries()}
        self._corners = grid.ledger.places("corner", window)
        self._homes = grid.ledger.first_poses(window)
        poses = grid.ledger.places("pose") if tracks else self._homes[:0]
        self._fixes = grid.ledger.fixes(window) if tracks else self._homes[:0]
        self._tracks = np.split(poses, np.flatnonzero(np.diff(poses[:, 0])) + 1) if tracks else []

    def known(self, records: Mapping[int, int]) -> Overlays:
        """Return what is drawn of so many records of each excursion, by its id in the ledger."""
        points: dict[tuple[int, int], tuple[Place, float]] = {}
        pixels = self._pixels(self._corners).tolist()
        for (identity, number, *at), pixel in zip(self._corners.tolist(), pixels, strict=True):
            if number < records.get(int(identity), 0):
                x, y, half_x, half_y = at
                certain = 1 - max(half_x, half_y) / self._entries[int(identity)].model.max_error
                if certain > 0 and certain > points.get(tuple(pixel), (None, 0.0))[1]:
                    points[tuple(pixel)] = (x, y), certain
        homes: dict[tuple[float, float], Place] = {}
        for identity, number, x, y, *_ in self._homes.tolist():
            if number < records.get(int(identity), 0):
                homes.setdefault((round(x / HOME_M), round(y / HOME_M)), (x, y))
        tracks: dict[str, list[list[Place]]] = {}
        for places in self._tracks:
            entry = self._entries[int(places[0, 0])]
            some = places[places[:, 1] < records.get(entry.identity, 0)]
            # A robot has a colour of its own, whether it has come or not.
            tracks.setdefault(entry.robot, []).append(self._thinned(some))
        fixes = [
            (x, y)
            for identity, number, x, y, *_ in self._fixes.tolist()
            if number < records.get(int(identity), 0)
        ]
        return Overlays([*points.values()], [*homes.values()], sorted(tracks.items()), fixes=fixes)

    def _thinned(self, places: Floats) -> list[Place]:
        pixels = self._pixels(places)
        moved = np.ones(len(places), dtype=np.bool_)
        moved[1:] = (pixels[1:] != pixels[:-1]).any(axis=1)
        return [(x, y) for x, y in places[moved, 2:4].tolist()]

    def _pixels(self, places: Floats) -> Ints:
        """Return the column and row of the pixel in which each place lies."""
        x, y = self._raster.to_pixel(places[:, 2], places[:, 3], self._resolution)
        found: Ints = np.floor(np.stack([x, y], axis=1)).astype(np.int64)
        return found


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
    if not (overlays.points or overlays.homes or overlays.truth or overlays.fixes):
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
    for place in overlays.fixes:
        cross(draw, *at(place), 3.0 * fine, palettes.INK, round(1.3 * fine))
    radius = min(9.0, max(5.0, max(width, height) / 70)) * fine
    # On a map of kilometres the sign would hide all that is known around it.
    ground = 190 if raster.pixels_per_metre(resolution) > 8 else 0
    for place in overlays.homes:
        x, y = at(place)
        circle = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(circle, (*palettes.PAPER, ground), (*palettes.INK, 255), fine)
        draw.text((x, y), "I", (*palettes.INK, 255), font(round(1.5 * radius)), "mm")
    yield sheet
