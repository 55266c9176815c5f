"""The ``.png`` export: one layer as numbers of 16 bits, with a world file that places it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.core.views import NOTHING, VIEWS, CellArray
from possmap.exports.bands import bands, filled
from possmap.exports.job import Job, tidy
from possmap.exports.png_stream import GRAY_16, text_chunks, write_png

FULL = 65535


def write_layer(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write values v as round(65535·v), the first row the highest y, and the world file."""
    image, world = streams
    window, choices = job.window, job.choices
    rows, columns = window.shape
    text = {
        **text_chunks(job),
        "possmap:view": choices.layer,
        "possmap:scale": f"value = pixel / {FULL}",
    }
    write_png(image, (columns, rows), GRAY_16, text, _pixels(job))
    world.write(_world(job).encode())


def _pixels(job: Job) -> Iterator[tuple[bool, NDArray[Any]]]:
    layer, base_rate = job.choices.layer, job.choices.base_rate

    def value(area: Window) -> NDArray[np.uint16]:
        return _sixteen_bits(job.grid.view(layer, area, base_rate))

    unknown = np.zeros(1) if layer == "points" else VIEWS[layer](NOTHING, base_rate)
    for band in bands(job.window, from_top=True):
        pixels = filled(job.grid, band, value, int(_sixteen_bits(unknown)[0]), np.uint16)
        yield band.column0 == job.window.column0, pixels[::-1]


def _sixteen_bits(values: CellArray) -> NDArray[np.uint16]:
    return np.rint(FULL * values).astype(np.uint16)


def _world(job: Job) -> str:
    """Return a world file: a pixel's sides, and the centre of the upper left one [m]."""
    c = job.grid.resolution
    x, y = job.grid.lattice.centre_of(job.window.row1 - 1, job.window.column0)
    return "".join(f"{line!r}\n" for line in (c, 0.0, 0.0, -c, tidy(x), tidy(y)))
