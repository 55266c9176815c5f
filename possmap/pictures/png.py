"""Writing PNG: palette mode where it can be, with what the picture shows in its metadata."""

from __future__ import annotations

from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from possmap.pictures.layers import Indices
from possmap.pictures.palettes import Table


def palette_image(index: Indices, table: Table, scale: int) -> Image.Image:
    """Return an image in palette mode, ``scale`` pixels for each entry."""
    image = Image.fromarray(enlarged(index, scale))
    image.putpalette(table.tobytes())
    return image


def gray_image(values: Indices, scale: int) -> Image.Image:
    """Return an 8-bit grey image, ``scale`` pixels for each entry."""
    return Image.fromarray(enlarged(values, scale))


def enlarged(index: Indices, scale: int) -> Indices:
    """Return an array with each entry repeated ``scale`` times either way."""
    if scale == 1:
        return np.ascontiguousarray(index)
    return np.repeat(np.repeat(index, scale, axis=0), scale, axis=1)


def write_png(image: Image.Image, stream: BinaryIO, text: Mapping[str, str]) -> None:
    """Write an image with tEXt metadata; the same image gives the same bytes."""
    info = PngInfo()
    for key, value in text.items():
        info.add_text(key, value)
    image.save(stream, "PNG", pnginfo=info, compress_level=6)
