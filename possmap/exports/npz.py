"""The ``.npz`` export: N and Π as float32 arrays, written band by band whatever the size."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from possmap.core.lattice import Window
from possmap.core.views import CellArray
from possmap.exports.job import Job

CELLS_AT_ONCE = 1 << 20
"""Cells in memory, whatever the window's shape."""


def write_npz(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``necessity`` and ``possibility`` (rows, columns), ``origin`` [m] and ``resolution``.

    Row 0 is the lowest y; ``origin`` is the lower left corner of cell [0, 0]. The archive's comment
    holds the rest, so that the arrays stay these four. The same grid gives the same bytes.
    """
    grid, window = job.grid, job.window
    with zipfile.ZipFile(streams[0], "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.comment = "\n".join(f"{key}: {fact}" for key, fact in job.facts().items()).encode()
        _layer(archive, "necessity", window, grid.necessity)
        _layer(archive, "possibility", window, grid.possibility)
        _small(archive, "origin", np.array(grid.origin(window)))
        _small(archive, "resolution", np.array(grid.resolution))


def _layer(
    archive: zipfile.ZipFile, name: str, window: Window, read: Callable[[Window], CellArray]
) -> None:
    with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
        header = {"descr": "<f4", "fortran_order": False, "shape": window.shape}
        npy.write_array_header_1_0(member, header)
        for band in window.bands(CELLS_AT_ONCE):
            member.write(read(band).astype("<f4").tobytes())


def _small(archive: zipfile.ZipFile, name: str, array: np.ndarray[tuple[int, ...]]) -> None:
    with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as member:
        npy.write_array(member, array)
