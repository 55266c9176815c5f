"""``possmap verify``: whether a grid file is what it says (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np

from possmap.budget import Budget
from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers
from possmap.core.lattice import TileKey
from possmap.errors import GridError, PossmapError, printable
from possmap.fusing.refuse import Again, Refused
from possmap.grid.encoding import encode
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.soundness import LAYER_WORDS, title
from possmap.progress import Progress, quiet

SAMPLE = 64
"""Tiles that are fused again, unless all are asked for."""

MOST_FAULTS = 1000
"""Faults that are listed; more of them help nobody."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was looked at, and what is wrong with it.

    tiles, excursions : how many the file holds.
    refused : tiles that were fused again from the ledger.
    faults : one line each; empty: the grid is sound, as far as was looked.
    digest : None if it cannot be had.
    """

    grid: Path
    tiles: int
    excursions: int
    refused: int
    faults: tuple[str, ...]
    digest: str | None

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found wrong."""
        return not self.faults


def verify(
    path: Path,
    *,
    full: bool = False,
    budget: Budget | None = None,
    progress: Progress = quiet,
) -> Verdict:
    """Look at the structure of a grid file, at every hash, and at its tiles against its ledger.

    Parameters
    ----------
    path
        The file; it is not changed.
    full
        Fuse every tile again and lay out every excursion again, in place of a sample.

    Raises
    ------
    GridError
        If the file cannot be opened as a grid at all.
    """
    with Grid(path, budget=budget) as grid, grid.snapshot():
        looked = _Look(grid, full, progress)
        faults = list(islice(looked.faults(), MOST_FAULTS + 1))
        if len(faults) > MOST_FAULTS:
            faults[MOST_FAULTS] = f"more than {MOST_FAULTS} faults: the rest was not looked at"
        digest = None if faults else grid.digest()
        return Verdict(path, looked.tiles, looked.excursions, looked.refused, tuple(faults), digest)


class _Look:
    """Goes through a grid, and counts what it looked at."""

    def __init__(self, grid: Grid, full: bool, progress: Progress) -> None:
        self._grid, self._soundness, self._claims = grid, grid.soundness, grid.soundness.claims
        self._full, self._progress = full, progress
        self.tiles = self.excursions = self.refused = 0

    def faults(self) -> Iterator[str]:
        """Yield each fault as one line; after one that stops the look, that is the last."""
        try:
            broken = list(self._soundness.structure())
            yield from broken
            if broken:
                yield "nothing else was looked at: its structure is damaged"
                return
            yield from self._soundness.orphans()
            self.tiles = self._grid.tiles.directory.count()
            yield from self._soundness.tiles()
            yield from self._claims.forgotten()
            yield from self._claims.strays()
            faulty = False
            for identity in self._progress(self._grid.ledger.identities(), "excursion"):
                self.excursions += 1
                for fault in self._soundness.excursion(identity):
                    faulty = True
                    yield fault
            yield from self._claims.settings()
            yield from self._model_faults()
            if faulty:
                yield "the tiles were not compared with the ledger, which is damaged"
            else:
                yield from self._against_ledger()
        except PossmapError as error:
            yield str(error).removeprefix(f"{printable(str(self._grid.path))}: ")

    def _model_faults(self) -> Iterator[str]:
        """Hold the models in force against what excursions and settings say."""
        settings, robots = self._grid.settings, self._grid.robots
        for identity in self._grid.ledger.identities():
            try:
                entry = self._grid.ledger.entry_of(identity)
                if entry is not None:
                    for fault in self._claims.own_model(entry, settings):
                        yield f"{title(entry)}: {fault}"
                    for fault in self._claims.model(entry, settings, robots):
                        yield f"{title(entry)}: {fault}"
            except GridError:  # it cannot be read: that was said
                continue

    def _against_ledger(self) -> Iterator[str]:
        """Fuse tiles again, and lay out again the excursions that touch them."""
        anew, ledger = Refused(self._grid), self._grid.ledger
        seen: set[int] = set()
        counts = [len(keys) for keys in self._soundness.keys_by_row()]
        total = sum(counts) if self._full else min(SAMPLE, sum(counts))
        chosen, most = self._chosen(counts), anew.tiles_at_once
        batches = range(0, total, most)
        outer, inner = (quiet, self._progress) if len(batches) == 1 else (self._progress, quiet)
        for _ in outer(batches, "batch of tiles"):
            keys = list(islice(chosen, most))
            stamping = anew.stamping({key: {} for key in keys})
            touching = anew.touching(keys)
            for identity in inner(touching, "excursion"):
                entry = ledger.entry_of(identity)
                if entry is not None:
                    again = anew.laid_out(entry)
                    if identity not in seen:
                        yield from self._layout_fault(entry, again)
                    stamping.add(again.plan, touching[identity])
            seen.update(touching)
            for key, made in stamping.done().items():
                yield from self._tile_faults(key, made)
                self.refused += 1
        if self._full:
            for entry in ledger.entries():
                if entry.identity not in seen:
                    yield from self._layout_fault(entry, anew.laid_out(entry))

    def _chosen(self, counts: list[int]) -> Iterator[TileKey]:
        """Yield the tiles to fuse again: all, or some, the same ones each time.

        counts : how many there are, row by row: they are never all held at once.
        """
        total = sum(counts)
        chosen: set[int] | None = None
        if not self._full and total > SAMPLE:
            rng = np.random.default_rng(total)
            chosen = set(rng.choice(total, SAMPLE, replace=False).tolist())
        for number, key in enumerate(chain.from_iterable(self._soundness.keys_by_row())):
            if chosen is None or number in chosen:
                yield key

    def _layout_fault(self, entry: Entry, again: Again) -> Iterator[str]:
        if again.geometry != self._grid.ledger.geometry(entry):
            yield f"{title(entry)}: its places are not those of its records"
        if not self._soundness.is_touched(entry, again.plan.touched()):
            yield f"{title(entry)}: its tiles are not those that its records touch"

    def _tile_faults(self, key: TileKey, made: TileLayers) -> Iterator[str]:
        held = self._soundness.digests(key)
        digests = {layer: encode(layer, key, array).digest for layer, array in made.items()}
        for layer in Layer:
            if held.get(layer) != digests.get(layer):
                yield (
                    f"tile {key.row}, {key.column}, {LAYER_WORDS[layer]}: "
                    "not what the ledger's records make"
                )
