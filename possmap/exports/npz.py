"""The ``.npz`` export: readouts as float32 arrays, written band by band whatever the size."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from possmap.exports.cells import filled
from possmap.exports.job import Job

ARRAYS = {"necessity": 0, "possibility": 1, "belief": 0, "plausibility": 1, "pignistic_logit": 0}
"""What is written, with its value where nothing is known."""
CELLS_AT_ONCE = 1 << 20
"""Cells in memory, whatever the window's shape."""


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
        for band in job.window.bands(CELLS_AT_ONCE):
            values = filled(job.grid, band, lambda area: job.grid.view(name, area), unknown, "<f4")
            member.write(values.tobytes())


def _small(archive: zipfile.ZipFile, name: str, array: np.ndarray[tuple[int, ...]]) -> None:
    with archive.open(_member(name), "w") as member:
        npy.write_array(member, array)


def _member(name: str) -> zipfile.ZipInfo:
    """Return a member that says nothing of when it was written."""
    member = zipfile.ZipInfo(f"{name}.npy")
    member.compress_type = zipfile.ZIP_DEFLATED  # else most of a wide site is zeros on the disk
    return member
