"""The map's colours: walls, free space, points and what is contested, after the paper's Figure 8.

A cell's colour is that of its masses m(wall) and m(free), the stronger, the further from what is
unknown. Where strong evidence balances, both show through a tint as strong as it is contested.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.pyramid import Ints
from possmap.core.views import CellArray, Masses
from possmap.pictures import palettes
from possmap.pictures.palettes import Indices, Table

Stops: TypeAlias = tuple[palettes.Colour, ...]

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


def indices(masses: Masses, points: CellArray) -> Indices:
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


def letters() -> str:
    """Return a character for each index: ``.`` free, ``#`` wall, ``!`` undecided, ``o`` point."""
    signs = []
    for wall, free, point in _pairs():
        undecided = 2 * min(wall, free) > UNDECIDED * STEPS
        side = "!" if undecided else "#" if wall >= free else "."
        signs.append("o" if point else side if wall or free else " ")
    return "".join(signs).ljust(256)


def _stops(palette: str) -> tuple[palettes.Colour, Stops, Stops]:
    """Return the colour of what is unknown, and those of walls and free space, the stronger."""
    if palette == "gray":
        return palettes.PAPER, palettes.PAPER_WALL_STOPS, palettes.PAPER_FREE_STOPS
    return palettes.UNKNOWN, palettes.WALL_STOPS, palettes.FREE_STOPS


@cache
def table(palette: str) -> Table:
    """Return the 256 colours of the map; ``gray`` gives the greys of the paper's Figure 8."""
    unknown, wall_stops, free_stops = _stops(palette)
    point_colour = palettes.PAPER_POINT if palette == "gray" else palettes.POINT
    walls = palettes.ramp((unknown, *wall_stops), STEPS + 1)
    free = palettes.ramp((unknown, *free_stops), STEPS + 1)
    points = palettes.ramp((unknown, point_colour), STEPS + 1)
    tint = np.array(palettes.CONTESTED, dtype=float)
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


def scales(palette: str) -> Iterator[tuple[str, Table, tuple[str, str], str]]:
    """Yield title, colours, both ends and what the right one means, of each scale of the map."""
    _, wall_stops, free_stops = _stops(palette)
    yield "wall: belief", _bytes(palettes.ramp(wall_stops, 256)), ("0", "1"), "certain"
    free = _bytes(palettes.ramp(free_stops, 256))
    yield "free: plausibility of a wall", free, ("1", "0"), "certain"
    where = {pair: index for index, pair in enumerate(_pairs())}
    along = [where[half, STEPS - half, 0] for half in range(STEPS // 2 + 1)]
    contested = _bytes(palettes.ramp(table(palette)[along], 256))
    yield "contested: evidence both ways", contested, ("0", "1"), "undecided"


def _bytes(colours: NDArray[np.float64]) -> Table:
    found: Table = np.rint(colours).astype(np.uint8)
    return found
