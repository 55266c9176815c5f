"""The ``.csv`` export: one line for each cell that holds evidence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.exports.bands import bands
from possmap.exports.job import Job, tidy

COLUMNS = "row,column,x,y,necessity,possibility,points"
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
            for line in _lines(job, strip):
                out.write(line.encode())


def _lines(job: Job, band: Window) -> Iterator[str]:
    """Yield the lines of a row at a time, of one stretch of tiles beside the other."""
    areas = list(job.grid.tiles.areas(band))
    values = [_texts(job, area) for area in areas]
    lattice = job.grid.lattice  # to ask the grid reads its settings
    for row in range(band.row0, band.row1):
        _, y = lattice.centre_of(row, 0)
        head, tail = f"{row},", f",{tidy(y)!r},"
        for area, (columns, first, known, numbers) in zip(areas, values, strict=True):
            at = row - area.row0
            if not 0 <= at < area.shape[0]:
                continue
            begin, end = first[at], first[at + 1]
            yield "".join(
                [
                    f"{head}{columns[column]}{tail}{number}\n"
                    for column, number in zip(known[begin:end], numbers[begin:end], strict=True)
                ]
            )


def _texts(job: Job, area: Window) -> tuple[list[str], list[int], list[int], list[str]]:
    """Return an area's columns as text, and of each known cell its column and numbers.

    With them, where in these lists each row begins, and the end.
    """
    grid, lattice = job.grid, job.grid.lattice
    layers = (grid.necessity(area), grid.possibility(area), grid.points(area))
    necessity, possibility, points = layers
    known = (necessity > 0) | (possibility < 1) | (points > 0)
    rows, columns = np.nonzero(known)
    first = np.searchsorted(rows, np.arange(area.shape[0] + 1)).tolist()
    parts = [_decimals(layer[known]) for layer in layers]
    numbers = [f"{n},{p},{s}" for n, p, s in zip(*parts, strict=True)]
    names = [
        f"{column},{tidy(lattice.centre_of(0, column)[0])!r}"
        for column in range(area.column0, area.column1)
    ]
    return names, first, columns.tolist(), numbers


def _decimals(values: NDArray[np.float64]) -> list[str]:
    """Return numbers as text; equal ones, of which there are many, are written once."""
    distinct, which = np.unique(values, return_inverse=True)
    texts = [f"{value:.9g}" for value in distinct.tolist()]
    return [texts[index] for index in which.tolist()]
