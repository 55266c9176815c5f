"""The legend of a picture: colour bars and signs, each a block that knows its size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np
from PIL import Image, ImageDraw

from possmap.pictures import palettes
from possmap.pictures.palettes import Colour
from possmap.pictures.text import LINE, NORMAL, SMALL, width, write

WIDTH = 200
_BAR = 14
_SIGN = 26

Sign: TypeAlias = Literal["box", "point", "line", "home", "ring"]


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
    words: tuple[str, str]

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
class Entry:
    """A sign and what it stands for."""

    sign: Sign
    colour: Colour
    text: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return _SIGN + width(self.text, NORMAL), LINE + 2

    def draw(self, image: Image.Image, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""
        draw = ImageDraw.Draw(image)
        middle = y + LINE // 2
        if self.sign == "box":
            draw.rectangle((x, middle - 6, x + 17, middle + 5), self.colour, palettes.FAINT)
        elif self.sign == "line":
            draw.line((x, middle, x + 17, middle), self.colour, 2)
        elif self.sign in ("home", "ring"):
            circle = (x + 1, middle - 8, x + 17, middle + 8)
            draw.ellipse(circle, palettes.PAPER, palettes.INK)
            inside = "I" if self.sign == "home" else "1"
            write(draw, (x + 9, middle), inside, SMALL, self.colour, "mm")
        else:
            diamond(draw, x + 9, middle, 5, self.colour)
        write(draw, (x + _SIGN, middle), self.text, NORMAL, palettes.INK, "lm")


@dataclass(frozen=True)
class Group:
    """Entries one below the other."""

    entries: Sequence[Entry]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        sizes = [entry.size for entry in self.entries]
        return max(w for w, _ in sizes), sum(h for _, h in sizes)

    def draw(self, image: Image.Image, x: int, y: int) -> None:
        """Draw it with its upper left corner at (x, y)."""
        for entry in self.entries:
            entry.draw(image, x, y)
            y += entry.size[1]


def diamond(
    draw: ImageDraw.ImageDraw,
    x: float,
    y: float,
    radius: float,
    colour: tuple[int, ...],
    outline: tuple[int, ...] = palettes.PAPER,
) -> None:
    """Draw the sign of a singular point."""
    corners = [(x, y - radius), (x + radius, y), (x, y + radius), (x - radius, y)]
    draw.polygon(corners, colour, outline)


def in_column(keys: Sequence[Key]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return the places of keys one below the other, and the size of all [pixels]."""
    places, y, widest = [], 0, 0
    for key in keys:
        places.append((0, y))
        y += key.size[1] + 14
        widest = max(widest, key.size[0])
    return places, (widest, max(0, y - 14))


def in_rows(keys: Sequence[Key], most: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return the places of keys beside each other, at most so wide, and the size of all."""
    places, x, y, row_height, widest = [], 0, 0, 0, 0
    for key in keys:
        key_width, key_height = key.size
        if x and x + key_width > most:
            x, y, row_height = 0, y + row_height + 14, 0
        places.append((x, y))
        x += key_width + 28
        widest, row_height = max(widest, x - 28), max(row_height, key_height)
    return places, (widest, y + row_height)
