"""How many excursions touched each cell: counted anew from the ledger, excursion by excursion."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import TILE, TileKey, tile_window
from possmap.core.plan import by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.pictures.raster import Raster

Counts = NDArray[np.int64]

_OVERHEAD = 200
"""What a tile takes besides its packed counts: key, places in tables [bytes]."""


def counted(
    excursions: Iterable[Findings],
    settings: EvidenceSettings,
    raster: Raster,
    check: Callable[[int], None] = lambda size: None,
) -> Counts:
    """Return the excursions per block, shape (rows, columns), the first row the highest y.

    An excursion touches a cell if anything that it reports, wall, free space or singular point,
    changes the cell; of a block's cells the largest count is taken.

    check : told how many bytes the counts take, as they grow; may raise.
    """
    tiles: dict[TileKey, bytes] = {}
    size = 0
    for found in excursions:
        for key, touched in _touched(found, settings, raster):
            before = tiles.get(key)
            count = _blank() if before is None else _unpacked(before)
            count += touched
            tiles[key] = packed = zlib.compress(count.tobytes(), 1)
            size += len(packed) - len(before) if before else len(packed) + _OVERHEAD
            check(size)
    whole = np.zeros(raster.blocks, dtype=np.int64)
    for key, packed in tiles.items():
        tile = tile_window(key)
        part = tile.intersection(raster.window)
        blocks = raster.blocks_of(part)
        target = whole[blocks.where]
        cells = _unpacked(packed)[part.slices_in(tile)]
        np.maximum(target, blocks.largest(cells), out=target)
    return whole[::-1]


def _touched(
    found: Findings, settings: EvidenceSettings, raster: Raster
) -> Iterator[tuple[TileKey, NDArray[np.bool_]]]:
    """Yield each tile of the picture that an excursion changes, and the cells that it changes."""
    _, works = by_tile([plan_excursion(found, 0, settings)])
    for work in works:
        if tile_window(work.key).intersection(raster.window).cells:
            touched = np.zeros((TILE, TILE), dtype=np.bool_)
            for array in fuse_tile(work, {}, settings).values():
                touched |= array != 0
            yield work.key, touched


def _blank() -> NDArray[np.uint32]:
    return np.zeros((TILE, TILE), dtype=np.uint32)


def _unpacked(packed: bytes) -> NDArray[np.uint32]:
    count = np.frombuffer(zlib.decompress(packed), dtype=np.uint32)
    return count.reshape(TILE, TILE).copy()
