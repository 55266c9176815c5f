"""The ``.npz`` and ``.csv`` exports: what every cell is worth, in numbers."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.exports.job import Job, bands, tidy

ARRAYS = {"necessity": 0, "possibility": 1, "belief": 0, "plausibility": 1, "pignistic_logit": 0}
"""What is written, with its value where nothing is known."""


def write_npz(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write each of ARRAYS, shape (rows, columns), ``origin`` [m] and ``resolution`` [m].

    Row 0 is the lowest y; ``origin`` is the lower left corner of cell [0, 0]. The archive's comment
    holds the rest, so that there are no other arrays. The same grid gives the same bytes.
    """
    with zipfile.ZipFile(streams[0], "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.comment = "\n".join(f"{key}: {fact}" for key, fact in job.facts().items()).encode()
        for name, unknown in ARRAYS.items():
            _layer(archive, job, name, unknown)
        _small(archive, "origin", np.array(job.grid.origin(job.window)))
        _small(archive, "resolution", np.array(job.grid.resolution))


def _layer(archive: zipfile.ZipFile, job: Job, name: str, unknown: int) -> None:
    with archive.open(_member(name), "w", force_zip64=True) as member:
        header = {"descr": "<f4", "fortran_order": False, "shape": job.window.shape}
        npy.write_array_header_1_0(member, header)
        for band in bands(job.window):
            values = job.filled(band, lambda area: job.grid.view(name, area), unknown, "<f4")
            member.write(values.tobytes())


def _small(archive: zipfile.ZipFile, name: str, array: np.ndarray[tuple[int, ...]]) -> None:
    with archive.open(_member(name), "w") as member:
        npy.write_array(member, array)


def _member(name: str) -> zipfile.ZipInfo:
    """Return a member that says nothing of when it was written."""
    member = zipfile.ZipInfo(f"{name}.npy")
    member.compress_type = zipfile.ZIP_DEFLATED  # else most of a wide site is zeros on the disk
    return member


VALUES = ("necessity", "possibility", "belief", "plausibility", "points")
COLUMNS = ",".join(("row", "column", "x", "y", *VALUES))
_AT_ONCE = 1 << 18
"""Cells that are looked at together: each may become a line, kept until its row is written."""


def write_cells(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write a comment for each fact, a head, then the cells by row and column.

    Rows and columns are those of the grid's lattice, x and y [m] a cell's centre.
    """
    out = streams[0]
    out.write(f"{job.comments()}{COLUMNS}\n".encode())
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
        some = job.known(area)
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
