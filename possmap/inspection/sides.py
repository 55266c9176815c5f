"""What each excursion says of walls in one tile, in no more cells than it may touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import denial_table, stamp_layer
from possmap.core.lattice import TileKey, Window, tile_window
from possmap.core.patches import Crop, Patch
from possmap.core.plan import ExcursionPlan, TileWork, by_tile
from possmap.core.pyramid import Floats, Ints
from possmap.core.segment_table import COLUMNS
from possmap.core.settings import EvidenceSettings

_MAX_ERROR, _WIDTH = COLUMNS.index("max_error"), COLUMNS.index("width")
_MOST_KEPT = 1 << 25
"""More is not kept of a tile [bytes]: to stamp it again takes hardly longer than to keep it."""


class TileSides:
    """Excursions in one tile: stamped when asked for, and kept as far as there is room.

    Attributes
    ----------
    key
        Of the tile.
    window
        The cells asked for that any of them may touch.
    numbers
        Of the excursions, ascending.
    free_fusion
        What their numbers of free space mean.
    """

    def __init__(
        self, work: TileWork, first_groups: Ints, within: Window, settings: EvidenceSettings
    ) -> None:
        self.key: TileKey = work.key
        self.window = _touched(work.segments, settings.resolution).intersection(within)
        self._works = dict(_apart(work, first_groups))
        self.numbers = list(self._works)
        self._settings, self.free_fusion = settings, settings.free_fusion
        self._kept: dict[int, Patch] = {}
        self._room = _MOST_KEPT

    def said(self, number: int) -> Patch:
        """Return the weights of what an excursion says: each layer only where it says something.

        Of free space too: what a denial weighs under Dempster's rule, however the grid combines.
        """
        if number in self._kept:
            return self._kept[number]
        found = {}
        for layer in (Layer.WALLS, Layer.FREE):  # singular points contradict nobody
            crop = self._stamped(self._works[number], layer)
            if crop is not None:
                found[layer] = crop
        size = sum(crop.cells.nbytes for crop in found.values())
        if size <= self._room:
            self._room -= size
            self._kept[number] = found
        return found

    def _stamped(self, work: TileWork, layer: Layer) -> Crop | None:
        if layer not in work.pieces:
            return None
        segments = work.segments[work.pieces[layer][:, 0]]
        window = _touched(segments, self._settings.resolution).intersection(self.window)
        cells = np.zeros(window.shape, dtype=np.int64)
        if window.cells:
            stamp_layer(cells, window, work, layer, self._settings)
        if layer is Layer.FREE and self._settings.free_fusion == "minimum":
            cells = denial_table(1.0)[cells]
        return Crop(window, cells) if cells.any() else None


def _touched(segments: Floats, resolution: float) -> Window:
    """Return a window of all cells that segments may touch, and some more."""
    half = np.minimum(segments[:, 4:8], segments[:, _MAX_ERROR, None])
    reach = np.maximum(half[:, :2], half[:, 2:])
    width = segments[:, _WIDTH, None]
    # A swath reaches across and along, in any direction (core/swath.py).
    swath = 2 * reach.sum(axis=1, keepdims=True) + np.maximum(width, resolution)
    reach = np.where(width > 0, swath, reach)
    ends = segments[:, [0, 1]], segments[:, [2, 3]]
    column0, row0 = np.floor((np.minimum(*ends) - reach).min(axis=0) / resolution).tolist()
    column1, row1 = np.ceil((np.maximum(*ends) + reach).max(axis=0) / resolution).tolist()
    # The cell of a centre, half a cell more, and what rounding does far from the origin.
    return Window(int(row0) - 2, int(row1) + 3, int(column0) - 2, int(column1) + 3)


def sides_by_tile(
    plans: Sequence[ExcursionPlan], settings: EvidenceSettings, within: Window | None
) -> tuple[int, Iterator[TileSides]]:
    """Return how many tiles excursions touch at most, and what they say there, by place.

    Parameters
    ----------
    plans
        Of each excursion; its place among them is its number.
    within
        Tiles and cells beyond are left out.
    """
    first_groups = np.cumsum([0, *(plan.groups for plan in plans)])[:-1]
    count, works = by_tile(plans)

    def tiles() -> Iterator[TileSides]:
        for work in works:
            cells = tile_window(work.key)
            if within is not None:
                cells = cells.intersection(within)
            if cells.cells:
                yield TileSides(work, first_groups, cells, settings)

    return count, tiles()


def _apart(work: TileWork, first_groups: Ints) -> Iterator[tuple[int, TileWork]]:
    """Yield the part of each excursion in the work of a tile, by number."""
    found: dict[int, dict[Layer, Ints]] = {}
    for layer, pieces in work.pieces.items():
        # Sorted by group, and groups by excursion.
        owners = np.searchsorted(first_groups, pieces[:, 3], side="right") - 1
        changes = (np.flatnonzero(owners[1:] != owners[:-1]) + 1).tolist()
        for start, stop in pairwise([0, *changes, len(pieces)]):
            found.setdefault(int(owners[start]), {})[layer] = pieces[start:stop]
    for number in sorted(found):
        # The kernel looks at all segments that it is given: of thousands of excursions, no more
        # than its own.
        parts = found[number]
        lowest = min(int(some[:, 0].min()) for some in parts.values())
        highest = max(int(some[:, 0].max()) for some in parts.values())
        own = {layer: some - np.array([lowest, 0, 0, 0, 0, 0]) for layer, some in parts.items()}
        segments = work.segments[lowest : highest + 1]
        yield number, TileWork(work.key, segments, own, work.clips)
