"""How many excursions touched each cell: counted anew from the ledger, excursion by excursion."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Findings
from possmap.core.lattice import TILE, TileKey, tile_window
from possmap.core.memory import TileMemory
from possmap.core.settings import EvidenceSettings
from possmap.pictures.raster import Raster

Counts = NDArray[np.int64]


def counted(excursions: Iterable[Findings], settings: EvidenceSettings, raster: Raster) -> Counts:
    """Return the excursions per block, shape (rows, columns), the first row the highest y.

    An excursion touches a cell if anything that it reports, wall, free space or singular point,
    changes the cell; of a block's cells the largest count is taken.
    """
    tiles: dict[TileKey, NDArray[np.uint32]] = {}
    for found in excursions:
        alone = TileMemory(settings)
        for key in alone.fuse(found, 0):
            if tile_window(key).intersection(raster.window).cells:
                count = tiles.setdefault(key, np.zeros((TILE, TILE), dtype=np.uint32))
                count += alone.touched(key)
    whole = np.zeros(raster.blocks, dtype=np.int64)
    for key, count in tiles.items():
        tile = tile_window(key)
        part = tile.intersection(raster.window)
        blocks = raster.blocks_of(part)
        target = whole[blocks.where]
        np.maximum(target, blocks.largest(count[part.slices_in(tile)]), out=target)
    return whole[::-1]
