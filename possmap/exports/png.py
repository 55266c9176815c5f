"""The ``.png`` export, a layer in 16 bits: PNG written a few rows at a time, never held whole."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.core.views import NOTHING, VIEWS, CellArray
from possmap.exports.job import Job, bands, tidy

GRAY_16 = (16, 0)
RGBA_8 = (8, 6)

_NONE, _UP = 0, 2


def text_chunks(job: Job) -> dict[str, str]:
    """Return what an image says of itself, under the names that ``possmap render`` has too."""
    facts, (x, y), (rows, columns) = job.facts(), job.origin, job.window.shape
    return {
        "Software": f"possmap {facts['possmap']}",
        "possmap:digest": facts["digest"],
        "possmap:resolution": repr(job.grid.resolution),
        "possmap:frame": facts["frame"],
        "possmap:origin": f"{x!r},{y!r}",
        "possmap:cells": f"{columns}x{rows}",
    }


def write_rows(
    stream: BinaryIO,
    size: tuple[int, int],
    kind: tuple[int, int],
    text: Mapping[str, str],
    pieces: Iterable[tuple[bool, NDArray[Any]]],
) -> None:
    """Write an image; the same pixels give the same bytes.

    Parameters
    ----------
    size
        Columns and rows.
    kind
        ``GRAY_16`` or ``RGBA_8``.
    text
        tEXt chunks, Latin-1.
    pieces
        Pixels from the highest row down, shape (rows, columns) or (rows, columns, 4): whole rows,
        or pieces of one row; with each, whether it begins a row.
    """
    stream.write(b"\x89PNG\r\n\x1a\n")
    _chunk(stream, b"IHDR", struct.pack(">IIBBBBB", *size, *kind, 0, 0, 0))
    for key, value in text.items():
        _chunk(stream, b"tEXt", f"{key}\0{value}".encode("latin-1"))
    packer = zlib.compressobj(6)
    for begins_row, pixels in pieces:
        _chunk(stream, b"IDAT", packer.compress(_filtered(pixels, begins_row)))
    _chunk(stream, b"IDAT", packer.flush())
    _chunk(stream, b"IEND", b"")


def _filtered(pixels: NDArray[Any], begins_row: bool) -> bytes:
    """Return rows as PNG filters them: the first as it is, the others as differences upwards."""
    rows = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder(">"))
    octets = rows.view(np.uint8).reshape(len(pixels), -1)
    if not begins_row:
        return octets.tobytes()
    found = np.empty((len(octets), octets.shape[1] + 1), dtype=np.uint8)
    found[:, 0] = _UP
    found[0, 0] = _NONE
    found[0, 1:] = octets[0]
    np.subtract(octets[1:], octets[:-1], out=found[1:, 1:])
    return found.tobytes()


def _chunk(stream: BinaryIO, kind: bytes, data: bytes) -> None:
    stream.write(struct.pack(">I", len(data)) + kind + data)
    stream.write(struct.pack(">I", zlib.crc32(kind + data)))


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
    write_rows(image, (columns, rows), GRAY_16, text, _pixels(job))
    world.write(_world(job).encode())


def _pixels(job: Job) -> Iterator[tuple[bool, NDArray[Any]]]:
    layer, base_rate = job.choices.layer, job.choices.base_rate

    def value(area: Window) -> NDArray[np.uint16]:
        return _sixteen_bits(job.grid.view(layer, area, base_rate))

    unknown = np.zeros(1) if layer == "points" else VIEWS[layer](NOTHING, base_rate)
    for band in bands(job.window, from_top=True):
        pixels = job.filled(band, value, int(_sixteen_bits(unknown)[0]), np.uint16)
        yield band.column0 == job.window.column0, pixels[::-1]


def _sixteen_bits(values: CellArray) -> NDArray[np.uint16]:
    return np.rint(FULL * values).astype(np.uint16)


def _world(job: Job) -> str:
    """Return a world file: a pixel's sides, and the centre of the upper left one [m]."""
    c = job.grid.resolution
    x, y = job.grid.lattice.centre_of(job.window.row1 - 1, job.window.column0)
    off_x, off_y = job.choices.offset
    place = tidy(x + off_x), tidy(y + off_y)
    return "".join(f"{line!r}\n" for line in (c, 0.0, 0.0, -c, *place))
