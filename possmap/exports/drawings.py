"""The ``.svg`` and ``.dxf`` exports: walls, sightings and tracks as a drawing, a layer each."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any, BinaryIO

from possmap.errors import brief
from possmap.exports.job import Job, library, tidy
from possmap.exports.outline import Polygon, metres, outlines

MM_PER_M = 10.0
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def write_svg(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write a drawing whose user unit is a metre, from the window's upper left corner.

    Coordinates count from there, not from the site's origin: drawing programs keep 32-bit floats.

    Raises
    ------
    OutputError
        If the outlines are too long for memory.
    """
    out = streams[0]
    rows, columns = job.window.shape
    c = job.grid.resolution
    width, height = tidy(columns * c), tidy(rows * c)
    thin, pixel = max(width, height) / 1500, c / 3
    said = "\n".join(f"{key}: {fact}" for key, fact in _facts(job))

    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="{INKSCAPE}" version="1.1"',
        f'  width="{_decimal(width * MM_PER_M)}mm" height="{_decimal(height * MM_PER_M)}mm" '
        f'viewBox="0 0 {_decimal(width)} {_decimal(height)}">',
        f"<desc>{escape(said)}</desc>",
    ]
    drawn = _Drawing(job, height)
    area, stroke = "stroke:none;fill-rule:evenodd", "fill:none;stroke:{};stroke-width:{};{}"
    for name, look, elements in (
        ("known", f"fill:#e4e4e4;{area}", drawn.areas(outlines(job, job.known))),
        ("walls", f"fill:#8c510a;{area}", drawn.areas(outlines(job, job.occupied))),
        (
            "tracks",
            stroke.format("#2166ac", _decimal(thin), "stroke-linejoin:round"),
            drawn.tracks(),
        ),
        (
            "sightings",
            stroke.format("#000", _decimal(min(thin, pixel)), "stroke-linecap:round"),
            drawn.sightings(),
        ),
    ):
        label = f'inkscape:groupmode="layer" inkscape:label="{name}"'
        lines.append(f'<g id="{name}" {label} style="{look}">')
        for text in (*lines, *elements, "</g>"):
            out.write(f"{text}\n".encode())
        lines.clear()
    out.write(b"</svg>\n")


class _Drawing:
    """The elements of each layer, y downwards from the top of a drawing of ``height`` metres."""

    def __init__(self, job: Job, height: float) -> None:
        self._job, self._height = job, height
        self._x, self._y = job.origin

    def areas(self, shapes: Sequence[Polygon]) -> Iterator[str]:
        for shape in shapes:
            rings = (metres(self._job, ring, local=True) for ring in (shape.shell, *shape.holes))
            path = "".join(f"{self._path(ring)}z" for ring in rings)
            yield f'<path d="{path}"/>'

    def tracks(self) -> Iterator[str]:
        for outing in self._job.outings():
            if outing.poses:
                title = escape(f"{brief(outing.robot)} {brief(outing.excursion)}")
                path = self._path([self._local(at.x, at.y) for _, at in outing.poses])
                yield f'<path d="{path}"><title>{title}</title></path>'

    def sightings(self) -> Iterator[str]:
        for outing in self._job.outings():
            for _, at in outing.walls:
                path = self._path([self._local(at.x, at.y), self._local(at.x2, at.y2)])
                yield f'<path d="{path}"/>'

    def _local(self, x: float, y: float) -> tuple[float, float]:
        return x - self._x, y - self._y

    def _path(self, points: list[tuple[float, float]]) -> str:
        return "M" + "L".join(f"{_decimal(x)} {_decimal(self._height - y)}" for x, y in points)


def _facts(job: Job) -> list[tuple[str, str]]:
    walls = f"cells whose belief is {job.choices.occupied:g} or more"
    return [*job.facts().items(), ("walls", walls)]


def _decimal(value: float) -> str:
    """Return a number to the nanometre, without an exponent: not all programs read those."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


METRES = 6
"""$INSUNITS of a DXF file."""
_CROSS = 3
"""$PDMODE of points drawn as crosses."""

LAYERS = {"WALLS": 34, "SIGHTINGS": 7, "TRACKS": 5, "CORNERS": 1}
"""With their AutoCAD colours: brown, black on white, blue, red."""


def write_dxf(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write a drawing (DXF R2010) in metres of the site frame.

    The library keeps the drawing in memory; the cells are read band by band.

    Raises
    ------
    OutputError
        If ezdxf is not installed, or the walls are too long for memory.
    """
    ezdxf = library(job, "ezdxf", "dxf")
    drawing = ezdxf.new("R2010", units=METRES)
    for name, colour in LAYERS.items():
        drawing.layers.add(name, color=colour)
    for key, fact in _facts(job):
        drawing.header.custom_vars.append(f"possmap {key}", fact)
    space = drawing.modelspace()
    for shape in outlines(job, job.occupied):
        for ring in (shape.shell, *shape.holes):
            space.add_lwpolyline(metres(job, ring), close=True, dxfattribs={"layer": "WALLS"})
    for outing in job.outings():
        track = [(at.x, at.y) for _, at in outing.poses]
        if len(track) > 1:
            space.add_lwpolyline(track, dxfattribs={"layer": "TRACKS"})
        for _, at in outing.walls:
            ends = (at.x, at.y), (at.x2, at.y2)
            if ends[0] == ends[1]:
                space.add_point(ends[0], dxfattribs={"layer": "SIGHTINGS"})
            else:
                space.add_line(*ends, dxfattribs={"layer": "SIGHTINGS"})
        for _, at in outing.corners:
            space.add_point((at.x, at.y), dxfattribs={"layer": "CORNERS"})
    _show_all(drawing, job)
    text = io.TextIOWrapper(streams[0], encoding="utf-8", errors="dxfreplace", newline="\r\n")
    try:
        drawing.write(text)
    finally:
        text.detach()  # the stream is not ours to close


def _show_all(drawing: Any, job: Job) -> None:
    """Have programs open the drawing on all of it, wherever it lies, with points that are seen."""
    (x0, y0), (rows, columns), c = job.origin, job.window.shape, job.grid.resolution
    x1, y1 = x0 + columns * c, y0 + rows * c
    size = max(x1 - x0, y1 - y0)
    drawing.modelspace().reset_extents((x0, y0, 0), (x1, y1, 0))  # the library makes the header's
    drawing.header["$PDMODE"], drawing.header["$PDSIZE"] = _CROSS, max(2 * c, size / 100)
    drawing.set_modelspace_vport(1.1 * size, ((x0 + x1) / 2, (y0 + y1) / 2))
