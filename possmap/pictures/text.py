"""Text in pictures: the font that comes with Pillow, and what it can show."""

from __future__ import annotations

from functools import cache

from PIL import ImageDraw, ImageFont

SMALL, NORMAL, LARGE = 12, 13, 18
LINE = 18
"""Height of a line of text [pixels]."""


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Return Pillow's own font; nothing is fetched."""
    found = ImageFont.load_default(size)
    assert isinstance(found, ImageFont.FreeTypeFont)  # Pillow without FreeType has no such font
    return found


def showable(text: str) -> str:
    """Return text with what the font lacks, everything beyond ASCII, as a question mark."""
    return text.encode("ascii", "replace").decode()


def width(text: str, size: int) -> int:
    """Return how wide a text is [pixels]."""
    return round(font(size).getlength(showable(text)))


def write(
    draw: ImageDraw.ImageDraw,
    at: tuple[float, float],
    text: str,
    size: int,
    colour: tuple[int, int, int],
    anchor: str = "la",
) -> None:
    """Write one line; ``anchor`` as Pillow's."""
    draw.text(at, showable(text), font=font(size), fill=colour, anchor=anchor)
