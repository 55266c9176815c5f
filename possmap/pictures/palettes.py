"""Colours: of values, of the map, of what is unknown; and images of indices into them.

Of the map, after the paper's Figure 8: walls, free space, points and what is contested.
A cell's colour is that of its masses m(wall) and m(free), the stronger, the further from what is
unknown. Where strong evidence balances, both show through a tint as strong as it is contested.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from possmap.core.pyramid import Ints
from possmap.core.views import CellArray, Masses

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


Stops: TypeAlias = tuple[Colour, ...]

STEPS = 20
"""Into so many steps each mass is divided: all pairs fit into one byte."""

UNDECIDED = 0.5
"""A cell more contested than this is neither wall nor free."""

_TINT = 0.72
"""How far the tint of what is wholly contested covers what is below it."""


@cache
def _pairs() -> tuple[tuple[int, int, int], ...]:
    """Return steps of (wall, free, point) by index, first what matters least.

    A block of cells shows the one that matters most: a wall twice as much as free space, so that
    thin walls survive.
    """
    cells = [
        (max(2 * wall, free), wall, free, 0)
        for wall in range(STEPS + 1)
        for free in range(STEPS + 1 - wall)
    ]
    points = [(step, 0, 0, step) for step in range(1, STEPS + 1)]
    return tuple((wall, free, point) for _, wall, free, point in sorted(cells + points))


@cache
def _index() -> Indices:
    """Return the index of each pair of steps (wall, free), and in the last row of points."""
    table = np.zeros((STEPS + 2, STEPS + 1), dtype=np.uint8)
    for index, (wall, free, point) in enumerate(_pairs()):
        table[(STEPS + 1, point) if point else (wall, free)] = index
    return table


def map_indices(masses: Masses, points: CellArray) -> Indices:
    """Return the palette indices of cells, by their masses and the necessity of a point there."""
    wall, free, point = (_steps(value) for value in (masses.wall, masses.free, points))
    # What is not 0 gets a step, at the cost of the stronger side where there is no other.
    excess = np.maximum(0, wall + free - STEPS)
    first = wall >= free
    wall, free = wall - np.where(first, 0, excess), free - np.where(first, excess, 0)
    is_point = point > np.maximum(wall, free)
    row, column = np.where(is_point, STEPS + 1, wall), np.where(is_point, point, free)
    found: Indices = _index()[row, column]
    return found


def _steps(value: CellArray) -> Ints:
    found: Ints = np.ceil(STEPS * value - 1e-9).astype(np.int64)
    return found


def map_letters() -> str:
    """Return a character for each index: ``.`` free, ``#`` wall, ``!`` undecided, ``o`` point."""
    signs = []
    for wall, free, point in _pairs():
        undecided = 2 * min(wall, free) > UNDECIDED * STEPS
        side = "!" if undecided else "#" if wall >= free else "."
        signs.append("o" if point else side if wall or free else " ")
    return "".join(signs).ljust(256)


def _stops(palette: str) -> tuple[Colour, Stops, Stops]:
    """Return the colour of what is unknown, and those of walls and free space, the stronger."""
    if palette == "gray":
        return PAPER, PAPER_WALL_STOPS, PAPER_FREE_STOPS
    return UNKNOWN, WALL_STOPS, FREE_STOPS


@cache
def map_table(palette: str) -> Table:
    """Return the 256 colours of the map; ``gray`` gives the greys of the paper's Figure 8."""
    unknown, wall_stops, free_stops = _stops(palette)
    point_colour = PAPER_POINT if palette == "gray" else POINT
    walls = ramp((unknown, *wall_stops), STEPS + 1)
    free = ramp((unknown, *free_stops), STEPS + 1)
    points = ramp((unknown, point_colour), STEPS + 1)
    tint = np.array(CONTESTED, dtype=float)
    colours = np.tile(np.array(unknown, dtype=float), (256, 1))
    for index, (m_wall, m_free, point) in enumerate(_pairs()):
        if point:
            colours[index] = points[point]
        elif m_wall or m_free:
            share = m_wall / (m_wall + m_free)
            mixed = share * walls[m_wall] + (1 - share) * free[m_free]
            covers = _TINT * 2 * min(m_wall, m_free) / STEPS
            colours[index] = (1 - covers) * mixed + covers * tint
    return _bytes(colours)


def map_scales(palette: str) -> Iterator[tuple[str, Table, tuple[str, str], str]]:
    """Yield title, colours, both ends and what the right one means, of each scale of the map."""
    _, wall_stops, free_stops = _stops(palette)
    yield "wall: belief", _bytes(ramp(wall_stops, 256)), ("0", "1"), "certain"
    free = _bytes(ramp(free_stops, 256))
    yield "free: plausibility of a wall", free, ("1", "0"), "certain"
    where = {pair: index for index, pair in enumerate(_pairs())}
    along = [where[half, STEPS - half, 0] for half in range(STEPS // 2 + 1)]
    contested = _bytes(ramp(map_table(palette)[along], 256))
    yield "contested: evidence both ways", contested, ("0", "1"), "undecided"


def _bytes(colours: NDArray[np.float64]) -> Table:
    found: Table = np.rint(colours).astype(np.uint8)
    return found


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
