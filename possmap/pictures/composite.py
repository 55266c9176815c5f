"""The map: walls, paths, singular points, contradictions; after the paper's Figure 8.

Trajectories are the darker, the smaller Π; walls the lighter, the smaller N. A cell that has both
is coloured by their shares; one with N > Π, which no probability satisfies, has a tone of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import necessity_of, possibility_of
from possmap.core.patches import Crop
from possmap.core.settings import FreeFusion
from possmap.pictures import palettes
from possmap.pictures.layers import Cells, Indices, by_bands, patches
from possmap.pictures.palettes import Table
from possmap.pictures.raster import Raster

Integers: TypeAlias = NDArray[np.integer]

UNKNOWN = 0
CONTRADICTED = 1
_FREE, _FREE_LEVELS = 2, 60
_WALL, _WALL_LEVELS = 62, 94
_BOTH, _BOTH_LEVELS = 156, 9
_POINT, _POINT_LEVELS = 237, 19


def drawn(cells: Cells, raster: Raster) -> Indices:
    """Return the palette indices of the map, the first row the highest y.

    A block has its cells' largest N and smallest Π, and is contradicted if one of them is.
    """
    return by_bands(raster, lambda band: _drawn(cells, band))


def _drawn(cells: Cells, raster: Raster) -> Indices:
    n, denied, point, crossed = (np.zeros(raster.blocks, dtype=np.uint8) for _ in range(4))

    def raise_to(whole: Indices, crop: Crop, level: Callable[[Integers], Indices]) -> None:
        # Blocks are formed of the stored integers: there are fewer of them to turn into N and Π.
        blocks = raster.blocks_of(crop.window)
        target = whole[blocks.where]
        cells: Integers = crop.cells
        np.maximum(target, level(blocks.largest(cells)), out=target)

    for patch in patches(cells, raster.window):
        for layer, whole, level in (
            (Layer.WALLS, n, _necessity),
            (Layer.FREE, denied, partial(_denial, cells.free_fusion)),
            (Layer.POINTS, point, _necessity),
        ):
            if layer in patch:
                raise_to(whole, patch[layer], level)
        if Layer.WALLS in patch and Layer.FREE in patch:
            both = _contradicted(patch[Layer.WALLS], patch[Layer.FREE], cells.free_fusion)
            if both is not None:
                raise_to(crossed, both, lambda marks: marks.astype(np.uint8))
    index = _lookup()[denied, n]
    is_point = point > np.maximum(n, denied)
    level_of_point = point[is_point].astype(np.int64)  # 8 bits would overflow
    index[is_point] = _POINT + level_of_point * (_POINT_LEVELS - 1) // 255
    index[crossed != 0] = CONTRADICTED
    return index


def _contradicted(walls: Crop, free: Crop, free_fusion: FreeFusion) -> Crop | None:
    """Mark the cells of two layers with N > Π, or None if there are none."""
    shared = walls.window.intersection(free.window)
    if not shared.cells:
        return None
    weights = walls.cells[shared.slices_in(walls.window)]
    denials = free.cells[shared.slices_in(free.window)]
    both = (weights != 0) & (denials != 0)
    if not both.any():
        return None
    marks = np.zeros(shared.shape, dtype=np.int64)
    marks[both] = necessity_of(weights[both]) > possibility_of(denials[both], free_fusion)
    return Crop(shared, marks)


def _necessity(weights: Integers) -> Indices:
    return _eight_bits(necessity_of(weights.astype(np.int64, copy=False)))


def _denial(free_fusion: FreeFusion, denials: Integers) -> Indices:
    return _eight_bits(1 - possibility_of(denials.astype(np.int64, copy=False), free_fusion))


def _eight_bits(value: NDArray[np.float64]) -> Indices:
    """Return 8-bit levels of values in [0, 1]; what is not 0 stays visible."""
    return np.ceil(255 * value).astype(np.uint8)


@cache
def _lookup() -> NDArray[np.uint8]:
    """Return the index for each pair of 8-bit levels (1 - Π, N)."""
    level = np.arange(256)
    free = _FREE + (np.maximum(level, 1) - 1) * _FREE_LEVELS // 255
    wall = _WALL + (np.maximum(level, 1) - 1) * _WALL_LEVELS // 255
    coarse = (np.maximum(level, 1) - 1) * _BOTH_LEVELS // 255
    index = _BOTH + coarse[:, None] * _BOTH_LEVELS + coarse
    index[:, 0] = free
    index[0, :] = wall
    index[0, 0] = UNKNOWN
    table: NDArray[np.uint8] = index.astype(np.uint8)
    return table


def letters() -> str:
    """Return a character for each index: ``.`` path, ``#`` wall, ``+`` both, ``!`` contradicted."""
    signs = [" "] * 256
    signs[CONTRADICTED] = "!"
    signs[_FREE:_WALL] = "." * (_WALL - _FREE)
    signs[_WALL:_BOTH] = "#" * (_BOTH - _WALL)
    signs[_BOTH:_POINT] = "+" * (_POINT - _BOTH)
    signs[_POINT:] = "o" * (256 - _POINT)
    return "".join(signs)


@cache
def table(palette: str) -> Table:
    """Return the 256 colours of the map; ``gray`` gives the greys of the paper's Figure 8."""
    gray = palette == "gray"
    unknown = palettes.PAPER if gray else palettes.UNKNOWN
    free_stops = palettes.PAPER_FREE_STOPS if gray else palettes.FREE_STOPS
    wall_stops = palettes.PAPER_WALL_STOPS if gray else palettes.WALL_STOPS
    free, wall = palettes.ramp(free_stops, 256), palettes.ramp(wall_stops, 256)
    colours = np.zeros((256, 3))
    colours[UNKNOWN] = unknown
    colours[CONTRADICTED] = palettes.CONTRADICTED
    colours[_FREE : _FREE + _FREE_LEVELS] = palettes.ramp(free_stops, _FREE_LEVELS)
    colours[_WALL : _WALL + _WALL_LEVELS] = palettes.ramp(wall_stops, _WALL_LEVELS)
    for denied in range(_BOTH_LEVELS):
        for n in range(_BOTH_LEVELS):
            at_free, at_wall = (round((one + 0.5) / _BOTH_LEVELS * 255) for one in (denied, n))
            share = (n + 0.5) / (n + denied + 1)
            mixed = share * wall[at_wall] + (1 - share) * free[at_free]
            colours[_BOTH + denied * _BOTH_LEVELS + n] = mixed
    point = (190, 190, 190) if gray else palettes.POINT
    colours[_POINT:] = palettes.ramp((unknown, point), _POINT_LEVELS + 1)[1:]  # never unknown
    return np.rint(colours).astype(np.uint8)
