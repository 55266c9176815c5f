"""The ``.yaml`` export: a map as ROS's map_server reads it, with its image beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.errors import OutputError, printable
from possmap.exports.job import Choices, Job, bands
from possmap.exports.png import RGBA_8, text_chunks, write_rows

UNKNOWN = -1


class Thresholds(NamedTuple):
    """From which darkness on, above ``occupied`` or below ``free``, map_server sees a cell so."""

    occupied: float
    free: float


THRESHOLDS = {
    # What map_server's own maps have: its unknown, 205, is just dark enough not to be free.
    "trinary": Thresholds(0.65, 0.196),
    # All that is neither black nor white is scaled, in ROS 1 and 2 alike.
    "scale": Thresholds(0.99, 0.01),
    # Not looked at.
    "raw": Thresholds(0.65, 0.196),
}


def image_beside(output: Path, choices: Choices) -> tuple[Path, ...]:
    """Return the image's path: PNG in mode scale, whose unknown is transparent, which PGM lacks."""
    return (output.with_suffix(".png" if choices.mode == "scale" else ".pgm"),)


def write_ros_map(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``map.yaml`` and the image, the first row the highest y.

    Raises
    ------
    OutputError
        If YAML cannot hold the image's name.
    """
    description, image = streams
    description.write(_description(job).encode())
    rows, columns = job.window.shape
    if job.choices.mode == "scale":
        write_rows(image, (columns, rows), RGBA_8, text_chunks(job), _pixels(job))
        return
    image.write(f"P5\n{job.comments()}{columns} {rows}\n255\n".encode())
    for _, pixels in _pixels(job):
        image.write(pixels.tobytes())


def _description(job: Job) -> str:
    image, mode = job.outputs[1].name, job.choices.mode
    try:
        image.encode()
    except UnicodeEncodeError:
        output = printable(str(job.outputs[0]))
        raise OutputError(f"{output}: its name is not UTF-8, expected one for YAML") from None
    x, y = job.origin
    keys = {
        "image": image,
        "mode": mode,
        "resolution": job.grid.resolution,
        "origin": [x, y, 0.0],
        "negate": 0,
        "occupied_thresh": THRESHOLDS[mode].occupied,
        "free_thresh": THRESHOLDS[mode].free,
    }
    otherwise = "unknown"
    if mode != "trinary":
        otherwise = (
            f"1 to 99 for the probability at base rate {job.choices.base_rate:g}; "
            "unknown without evidence"
        )
    written = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None, width=10**9)
    return job.comments(job.thresholds(otherwise)) + written


def _pixels(job: Job) -> Iterator[tuple[bool, NDArray[Any]]]:
    table = pixel_of(job.choices.mode)
    for band in bands(job.window, from_top=True):
        told = job.filled(band, partial(percent, job), UNKNOWN, np.int8)[::-1]
        yield band.column0 == job.window.column0, table[told + 1]


def percent(job: Job, area: Window) -> NDArray[np.int8]:
    """Return the cells of an OccupancyGrid: 0 free … 100 occupied, -1 unknown."""
    choices, occupied, free = job.choices, job.occupied(area), job.free(area)
    found = np.where(occupied, np.int8(100), np.where(free, np.int8(0), np.int8(UNKNOWN)))
    if choices.mode != "trinary":
        between = ~occupied & ~free & job.known(area)
        likely = job.grid.view("probability", area, choices.base_rate)[between]
        found[between] = np.clip(np.rint(100 * likely), 1, 99).astype(np.int8)
    return found


def pixel_of(mode: str) -> NDArray[np.uint8]:
    """Return the pixels of unknown, 0, 1 … 100 per cent: the inverse of what map_server does.

    Shape (102,), or (102, 4) for ``scale``: red, green, blue, opacity.
    """
    levels = np.arange(101)
    if mode == "raw":
        return np.concatenate([[255], levels]).astype(np.uint8)
    if mode == "trinary":
        shades = np.full(102, 205, dtype=np.uint8)
        shades[1], shades[101] = 254, 0
        return shades
    occupied, free = THRESHOLDS[mode]
    darkness = free + levels / 100 * (occupied - free)
    darkness[0], darkness[100] = 0, 1
    shade = np.rint(255 * (1 - darkness))
    pixels = np.empty((102, 4), dtype=np.uint8)
    # ROS 1 looks at transparency only where the shade lies between the thresholds.
    pixels[0] = (128, 128, 128, 0)
    pixels[1:, :3] = shade[:, None]
    pixels[1:, 3] = 255
    return pixels
