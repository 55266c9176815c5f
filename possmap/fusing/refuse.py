"""Tiles made anew from the ledger: what a grid must hold if it is what its ledger says."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from possmap.budget import Budget
from possmap.core.evidence import Geometry, Layer, findings
from possmap.core.fusion import TileLayers, fuse_tile
from possmap.core.lattice import TILE, TileKey
from possmap.core.plan import ExcursionPlan, by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry

TILES, KEPT, GATHERED = 2, 8, 16
"""Of the memory that may be held, the half is for tiles, an eighth for excursions that are kept
laid out, a sixteenth for what waits to be stamped."""

_TILE_BYTES = (8 + 2 + 8) * TILE * TILE
"""All layers of a tile."""

_EXCURSION_BYTES, _PLACE_BYTES, _CLIP_BYTES = 4096, 600, 200
"""What an excursion that is kept laid out takes; each of its places, and each line of a clip."""


class Again(NamedTuple):
    """An excursion laid out again: where its records lie, and what they say."""

    geometry: Mapping[int, Geometry]
    plan: ExcursionPlan

    @property
    def size(self) -> int:
        """What it takes, about [bytes]."""
        lines = sum(map(len, self.plan.clips))
        places = _PLACE_BYTES * len(self.geometry) + _CLIP_BYTES * lines
        return _EXCURSION_BYTES + places + _arrays(self.plan)


class Refused:
    """The evidence of a grid's ledger, laid out again, excursion by excursion.

    Attributes
    ----------
    tiles_at_once
        How many tiles may be made at once, so that few excursions are laid out more than once.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._settings = grid.settings
        held = (grid.budget or Budget()).held
        self.tiles_at_once = max(1, held // TILES // _TILE_BYTES)
        self._most_kept, self._most_gathered = held // KEPT, held // GATHERED
        self._kept: OrderedDict[tuple[int, int | None], Again] = OrderedDict()
        self._size = 0

    def laid_out(self, entry: Entry, records: int | None = None) -> Again:
        """Lay out an excursion, or its first records alone; those asked for last are kept."""
        key = entry.identity, records
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = self._lay_out(entry, records)
            self._size += found.size
            while self._size > self._most_kept:
                self._size -= self._kept.popitem(last=False)[1].size
        else:
            self._kept.move_to_end(key)
        return found

    def _lay_out(self, entry: Entry, records: int | None) -> Again:
        version = self._grid.ledger.version(entry)
        if records is not None:
            version = version.prefix(records)
        found = findings(version, entry.model, self._settings)
        return Again(found.geometry, plan_excursion(found, 0, self._settings))

    def touching(self, keys: Iterable[TileKey]) -> dict[int, list[TileKey]]:
        """Return which excursions touch some tiles, by their ids, sorted, and which of them."""
        found: dict[int, list[TileKey]] = {}
        for key in keys:
            for identity in self._grid.ledger.known_in(key):
                found.setdefault(identity, []).append(key)
        return dict(sorted(found.items()))

    def stamping(self, tiles: dict[TileKey, TileLayers], layer: Layer | None = None) -> Stamping:
        """Begin to stamp excursions into some tiles.

        tiles : what they hold so far; layer : the only one that is wanted; None: all.
        """
        return Stamping(tiles, layer, self._settings, self._most_gathered)


class Stamping:
    """Tiles into which excursions are stamped, many in one go: a tile is copied each time."""

    def __init__(
        self,
        tiles: dict[TileKey, TileLayers],
        layer: Layer | None,
        settings: EvidenceSettings,
        most: int,
    ) -> None:
        self._tiles, self._layer, self._settings = tiles, layer, settings
        self._plans: list[ExcursionPlan] = []
        self._size, self._most = 0, most

    def add(self, plan: ExcursionPlan, keys: Collection[TileKey]) -> None:
        """Take in what one excursion says in some of the tiles."""
        here = plan.among(keys, self._layer)
        if len(here.pieces):
            self._plans.append(here)
            self._size += _arrays(here)
        if self._size >= self._most:
            self._stamp()

    def done(self) -> dict[TileKey, TileLayers]:
        """Return what the tiles hold now."""
        self._stamp()
        return self._tiles

    def _stamp(self) -> None:
        for work in by_tile(self._plans)[1]:
            held = self._tiles[work.key]
            held |= fuse_tile(work, held, self._settings)  # which leaves out what is all 0
        self._plans.clear()
        self._size = 0


def _arrays(plan: ExcursionPlan) -> int:
    """Return what the arrays of a plan take [bytes]."""
    return plan.segments.nbytes + plan.pieces.nbytes + plan.records.nbytes
