"""Evidence taken out of tiles and ledger, as if it had never come (docs/trust.md).

What adds up is subtracted. What does not (the free space of ``free_fusion: minimum``), and tiles in
which something cannot be laid out as it once was, are made again of what the ledger still holds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers, fuse_tile
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
    settings, tiles, ledger = grid.settings, grid.tiles, grid.ledger
    touched = ledger.touched_by([loss.entry.identity for loss in losses])
    keys = sorted(set().union(*touched.values()))
    before = {key: tiles.directory.hashes_of(key) for key in keys}
    anew: set[TileKey] = set()
    for loss in progress(losses, "excursion"):
        if loss.lost or loss.kept is None:
            here = touched[loss.entry.identity]
            anew |= _subtract(grid, loss, here, settings)
            _strike(grid, loss, here, settings)
        else:
            ledger.came.drop(loss.entry.name, loss.gone)
    _replace(grid, sorted(anew), tuple(Layer), progress)
    if not _adds_up(Layer.FREE, settings):
        free = [key for key in keys if key not in anew and Layer.FREE in before[key]]
        _replace(grid, free, (Layer.FREE,), progress)
    return sum(tiles.directory.hashes_of(key) != before[key] for key in keys)


def _adds_up(layer: Layer, settings: EvidenceSettings) -> bool:
    return layer is not Layer.FREE or settings.free_fusion == "dempster"


def _subtract(
    grid: Grid, loss: Loss, keys: Iterable[TileKey], settings: EvidenceSettings
) -> set[TileKey]:
    """Take what goes out of the sums of tiles; return the tiles where that cannot be done."""
    try:
        whole = replay(grid, loss.entry, settings)
        part = replay(grid, loss.entry, settings, loss.kept) if loss.kept else None
    except GridError:  # nobody can say what it once said
        return set(keys)
    if whole.findings.geometry != grid.ledger.geometry(loss.entry):
        return set(keys)  # as between two maths libraries
    staying = _said(part, settings) if part else {}
    failed = set()
    for key, gone in _said(whole, settings).items():
        held = grid.tiles.read(key)
        stays = staying.get(key, {})
        left: TileLayers = {}
        for layer, array in gone.items():
            if _adds_up(layer, settings):
                left[layer] = held.get(layer, 0) - array + stays.get(layer, 0)
        if any((array < 0).any() for array in left.values()):
            failed.add(key)
        else:
            _write(grid, key, left, tuple(left))
    return failed


def _said(again: Replayed, settings: EvidenceSettings) -> dict[TileKey, TileLayers]:
    """Return what an excursion alone makes of the tiles that it touches."""
    return {work.key: fuse_tile(work, {}, settings) for work in by_tile([again.plan])[1]}


def _strike(grid: Grid, loss: Loss, keys: Iterable[TileKey], settings: EvidenceSettings) -> None:
    """Take a loss out of the ledger."""
    if loss.kept is None:
        grid.ledger.remove(loss.entry, keys)
        return
    version, found, plan = replay(grid, loss.entry, settings, loss.kept)
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
