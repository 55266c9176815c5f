"""The ``.svg`` export: walls and tracks as a drawing, one layer each, 1:100 on paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import BinaryIO

from possmap.errors import brief
from possmap.exports.features import Point, metres, outings, outline_of_evidence, outline_of_walls
from possmap.exports.job import Job, tidy
from possmap.exports.outline import Polygon

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
    facts = {**job.facts(), "walls": f"cells whose belief is {job.choices.occupied:g} or more"}
    said = "\n".join(f"{key}: {fact}" for key, fact in facts.items())

    def write(text: str) -> None:
        out.write(text.encode())

    write(
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="{INKSCAPE}" version="1.1"\n'
        f'  width="{_decimal(width * MM_PER_M)}mm" height="{_decimal(height * MM_PER_M)}mm" '
        f'viewBox="0 0 {_decimal(width)} {_decimal(height)}">\n'
        f"<desc>{escape(said)}</desc>\n"
    )
    drawn = _Drawing(job, height)
    for name, look, elements in (
        ("known", "fill:#e4e4e4;stroke:none;fill-rule:evenodd", drawn.known()),
        ("walls", "fill:#8c510a;stroke:none;fill-rule:evenodd", drawn.walls()),
        (
            "tracks",
            f"fill:none;stroke:#2166ac;stroke-width:{_decimal(thin)};stroke-linejoin:round",
            drawn.tracks(),
        ),
        (
            "sightings",
            f"fill:none;stroke:#000;stroke-width:{_decimal(min(thin, pixel))};stroke-linecap:round",
            drawn.sightings(),
        ),
    ):
        write(
            f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}" style="{look}">\n'
        )
        for element in elements:
            write(f"{element}\n")
        write("</g>\n")
    write("</svg>\n")


class _Drawing:
    """The elements of each layer, y downwards from the top of a drawing of ``height`` metres."""

    def __init__(self, job: Job, height: float) -> None:
        self._job = job
        self._height = height
        self._x, self._y = job.origin

    def known(self) -> Iterator[str]:
        return self._areas(outline_of_evidence(self._job))

    def walls(self) -> Iterator[str]:
        return self._areas(outline_of_walls(self._job))

    def _areas(self, shapes: Sequence[Polygon]) -> Iterator[str]:
        for shape in shapes:
            rings = (metres(self._job, ring, local=True) for ring in (shape.shell, *shape.holes))
            path = "".join(f"{self._path(ring)}z" for ring in rings)
            yield f'<path d="{path}"/>'

    def tracks(self) -> Iterator[str]:
        for outing in outings(self._job):
            if outing.poses:
                title = escape(f"{brief(outing.robot)} {brief(outing.excursion)}")
                path = self._path([self._local(at.x, at.y) for _, at in outing.poses])
                yield f'<path d="{path}"><title>{title}</title></path>'

    def sightings(self) -> Iterator[str]:
        for outing in outings(self._job):
            for _, at in outing.walls:
                path = self._path([self._local(at.x, at.y), self._local(at.x2, at.y2)])
                yield f'<path d="{path}"/>'

    def _local(self, x: float, y: float) -> Point:
        return x - self._x, y - self._y

    def _path(self, points: list[Point]) -> str:
        return "M" + "L".join(f"{_decimal(x)} {_decimal(self._height - y)}" for x, y in points)


def _decimal(value: float) -> str:
    """Return a number to the nanometre, without an exponent: not all programs read those."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
