"""The legend of a map or a chart: colour bars and signs, each a block that knows its size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from PIL import Image, ImageDraw

from possmap.pictures import palettes
from possmap.pictures.palettes import Colour
from possmap.pictures.text import LINE, NORMAL, SMALL, width, write

WIDTH = 200
_BAR = 14

Sign: TypeAlias = Callable[[ImageDraw.ImageDraw, int, int], None]
"""Draws what an entry explains, from x to the right, at the height y of its middle."""


class Key(Protocol):
    """A block of the legend."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""

    def draw(self, image: Image.Image, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""


@dataclass(frozen=True)
class ColourBar:
    """A scale with its ends' numbers and what they mean.

    colours : shape (n, 3), from the left end to the right.
    ends, words : at the left and the right.
    """

    title: str
    colours: palettes.Table
    ends: tuple[str, str]
    words: tuple[str, str] = ("", "")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return max(WIDTH, width(self.title, NORMAL)), 2 * LINE + _BAR + 4

    def draw(self, image: Image.Image, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""
        draw = ImageDraw.Draw(image)
        write(draw, (x, y), self.title, NORMAL, palettes.INK)
        at = np.rint(np.linspace(0, len(self.colours) - 1, WIDTH)).astype(int)
        bar = np.repeat(self.colours[at][None], _BAR, axis=0)
        image.paste(Image.fromarray(bar), (x, y + LINE))
        draw.rectangle((x, y + LINE, x + WIDTH - 1, y + LINE + _BAR - 1), outline=palettes.FAINT)
        below = y + LINE + _BAR + 3
        left, right = (
            f"{end}: {word}" if word else end
            for end, word in zip(self.ends, self.words, strict=True)
        )
        write(draw, (x, below), left, SMALL, palettes.INK)
        write(draw, (x + WIDTH, below), right, SMALL, palettes.INK, "ra")


@dataclass(frozen=True)
class LegendEntry:
    """A sign and what it stands for.

    letters : their size.
    room : for the sign [pixels].
    """

    sign: Sign
    text: str
    letters: int = NORMAL
    room: int = 26

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return self.room + width(self.text, self.letters), LINE

    def draw(self, draw: ImageDraw.ImageDraw, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""
        middle = y + LINE // 2
        self.sign(draw, x, middle)
        write(draw, (x + self.room, middle), self.text, self.letters, palettes.INK, "lm")


@dataclass(frozen=True)
class Group:
    """Entries one below the other."""

    entries: Sequence[LegendEntry]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return max(entry.size[0] for entry in self.entries), (LINE + 2) * len(self.entries)

    def draw(self, image: Image.Image, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""
        for number, entry in enumerate(self.entries):
            entry.draw(ImageDraw.Draw(image), x, y + (LINE + 2) * number)


def box(colour: Colour) -> Sign:
    """Return the sign of an area."""
    return lambda draw, x, y: draw.rectangle((x, y - 6, x + 17, y + 5), colour, palettes.FAINT)


def line(colour: Colour) -> Sign:
    """Return the sign of a line."""
    return lambda draw, x, y: draw.line((x, y, x + 17, y), colour, 2)


def point(draw: ImageDraw.ImageDraw, x: int, y: int) -> None:
    """Draw the sign of singular points."""
    diamond(draw, x + 9, y, 5, palettes.POINT)


def circled(letter: str) -> Sign:
    """Return a letter in a circle: a home, or the number of a change."""

    def draw_it(draw: ImageDraw.ImageDraw, x: int, y: int) -> None:
        draw.ellipse((x + 1, y - 8, x + 17, y + 8), palettes.PAPER, palettes.INK)
        write(draw, (x + 9, y), letter, SMALL, palettes.INK, "mm")

    return draw_it


def fixed(draw: ImageDraw.ImageDraw, x: int, y: int) -> None:
    """Draw the sign of fixes."""
    cross(draw, x + 9, y, 4, palettes.INK, 1)


def cross(
    draw: ImageDraw.ImageDraw, x: float, y: float, radius: float, colour: Colour, width: int
) -> None:
    """Draw a fix."""
    for up in (radius, -radius):
        draw.line((x - radius, y - up, x + radius, y + up), colour, width)


def diamond(
    draw: ImageDraw.ImageDraw,
    x: float,
    y: float,
    radius: float,
    colour: tuple[int, ...],
    outline: tuple[int, ...] = palettes.PAPER,
) -> None:
    """Draw a singular point."""
    corners = [(x, y - radius), (x + radius, y), (x, y + radius), (x - radius, y)]
    draw.polygon(corners, colour, outline)


def in_rows(
    sizes: Sequence[tuple[int, int]], most: int, apart: tuple[int, int] = (28, 14)
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return the places of blocks beside each other, at most so wide, and the size of all.

    apart : gaps between them along x and y [pixels].
    """
    places, x, y, row_height, widest = [], 0, 0, 0, 0
    for block_width, block_height in sizes:
        if x and x + block_width > most:
            x, y, row_height = 0, y + row_height + apart[1], 0
        places.append((x, y))
        x += block_width + apart[0]
        widest, row_height = max(widest, x - apart[0]), max(row_height, block_height)
    return places, (widest, y + row_height)
