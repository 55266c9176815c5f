"""Text in pictures: the font that comes with Pillow, and what it can show."""

from __future__ import annotations

from functools import cache
from unicodedata import combining, normalize

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
    """Return text in one line, and with a question mark for what the font lacks: all but ASCII.

    Letters with accents lose them.
    """
    plain = (ch for ch in normalize("NFKD", text) if not combining(ch))
    line = "".join(ch if ch.isprintable() else " " for ch in plain)
    return line.encode("ascii", "replace").decode()


def fitted(text: str, size: int, most: float) -> str:
    """Return as much of a text as is at most so wide [pixels], with dots for the rest."""
    text = showable(text)
    if width(text, size) <= most:
        return text
    low, high = 0, len(text)
    while low < high:  # the longest beginning that leaves room for the dots
        middle = (low + high + 1) // 2
        if width(text[:middle] + "...", size) <= most:
            low = middle
        else:
            high = middle - 1
    return text[:low] + "..."


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
