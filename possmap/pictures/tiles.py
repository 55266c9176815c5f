"""Tiles laid out again from the ledger into memory, record by record: for films and coverage."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Findings
from possmap.core.fusion import TileLayers, fuse_tile
from possmap.core.lattice import TILE, TileKey, Window, tile_window
from possmap.core.patches import Crop, Patch, cropped
from possmap.core.plan import TileWork, by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.errors import OutputError
from possmap.grid.grid import Grid
from possmap.grid.replay import laid_out
from possmap.pictures.raster import Raster

MOST_TILES = 1500
"""More are not held: with all layers a tile takes up to 1.5 MB."""

Counts = NDArray[np.uint16]


class TileMemory:
    """The tiles of a window of a grid, growing as excursions are fused into them."""

    def __init__(self, grid: Grid, window: Window) -> None:
        self._name, self._settings, self._window = grid.database.name, grid.settings, window
        self._tiles: dict[TileKey, TileLayers] = {}

    def fuse(self, found: Findings, known_records: int) -> set[TileKey]:
        """Fuse what an excursion says beyond its known records; return the tiles that change.

        Raises
        ------
        OutputError
            If more tiles are touched than can be held.
        """
        changed = set()
        for work in _works(found, known_records, self._settings, self._window):
            layers = self._tiles.setdefault(work.key, {})
            layers.update(fuse_tile(work, layers, self._settings))
            changed.add(work.key)
            _check(self._name, len(self._tiles))
        return changed

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what is known of a window, tile by tile."""
        for key, layers in sorted(self._tiles.items()):
            tile = tile_window(key)
            if layers and tile.intersection(window).cells:
                yield cropped({layer: Crop(tile, one) for layer, one in layers.items()}, window)


def coverage(grid: Grid, raster: Raster) -> Counts:
    """Return the largest number of excursions that changed a cell of each block, highest y first.

    Raises
    ------
    OutputError
        If they touch more tiles than can be held.
    """
    settings = grid.settings
    counts: dict[TileKey, Counts] = {}
    for entry in grid.ledger.entries():
        for work in _works(laid_out(grid, entry, settings)[1], 0, settings, raster.window):
            touched = np.zeros((TILE, TILE), dtype=np.bool_)
            for cells in fuse_tile(work, {}, settings).values():
                touched |= cells != 0
            held = counts.setdefault(work.key, np.zeros((TILE, TILE), dtype=np.uint16))
            np.add(held, 1, out=held, where=touched & (held < np.iinfo(np.uint16).max))
            _check(grid.database.name, len(counts) // 10)
    found = np.zeros(raster.blocks, dtype=np.uint16)
    for key, held in counts.items():
        part = tile_window(key).intersection(raster.window)
        raster.raise_to(found, part, held[part.slices_in(tile_window(key))])
    return found[::-1]


def _works(
    found: Findings, known_records: int, settings: EvidenceSettings, window: Window
) -> Iterator[TileWork]:
    _, works = by_tile([plan_excursion(found, known_records, settings)])
    return (work for work in works if tile_window(work.key).intersection(window).cells)


def _check(name: str, tiles: int) -> None:
    if tiles > MOST_TILES:
        raise OutputError(
            f"{name}: more than {MOST_TILES:,} tiles laid out again, expected fewer; "
            "take a part of it: --window X0,Y0,X1,Y1"
        )
