"""``possmap verify``: whether a grid file is what it says (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.lattice import TileKey
from possmap.core.refined import RefinedTrack
from possmap.errors import PossmapError
from possmap.grid.encoding import encode
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import Replayed, remade, replay
from possmap.grid.soundness import LAYER_WORDS, Soundness
from possmap.progress import Progress, quiet
from possmap.refining import check_extra

SAMPLE = 64
"""Tiles that are fused again, unless all are asked for."""

ROUNDED_M = 1e-6
"""What refining may differ by from one machine to another [m, rad]."""

MOST_FAULTS = 1000
"""Faults that are listed; more of them help nobody."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was looked at, and what is wrong with it.

    tiles, excursions : how many the file holds.
    remade : tiles that were fused again from the ledger.
    faults : one line each; empty: the grid is sound, as far as was looked.
    digest : None if it cannot be had.
    """

    grid: Path
    tiles: int
    excursions: int
    remade: int
    faults: tuple[str, ...]
    digest: str | None

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found wrong."""
        return not self.faults


def verify(path: Path, *, full: bool = False, progress: Progress = quiet) -> Verdict:
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
    with Grid(path) as grid, grid.snapshot():
        look = _Look(grid, full, progress)
        faults = list(islice(look.faults(), MOST_FAULTS + 1))
        if len(faults) > MOST_FAULTS:
            faults[MOST_FAULTS] = f"more than {MOST_FAULTS} faults: the rest was not looked at"
        digest = None if faults else grid.digest()
        return Verdict(path, look.tiles, look.excursions, look.remade, tuple(faults), digest)


class _Look:
    """Goes through a grid, and counts what it looked at."""

    def __init__(self, grid: Grid, full: bool, progress: Progress) -> None:
        self._grid, self._soundness = grid, Soundness(grid)
        self._full, self._progress = full, progress
        self.tiles = self.excursions = self.remade = 0

    def faults(self) -> Iterator[str]:
        """Yield each fault as one line; after one that stops the look, that is the last."""
        try:
            broken = list(self._soundness.structure())
            yield from broken
            if broken:
                yield "nothing else was looked at: its structure is damaged"
                return
            self.tiles = self._grid.tiles.directory.count()
            yield from self._soundness.strays()
            yield from self._soundness.tiles()
            unsettled = list(self._soundness.settings())
            yield from unsettled
            sound = not unsettled
            for identity in self._progress(self._grid.ledger.identities(), "excursion"):
                self.excursions += 1
                for fault in self._soundness.excursion(identity):
                    sound = False
                    yield fault
            if sound:
                yield from self._refined()
                yield from self._against_ledger()
            else:
                yield "the tiles were not compared with the ledger, which is damaged"
        except PossmapError as error:
            yield self._grid.database.bare(error)

    def _refined(self) -> Iterator[str]:
        """Refine again what the ledger holds, and compare the tracks."""
        tracks, ledger = self._grid.ledger.tracks, self._grid.ledger
        making = tracks.making()
        if making is None:
            return
        check_extra("possmap verify of a refined grid")
        from possmap.refining.refine import refine

        entries = list(ledger.entries())
        versions = ((ledger.version(entry), entry.model) for entry in entries)
        again = refine(versions, self._grid.settings, making.robots).tracks
        for entry in entries:
            held, made = tracks.track(entry.identity), again.get(entry.name)
            if (held is None) != (made is None) or not _is_near(held or (), made or ()):
                yield f"{entry.title}: its refined track is not what its ledger's records make"

    def _against_ledger(self) -> Iterator[str]:
        """Fuse tiles again, and lay out again the excursions that touch them."""
        faults: list[str] = []
        seen: set[int] = set()

        def look(entry: Entry, again: Replayed) -> None:
            if entry.identity not in seen:
                seen.add(entry.identity)
                faults.extend(self._layout_faults(entry, again))

        for entry in self._grid.ledger.entries():
            yield from self._soundness.model(entry)
        keys = self._chosen()
        for key, made in remade(self._grid, keys, look=look, progress=self._progress):
            self.remade += 1
            yield from faults
            faults.clear()
            held = self._grid.tiles.directory.hashes_of(key)
            digests = {layer: encode(layer, key, array).digest for layer, array in made.items()}
            for layer in Layer:
                if held.get(layer) != digests.get(layer):
                    where = f"tile {key.row}, {key.column}, {LAYER_WORDS[layer]}"
                    yield f"{where}: not what the ledger's records make"
        settings = self._grid.settings
        for entry in self._grid.ledger.entries() if self._full else ():
            if entry.identity not in seen:
                yield from self._layout_faults(entry, replay(self._grid, entry, settings))

    def _chosen(self) -> list[TileKey]:
        """Return the tiles to fuse again: all, or some, the same ones each time."""
        keys = list(self._grid.tiles.directory.keys())
        if self._full or len(keys) <= SAMPLE:
            return keys
        some = np.random.default_rng(len(keys)).choice(len(keys), SAMPLE, replace=False)
        return [keys[number] for number in sorted(some.tolist())]

    def _layout_faults(self, entry: Entry, again: Replayed) -> Iterator[str]:
        if again.findings.geometry != self._grid.ledger.geometry(entry):
            yield f"{entry.title}: its places are not those of its records"
        if not self._soundness.is_touched(entry, again.plan.touched()):
            yield f"{entry.title}: its tiles are not those that its records touch"


def _is_near(one: RefinedTrack, other: RefinedTrack) -> bool:
    """Whether two tracks are one but for what other libraries of algebra round otherwise."""
    return len(one) == len(other) and np.allclose(
        np.array(one), np.array(other), rtol=0, atol=ROUNDED_M
    )
