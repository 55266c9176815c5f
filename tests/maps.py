"""Grids drawn as text, and the letters of what another program makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import CERTAIN, WEIGHT, blank
from possmap.core.lattice import TILE, TileKey
from possmap.core.pyramid import FULL
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid

PAIRS = {"?": (0.0, 1.0), "#": (1.0, 1.0), ".": (0.0, 0.0), "!": (1.0, 0.0)}
"""N and Π of unknown, wall, free and contradicted cells; of "1" to "9": N of so many tenths."""

Pairs = dict[tuple[int, int], tuple[float, float]]
"""N and Π by row and column."""


def cells_of(drawn: Sequence[str], row: int = 0, column: int = 0) -> Pairs:
    """Return the cells of a drawing, the highest row first; row, column: of its lowest left."""
    return {
        (row + up, column + right): PAIRS.get(mark) or (int(mark) / 10, 1.0)
        for up, line in enumerate(reversed(drawn))
        for right, mark in enumerate(line)
    }


def write_grid(path: Path, cells: Pairs, resolution: float = 0.5) -> Path:
    """Write a grid of cells that no excursion reported."""
    tiles: dict[TileKey, dict[Layer, np.ndarray]] = {}
    for (row, column), (necessity, possibility) in cells.items():
        layers = tiles.setdefault(TileKey(row // TILE, column // TILE), {})
        for layer, value in (
            (Layer.WALLS, CERTAIN if necessity == 1 else int(WEIGHT[round(FULL * necessity)])),
            (Layer.FREE, round(FULL * (1 - possibility))),
        ):
            if value:
                array = layers.setdefault(layer, blank(layer))
                array[row % TILE, column % TILE] = value
    with Grid(path, write=True) as grid, grid.transaction():
        grid.prepare(EvidenceSettings(resolution=resolution), {})
        for key, layers in sorted(tiles.items()):
            grid.tiles.write(key, layers)
    return path


def drawn_grid(
    path: Path, drawn: Sequence[str], row: int = 0, column: int = 0, resolution: float = 0.5
) -> Path:
    """Write a grid drawn as text."""
    return write_grid(path, cells_of(drawn, row, column), resolution)
