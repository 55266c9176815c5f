"""The ``.csv`` export: one line for each cell that holds evidence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.exports.cells import bands, known
from possmap.exports.job import Job, tidy

VALUES = ("necessity", "possibility", "belief", "plausibility", "points")
COLUMNS = ",".join(("row", "column", "x", "y", *VALUES))
_AT_ONCE = 1 << 18
"""Cells that are looked at together: each may become a line, kept until its row is written."""


def write_cells(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write a comment for each fact, a head, then the cells by row and column.

    Rows and columns are those of the grid's lattice, x and y [m] a cell's centre.
    """
    out = streams[0]
    for key, fact in job.facts().items():
        out.write(f"# {key}: {fact}\n".encode())
    out.write(f"{COLUMNS}\n".encode())
    for band in bands(job.window):
        # However wide the window, only its tiles count.
        cells = sum(area.cells for area in job.grid.tiles.areas(band))
        rows = max(1, band.shape[0] * _AT_ONCE // max(_AT_ONCE, cells))
        for row in range(band.row0, band.row1, rows):
            strip = replace(band, row0=row, row1=min(row + rows, band.row1))
            out.writelines(line.encode() for line in _lines(job, strip))


def _lines(job: Job, strip: Window) -> Iterator[str]:
    """Yield the lines of some rows, of one stretch of tiles beside the other."""
    places, values = [], []
    for area in job.grid.tiles.areas(strip):
        some = known(job.grid, area)
        rows, columns = np.nonzero(some)
        places.append(np.stack([rows + area.row0, columns + area.column0]))
        values.append(np.stack([job.grid.view(name, area)[some] for name in VALUES]))
    if not places:
        return
    row, column = np.concatenate(places, axis=1)
    order = np.lexsort((column, row))
    texts = [_decimals(one[order]) for one in np.concatenate(values, axis=1)]
    lattice = job.grid.lattice  # to ask the grid reads its settings
    heights = {at: lattice.centre_of(at, 0)[1] for at in set(row.tolist())}
    widths = {at: lattice.centre_of(0, at)[0] for at in set(column.tolist())}
    cells = zip(row[order].tolist(), column[order].tolist(), *texts, strict=True)
    for y, x, *numbers in cells:
        yield f"{y},{x},{tidy(widths[x])!r},{tidy(heights[y])!r},{','.join(numbers)}\n"


def _decimals(values: NDArray[np.float64]) -> list[str]:
    """Return numbers as text; equal ones, of which there are many, are written once."""
    distinct, which = np.unique(values, return_inverse=True)
    texts = [f"{value:.9g}" for value in distinct.tolist()]
    return [texts[index] for index in which.tolist()]
