"""Several pictures as one moving file: APNG, WebP or GIF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import BinaryIO

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

FORMATS: Mapping[str, str] = {".png": "PNG", ".apng": "PNG", ".gif": "GIF", ".webp": "WEBP"}
"""Suffix -> Pillow's name."""


def write_film(
    frames: Iterable[Image.Image],
    palette_of: Image.Image,
    stream: BinaryIO,
    suffix: str,
    frame_ms: int,
    text: Mapping[str, str],
) -> int:
    """Write frames and return how many there were; the last is shown four times as long.

    Parameters
    ----------
    frames
        RGB images of one size.
    palette_of
        A picture with all colours of the film: GIF and PNG have 256 of them.
    """
    kind = FORMATS[suffix]
    if kind != "WEBP":
        colours = _palette(palette_of)
        frames = (frame.quantize(palette=colours, dither=Image.Dither.NONE) for frame in frames)
    first, *rest = frames
    durations = [frame_ms] * len(rest) + [4 * frame_ms]
    shown = durations if rest else frame_ms
    if kind == "PNG":
        info = PngInfo()
        for key, value in text.items():
            info.add_text(key, value)
        first.save(
            stream, kind, save_all=True, append_images=rest, duration=shown, loop=0, pnginfo=info
        )
    elif kind == "GIF":
        first.save(
            stream, kind, save_all=True, append_images=rest, duration=shown, loop=0,
            comment=text["Software"].encode(), optimize=False,
        )  # fmt: skip
    else:
        first.save(
            stream, kind, save_all=True, append_images=rest, duration=shown, loop=0, lossless=True
        )
    return 1 + len(rest)


def _palette(picture: Image.Image) -> Image.Image:
    """Return a palette of a picture's 256 most frequent colours, exactly as they are."""
    pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    colours, counts = np.unique(pixels, axis=0, return_counts=True)
    found = colours[np.argsort(-counts, kind="stable")[:256]]
    palette = Image.new("P", (1, 1))
    palette.putpalette(found.astype(np.uint8).tobytes())
    return palette
