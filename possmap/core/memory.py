"""Tiles held in memory, for what is computed from the ledger and not kept: coverage, films."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Findings, Layer
from possmap.core.fusion import LayerArray, TileLayers, fuse_tile
from possmap.core.lattice import TILE, TileKey, Window, joined, tile_window, tiles_of
from possmap.core.plan import by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings


def paste(
    tile: NDArray[np.integer], key: TileKey, whole: NDArray[np.integer], window: Window
) -> None:
    """Copy what a tile, shape (TILE, TILE), shares with a window into the window's array."""
    cells = tile_window(key)
    shared = cells.intersection(window)
    whole[shared.slices_in(window)] = tile[shared.slices_in(cells)]


class TileMemory:
    """A grid's tiles, growing as excursions are fused into them."""

    def __init__(self, settings: EvidenceSettings) -> None:
        self._settings = settings
        self.free_fusion = settings.free_fusion
        self._tiles: dict[TileKey, TileLayers] = {}

    def fuse(self, found: Findings, known_records: int) -> list[TileKey]:
        """Fuse what an excursion says beyond its known records; return the tiles that changed."""
        changed = []
        _, works = by_tile([plan_excursion(found, known_records, self._settings)])
        for work in works:
            layers = self._tiles.setdefault(work.key, {})
            layers.update(fuse_tile(work, layers, self._settings))
            changed.append(work.key)
        return changed

    def areas(self, window: Window) -> Iterator[Window]:
        """Yield the parts of a window that hold anything."""
        keys = sorted(key for key in self._tiles if tile_window(key).intersection(window).cells)
        return joined(keys, window)

    def read_window(self, layer: Layer, window: Window) -> LayerArray:
        """Return one layer of a window, shape (rows, columns); what is not known is 0."""
        whole: LayerArray = np.zeros(window.shape, dtype=np.int64)
        for key in tiles_of(window):
            layers = self._tiles.get(key, {})
            if layer in layers:
                paste(layers[layer], key, whole, window)
        return whole

    def touched(self, key: TileKey) -> NDArray[np.bool_]:
        """Return the cells of a tile of which anything is known, shape (TILE, TILE)."""
        found = np.zeros((TILE, TILE), dtype=np.bool_)
        for array in self._tiles.get(key, {}).values():
            found |= array != 0
        return found
