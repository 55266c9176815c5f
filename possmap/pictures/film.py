"""Several pictures as one moving file: APNG, WebP or GIF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
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
        A picture with all colours of the film: a GIF has 256 of them, and PNG if that is enough.
    """
    kind = FORMATS[suffix]
    few = len(np.unique(_packed(palette_of))) <= 256
    if kind == "GIF" or (kind == "PNG" and few):
        frames = _indexed(frames, palette_of)
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


def _indexed(frames: Iterable[Image.Image], palette_of: Image.Image) -> list[Image.Image]:
    """Return frames in palette mode, all with one palette of 256 colours.

    Colours are kept exactly while there is room: first those of ``palette_of``, the most frequent
    first, then what else a frame has; beyond 256 the nearest is taken.
    """
    colours, counts = np.unique(_packed(palette_of), return_counts=True)
    order = np.argsort(-counts, kind="stable")[:256]
    slots = {int(colour): slot for slot, colour in enumerate(colours[order])}
    found = []
    for frame in frames:
        pixels = _packed(frame)
        distinct, at = np.unique(pixels, return_inverse=True)
        index = np.array([_slot(int(colour), slots) for colour in distinct], dtype=np.uint8)
        found.append(Image.fromarray(index[at].reshape(pixels.shape)))
    table = np.array([_unpacked(colour) for colour in slots], dtype=np.uint8)
    for image in found:
        image.putpalette(table.tobytes())
    return found


def _packed(picture: Image.Image) -> NDArray[np.uint32]:
    """Return each pixel's colour as one number."""
    pixels = np.asarray(picture.convert("RGB")).astype(np.uint32)
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    packed: NDArray[np.uint32] = (red * 256 + green) * 256 + blue
    return packed


def _unpacked(colour: int) -> tuple[int, int, int]:
    return colour >> 16, colour >> 8 & 255, colour & 255


def _slot(colour: int, slots: dict[int, int]) -> int:
    """Return the palette's index of a colour, or of the nearest if there is no more room."""
    if colour not in slots and len(slots) < 256:
        slots[colour] = len(slots)
    if colour in slots:
        return slots[colour]
    r, g, b = _unpacked(colour)

    def distance(other: int) -> int:
        r2, g2, b2 = _unpacked(other)
        return (r - r2) ** 2 + (g - g2) ** 2 + (b - b2) ** 2

    return slots[min(slots, key=distance)]
