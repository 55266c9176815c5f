"""The map: walls, free space, singular points and what is contested; after the paper's Figure 8.

A cell's colour is that of its masses m(wall) and m(free), the stronger, the further from what is
unknown. Where strong evidence balances, both show through a tint as strong as it is contested.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import necessity_of
from possmap.core.patches import extent_of, spread
from possmap.core.pyramid import Ints
from possmap.core.settings import FreeFusion
from possmap.core.views import CellArray, Masses, Readout
from possmap.pictures import palettes
from possmap.pictures.layers import Cells, Indices, by_bands
from possmap.pictures.palettes import Table
from possmap.pictures.raster import Raster

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


def drawn(cells: Cells, raster: Raster, free_fusion: FreeFusion) -> Indices:
    """Return the palette indices of the map, the first row the highest y."""

    def band(part: Raster) -> Indices:
        found: Indices = np.zeros(part.blocks, dtype=np.uint8)
        for patch in cells.patches(part.window):
            window = extent_of(patch)
            stored = [spread(patch, layer, window) for layer in Layer]
            known = (stored[0] != 0) | (stored[1] != 0) | (stored[2] != 0)
            index = np.zeros(window.shape, dtype=np.uint8)
            walls, free, points = (layer[known] for layer in stored)
            masses = Readout.of(walls, free, free_fusion).masses
            index[known] = _indices(masses, necessity_of(points))
            part.raise_to(found, window, index)
        return found

    return by_bands(raster, band)


def _indices(masses: Masses, points: CellArray) -> Indices:
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


@cache
def table(palette: str) -> Table:
    """Return the 256 colours of the map; ``gray`` gives the greys of the paper's Figure 8."""
    gray = palette == "gray"
    unknown = palettes.PAPER if gray else palettes.UNKNOWN
    free_stops = palettes.PAPER_FREE_STOPS if gray else palettes.FREE_STOPS
    wall_stops = palettes.PAPER_WALL_STOPS if gray else palettes.WALL_STOPS
    walls = palettes.ramp((unknown, *wall_stops), STEPS + 1)
    free = palettes.ramp((unknown, *free_stops), STEPS + 1)
    points = palettes.ramp((unknown, palettes.PAPER_POINT if gray else palettes.POINT), STEPS + 1)
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
    found: Table = np.rint(colours).astype(np.uint8)
    return found


def contested_ramp(palette: str) -> Table:
    """Return the colours of cells of which everything is known, from one side's to undecided."""
    where = {pair: index for index, pair in enumerate(_pairs())}
    along = [where[half, STEPS - half, 0] for half in range(STEPS // 2 + 1)]
    stops = table(palette)[along]
    at = np.linspace(0, len(stops) - 1, 256)
    channels = [np.interp(at, np.arange(len(stops)), channel) for channel in stops.T]
    found: Table = np.rint(np.stack(channels, axis=1)).astype(np.uint8)
    return found
