"""Evidence taken out of tiles and ledger, as if it had never come (docs/trust.md).

What adds up is subtracted. What does not (the free space of ``free_fusion: minimum``), and tiles in
which something cannot be laid out as it once was, are made again of what the ledger still holds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers, blank, fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.plan import by_tile
from possmap.core.settings import EvidenceSettings
from possmap.errors import GridError
from possmap.grid.arrivals import Arrival
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import Replayed, remade, replay
from possmap.grid.rows import excursion_rows
from possmap.progress import Progress


@dataclass(frozen=True, slots=True)
class Loss:
    """What an excursion loses.

    gone : what is not to have come of it. kept : how many of its records stay, from the first,
        since other files held them too; None: the excursion vanishes.
    """

    entry: Entry
    gone: tuple[Arrival, ...] = ()
    kept: int | None = None

    @property
    def lost(self) -> int:
        """How many records go."""
        return self.entry.records - (self.kept or 0)


def withdraw(grid: Grid, losses: Sequence[Loss], progress: Progress) -> int:
    """Take records out, inside a transaction; return how many tiles changed.

    Raises
    ------
    GridError
        If what is left cannot be laid out.
    """
    if not losses:
        return 0
    settings, tiles, ledger = grid.settings, grid.tiles, grid.ledger
    touched = ledger.touched_by([loss.entry.identity for loss in losses])
    before: dict[TileKey, dict[int, bytes]] = {}
    anew: set[TileKey] = set()
    for loss in progress(losses, "excursion"):
        if not loss.lost and loss.kept is not None:
            ledger.came.drop(loss.entry.name, loss.gone)
            continue
        there = touched[loss.entry.identity]
        part = None if loss.kept is None else replay(grid, loss.entry, settings, loss.kept)
        # What stays of a smoothed excursion may lie where the whole said nothing.
        here = {*there, *(TileKey(*one[:2]) for one in (part.plan.touched() if part else ()))}
        before |= {key: tiles.directory.hashes_of(key) for key in here - before.keys()}
        anew |= _subtract(grid, loss, part, here, settings)
        _strike(grid, loss, part, there)
    _replace(grid, sorted(anew), tuple(Layer), progress)
    if not _adds_up(Layer.FREE, settings):
        _replace(grid, sorted(before.keys() - anew), (Layer.FREE,), progress)
    return sum(tiles.directory.hashes_of(key) != was for key, was in before.items())


def _adds_up(layer: Layer, settings: EvidenceSettings) -> bool:
    return layer is not Layer.FREE or settings.free_fusion == "dempster"


def _subtract(
    grid: Grid,
    loss: Loss,
    part: Replayed | None,
    keys: Iterable[TileKey],
    settings: EvidenceSettings,
) -> set[TileKey]:
    """Take what goes out of the sums of tiles; return the tiles where that cannot be done."""
    try:
        whole = replay(grid, loss.entry, settings)
    except GridError:  # nobody can say what it once said
        return set(keys)
    if whole.findings.geometry != grid.ledger.geometry(loss.entry):
        return set(keys)  # as between two maths libraries
    staying = _said(part, settings) if part else {}
    going = _said(whole, settings)
    failed = set()
    for key in sorted(going.keys() | staying.keys()):
        held, gone, stays = grid.tiles.read(key), going.get(key, {}), staying.get(key, {})
        left: TileLayers = {}
        for layer in gone.keys() | stays.keys():
            if _adds_up(layer, settings):
                left[layer] = held.get(layer, blank()) - gone.get(layer, 0) + stays.get(layer, 0)
        if any((array < 0).any() for array in left.values()):
            failed.add(key)
        else:
            _write(grid, key, left, tuple(left))
    return failed


def _said(again: Replayed, settings: EvidenceSettings) -> dict[TileKey, TileLayers]:
    """Return what an excursion alone makes of the tiles that it touches."""
    return {work.key: fuse_tile(work, {}, settings) for work in by_tile([again.plan])[1]}


def _strike(grid: Grid, loss: Loss, part: Replayed | None, keys: Iterable[TileKey]) -> None:
    """Take a loss out of the ledger."""
    if part is None:
        grid.ledger.remove(loss.entry, keys)
        return
    version, found, plan = part
    model, told = loss.entry.model, found.observations
    grid.ledger.came.drop(loss.entry.name, loss.gone)
    grid.ledger.strike(loss.entry, keys)
    grid.ledger.add(excursion_rows(version, model, 0, found.geometry, plan.touched(), told))


def _replace(
    grid: Grid, keys: Sequence[TileKey], layers: tuple[Layer, ...], progress: Progress
) -> None:
    """Make layers of tiles again of what the ledger holds."""
    only = layers[0] if len(layers) == 1 else None
    for key, made in remade(grid, keys, only, progress=progress):
        _write(grid, key, made, layers)


def _write(grid: Grid, key: TileKey, made: TileLayers, layers: tuple[Layer, ...]) -> None:
    """Write layers of a tile; what is pure ignorance now vanishes."""
    some = {layer: array for layer, array in made.items() if array.any()}
    grid.tiles.write(key, some)
    grid.tiles.drop(key, [layer for layer in layers if layer not in some])
