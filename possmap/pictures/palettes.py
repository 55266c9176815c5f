"""Colours: of values, of the map, of what is unknown; and images of indices into them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

Colour: TypeAlias = tuple[int, int, int]
Table: TypeAlias = NDArray[np.uint8]
"""Colours by index, shape (entries, 3)."""
Indices: TypeAlias = NDArray[np.uint8]
"""One palette index per block, shape (rows, columns), the first row the highest y."""

UNKNOWN: Colour = (232, 231, 226)
"""A neutral tone that no palette of values contains."""
UNKNOWN_BESIDE_GRAY: Colour = (196, 219, 240)
"""The same where values are grey themselves."""

INK: Colour = (38, 38, 42)
FAINT: Colour = (120, 120, 126)
PAPER: Colour = (255, 255, 255)
CONTESTED: Colour = (255, 214, 10)
POINT: Colour = (0, 135, 110)
TRUTH: Colour = (20, 20, 20)

_ROBOTS: tuple[Colour, ...] = (
    (208, 30, 130), (98, 50, 180), (35, 130, 60), (120, 130, 0), (110, 110, 118), (255, 80, 80),
    (0, 150, 170), (178, 130, 255), (130, 0, 40), (90, 200, 60), (0, 205, 210), (95, 70, 20),
)  # fmt: skip


def robot(number: int) -> Colour:
    """Return the colour of a robot's track; after twelve they begin again."""
    return _ROBOTS[number % len(_ROBOTS)]


FREE_STOPS: tuple[Colour, ...] = ((196, 216, 234), (140, 182, 219), (92, 147, 198))
"""Free space: the darker, the smaller the plausibility of a wall."""
WALL_STOPS: tuple[Colour, ...] = ((248, 216, 184), (240, 160, 90), (190, 76, 24), (74, 20, 8))
"""A wall: the lighter, the smaller the belief in it."""
PAPER_FREE_STOPS: tuple[Colour, ...] = ((215, 215, 215), (90, 90, 90), (30, 30, 30))
PAPER_WALL_STOPS: tuple[Colour, ...] = ((245, 245, 245), (128, 128, 128))
PAPER_POINT: Colour = (190, 190, 190)


@cache
def table(name: str) -> Table:
    """Return the 256 colours of a palette of values, from 0 to 1."""
    if name == "gray":
        return np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    lines = Path(__file__).with_name("palettes.txt").read_text(encoding="ascii").splitlines()
    start = lines.index(name) + 1
    colours = " ".join(lines[start : start + 16]).split()
    return np.array([list(bytes.fromhex(colour)) for colour in colours], dtype=np.uint8)


def unknown(name: str) -> Colour:
    """Return the tone of what is unknown beside a palette."""
    return UNKNOWN_BESIDE_GRAY if name == "gray" else UNKNOWN


def ramp(stops: Sequence[Colour] | Table, count: int) -> NDArray[np.float64]:
    """Return ``count`` colours evenly between stops, shape (count, 3), 0 to 255."""
    at = np.linspace(0, len(stops) - 1, count)
    channels = np.array(stops, dtype=float).T
    return np.stack([np.interp(at, np.arange(len(stops)), c) for c in channels], axis=1)


def image_of(index: Indices, scale: int, table: Table | None = None) -> Image.Image:
    """Return an image, ``scale`` pixels for each entry; without a table of colours in greys."""
    if scale > 1:
        index = np.repeat(np.repeat(index, scale, axis=0), scale, axis=1)
    image = Image.fromarray(np.ascontiguousarray(index))
    if table is not None:
        image.putpalette(table.tobytes())
    return image


def write_png(image: Image.Image, stream: BinaryIO, text: Mapping[str, str]) -> None:
    """Write an image with tEXt metadata; the same image gives the same bytes."""
    info = PngInfo()
    for key, value in text.items():
        info.add_text(key, value)
    image.save(stream, "PNG", pnginfo=info, compress_level=6)
