"""Tiles laid out again from the ledger into memory: of some excursions, record by record."""

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
from possmap.pictures.raster import Raster

MOST_TILES = 1500
"""More are not held: with all layers a tile takes up to 1.5 MB."""

Counts = NDArray[np.uint16]


class TileMemory:
    """The tiles of a window, growing as excursions are fused into them.

    name : of the grid, for messages.
    """

    def __init__(self, name: str, settings: EvidenceSettings, window: Window) -> None:
        self._name, self._settings, self._window = name, settings, window
        self._tiles: dict[TileKey, TileLayers] = {}
        self._counts: dict[TileKey, Counts] = {}

    def fuse(self, found: Findings, known_records: int = 0) -> None:
        """Fuse what an excursion says beyond its known records.

        Raises
        ------
        OutputError
            If it touches more tiles than can be held.
        """
        for work in self._works(found, known_records):
            layers = self._tiles.setdefault(work.key, {})
            layers.update(fuse_tile(work, layers, self._settings))
            self._check(len(self._tiles))

    def count(self, found: Findings) -> None:
        """Count an excursion in each cell that it changes, be it wall, free or a singular point.

        Raises
        ------
        OutputError
            If it touches more tiles than can be held.
        """
        for work in self._works(found, 0):
            touched = np.zeros((TILE, TILE), dtype=np.bool_)
            for cells in fuse_tile(work, {}, self._settings).values():
                touched |= cells != 0
            counts = self._counts.setdefault(work.key, np.zeros((TILE, TILE), dtype=np.uint16))
            np.add(counts, 1, out=counts, where=touched & (counts < np.iinfo(np.uint16).max))
            self._check(len(self._counts) // 10)

    def counts(self, raster: Raster) -> Counts:
        """Return the largest count in each block, the first row the highest y."""
        found = np.zeros(raster.blocks, dtype=np.uint16)
        for key, counts in self._counts.items():
            tile = tile_window(key)
            part = tile.intersection(raster.window)
            raster.raise_to(found, part, counts[part.slices_in(tile)])
        return found[::-1]

    def patches(self, window: Window) -> Iterator[Patch]:
        """Yield what is known of a window, tile by tile."""
        for key in sorted(self._tiles):
            tile = tile_window(key)
            if tile.intersection(window).cells:
                patch = {layer: Crop(tile, cells) for layer, cells in self._tiles[key].items()}
                if patch:
                    yield cropped(patch, window)

    def _works(self, found: Findings, known_records: int) -> Iterator[TileWork]:
        _, works = by_tile([plan_excursion(found, known_records, self._settings)])
        return (work for work in works if tile_window(work.key).intersection(self._window).cells)

    def _check(self, tiles: int) -> None:
        if tiles > MOST_TILES:
            raise OutputError(
                f"{self._name}: more than {MOST_TILES:,} tiles laid out again, expected fewer; "
                "take a part of it: --window X0,Y0,X1,Y1"
            )
