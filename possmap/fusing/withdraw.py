"""Evidence taken out of a grid: tile by tile, as if it had never come (docs/trust.md).

Of walls and points what goes is subtracted. Free space is a maximum: where what goes may have made
it alone, the other excursions that touch the tile say again what they know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from possmap.budget import Budget
from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers, fuse_tile, merged
from possmap.core.lattice import TILE, TileKey
from possmap.core.plan import TileWork, by_tile
from possmap.errors import GridError, printable
from possmap.fusing.refuse import Refused
from possmap.fusing.withdrawal import withdrawn
from possmap.grid.arrivals import Event
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.rows import excursion_rows
from possmap.grid.soundness import title
from possmap.progress import Progress

_DENIALS_BYTES = 8 * TILE * TILE
"""What is held of a tile whose denials must be raised again."""


@dataclass(frozen=True, slots=True)
class Loss:
    """What an excursion loses.

    left : what stays of all that came of it; nothing: the excursion vanishes.
    """

    entry: Entry
    left: tuple[Event, ...] = ()

    @property
    def kept(self) -> int:
        """How many of its records stay, from the first."""
        return max((event.what.end for event in self.left), default=0)

    @property
    def lost(self) -> int:
        """How many go."""
        return self.entry.records - self.kept


def withdraw(grid: Grid, losses: Sequence[Loss], budget: Budget, progress: Progress) -> int:
    """Take records out of tiles and ledger, inside a transaction; return how many tiles changed.

    Raises
    ------
    GridError
        If the tiles are not what the ledger's records make here.
    """
    work = _Withdrawal(grid, [loss for loss in losses if loss.lost or not loss.left], progress)
    keys = sorted(set().union(*work.touched))
    most = max(1, budget.held // 4 // _DENIALS_BYTES)
    for start in progress(range(0, len(keys), most), "batch of tiles"):
        work.take_out(keys[start : start + most])
    work.strike()
    for loss in losses:
        if loss.left:
            grid.ledger.came.replace(loss.entry.name, loss.left)
    grid.ledger.came.drop_sources()
    return len(work.changed)


class _Withdrawal:
    """Goes through the tiles; each is written once.

    touched : the tiles of each loss; changed : those in which that made a difference.
    """

    def __init__(self, grid: Grid, losses: Sequence[Loss], progress: Progress) -> None:
        self._losses = losses
        self._grid, self._settings = grid, grid.settings
        self._again = Refused(grid)
        self._gone = {loss.entry.identity for loss in losses}
        self.touched = self._tiles_of_losses(progress)
        self.changed: set[TileKey] = set()

    def _tiles_of_losses(self, progress: Progress) -> list[set[TileKey]]:
        """Return the tiles that each loss touches, and look whether they are what it made."""
        found = []
        for loss in progress(self._losses, "excursion"):
            laid_out = self._again.laid_out(loss.entry)
            if laid_out.geometry != self._grid.ledger.geometry(loss.entry):
                # Between maths libraries a last unit may differ, and then a difference of weights
                # would not be what the others make.
                raise self._odd(f"{title(loss.entry)}: its places are not those of its records")
            found.append({TileKey(row, column) for row, column, _ in laid_out.plan.touched()})
        return found

    def take_out(self, keys: Sequence[TileKey]) -> None:
        """Take what goes out of some tiles."""
        staying = dict(self._works(keys, kept=True))
        in_doubt: dict[TileKey, LayerArray] = {}
        for key, work in self._works(keys, kept=False):
            held = self._grid.tiles.read(key)
            try:
                left, must_raise = withdrawn(
                    held, fuse_tile(work, {}, self._settings), self._settings.free_fusion
                )
            except ValueError as error:
                raise self._odd(f"tile {key.row}, {key.column}: {error}") from error
            if key in staying:
                left = merged(
                    left,
                    fuse_tile(staying.pop(key), {}, self._settings),
                    self._settings.free_fusion,
                )
            if must_raise:
                in_doubt[key] = left.pop(Layer.FREE)
            self._put(key, left, held)
        self._raise(in_doubt)

    def _works(self, keys: Sequence[TileKey], kept: bool) -> list[tuple[TileKey, TileWork]]:
        """Return what the losses held, or what they keep, in some tiles."""
        here = [
            loss
            for loss, tiles in zip(self._losses, self.touched, strict=True)
            if (loss.kept or not kept) and not tiles.isdisjoint(keys)
        ]
        laid_out = self._again.laid_out
        plans = [
            (laid_out(loss.entry, loss.kept) if kept else laid_out(loss.entry)).plan.among(keys)
            for loss in here
        ]
        return [(work.key, work) for work in by_tile(plans)[1]]

    def _raise(self, denials: dict[TileKey, LayerArray]) -> None:
        """Raise denials to what the others know, excursion by excursion, and write them."""
        ledger = self._grid.ledger
        tiles: dict[TileKey, TileLayers] = {key: {Layer.FREE: at} for key, at in denials.items()}
        stamping = self._again.stamping(tiles, Layer.FREE)
        for identity, keys in self._again.touching(tiles).items():
            if identity in self._gone:
                continue
            entry = ledger.entry_of(identity)
            if entry is None:
                raise self._odd(f"excursion number {identity} is not there")
            stamping.add(self._again.laid_out(entry).plan, keys)
        for key, layers in stamping.done().items():
            self._put(key, layers, self._grid.tiles.read(key))

    def _put(self, key: TileKey, left: TileLayers, held: TileLayers) -> None:
        """Write what changed of a tile; what is pure ignorance now vanishes."""
        changed = {
            layer: array
            for layer, array in left.items()
            if layer not in held or not np.array_equal(array, held[layer])
        }
        if changed:
            self.changed.add(key)
        self._grid.tiles.write(key, {at: array for at, array in changed.items() if array.any()})
        self._grid.tiles.drop(key, [at for at, array in changed.items() if not array.any()])

    def strike(self) -> None:
        """Take the losses out of the ledger."""
        ledger = self._grid.ledger
        for loss, tiles in zip(self._losses, self.touched, strict=True):
            if not loss.left:
                ledger.remove(loss.entry, tiles)
                continue
            version = ledger.version(loss.entry).prefix(loss.kept)
            geometry, plan = self._again.laid_out(loss.entry, loss.kept)
            rows = excursion_rows(version, loss.entry.model, 0, geometry, plan.touched())
            ledger.rewrite(loss.entry, tiles, rows)

    def _odd(self, what: str) -> GridError:
        name = printable(str(self._grid.path))
        return GridError(
            f"{name}: {what}, as this machine computes them; nothing was changed, and possmap "
            "repair makes a grid from which it can be taken out"
        )
