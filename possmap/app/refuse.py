"""Tiles made anew from the ledger: what a grid must hold if it is what its ledger says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple

from possmap.core.evidence import Geometry, findings
from possmap.core.fusion import TileLayers, fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.plan import ExcursionPlan, by_tile, plan_excursion
from possmap.files.gridfile.grid import Grid
from possmap.files.gridfile.ledger import Entry

HELD = 64
"""Excursions that are kept laid out: neighbouring tiles ask for the same ones."""


class Again(NamedTuple):
    """An excursion laid out again: where its records lie, and what they say."""

    geometry: Mapping[int, Geometry]
    plan: ExcursionPlan


class Refused:
    """The evidence of a grid's ledger, laid out again, excursion by excursion."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._settings = grid.settings
        self.laid_out = lru_cache(HELD)(self._lay_out)

    def _lay_out(self, entry: Entry, records: int | None = None) -> Again:
        """Lay out an excursion, or its first records alone."""
        version = self._grid.ledger.version(entry)
        if records is not None:
            version = version.prefix(records)
        found = findings(version, entry.model, self._settings)
        return Again(found.geometry, plan_excursion(found, 0, self._settings))

    def tile(self, key: TileKey, entries: Iterable[Entry]) -> TileLayers:
        """Return the layers of one tile by what some excursions say."""
        plans = [self.laid_out(entry).plan.among([key]) for entry in entries]
        _, works = by_tile([plan for plan in plans if len(plan.pieces)])
        for work in works:
            return fuse_tile(work, {}, self._settings)
        return {}
