"""The ``.dxf`` export: walls, sightings, tracks and corners, a layer each, in metres."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, BinaryIO

from possmap.exports.features import metres, outings, outline_of_walls
from possmap.exports.job import Job, library

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
    for key, fact in job.facts().items():
        drawing.header.custom_vars.append(f"possmap {key}", fact)
    drawing.header.custom_vars.append(
        "possmap walls", f"cells whose belief is {job.choices.occupied:g} or more"
    )
    space = drawing.modelspace()
    for shape in outline_of_walls(job):
        for ring in (shape.shell, *shape.holes):
            space.add_lwpolyline(metres(job, ring), close=True, dxfattribs={"layer": "WALLS"})
    for outing in outings(job):
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
    drawing.header["$EXTMIN"], drawing.header["$EXTMAX"] = (x0, y0, 0), (x1, y1, 0)
    drawing.header["$PDMODE"], drawing.header["$PDSIZE"] = _CROSS, 2 * c
    drawing.set_modelspace_vport(1.1 * max(x1 - x0, y1 - y0), ((x0 + x1) / 2, (y0 + y1) / 2))
