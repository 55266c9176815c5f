"""What a ledger's records say, laid out again: the one place where that is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from possmap.core.evidence import Findings, Layer, findings
from possmap.core.fusion import TileLayers, fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.plan import ExcursionPlan, by_tile, plan_excursion
from possmap.core.records import PartialMap
from possmap.core.refined import RefinedTrack
from possmap.core.settings import EvidenceSettings
from possmap.errors import printable
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.progress import Progress, quiet

TILES_AT_ONCE = 256
"""Tiles that are made together, so that few excursions are laid out more than once; with all of
their layers they take 400 MB at most."""

_GATHERED = 1 << 26
"""What may wait to be stamped [bytes]: stamping much at once saves copies of tiles."""


class Replayed(NamedTuple):
    """An excursion laid out again: its records, where they lie, and what they say tile by tile."""

    version: PartialMap
    findings: Findings
    plan: ExcursionPlan


def replay(
    grid: Grid,
    entry: Entry,
    settings: EvidenceSettings,
    records: int | None = None,
    refined: RefinedTrack | None = None,
) -> Replayed:
    """Lay out an excursion of a ledger again, or its first records alone.

    settings : the grid's, asked for once. refined : its track; None: as the grid has it.

    Raises
    ------
    GridError
        If its records cannot be read, or are none that can be laid out.
    """
    version, found = laid_out(grid, entry, settings, records, refined)
    return Replayed(version, found, plan_excursion(found, 0, settings))


def laid_out(
    grid: Grid,
    entry: Entry,
    settings: EvidenceSettings,
    records: int | None = None,
    refined: RefinedTrack | None = None,
) -> tuple[PartialMap, Findings]:
    """Return records and what they say, as ``replay`` does, but not tile by tile."""
    version = grid.ledger.version(entry, records)
    if refined is None:
        refined = grid.ledger.tracks.track(entry.identity)
    try:
        return version, findings(version, entry.model, settings, refined)
    except (ValueError, TypeError, ArithmeticError) as error:
        what = f"{entry.title} cannot be laid out: {printable(str(error))}"
        raise grid.database.damaged(what) from error


def remade(
    grid: Grid,
    keys: Sequence[TileKey],
    layer: Layer | None = None,
    *,
    look: Callable[[Entry, Replayed], None] | None = None,
    progress: Progress = quiet,
) -> Iterator[tuple[TileKey, TileLayers]]:
    """Yield tiles as the ledger's records make them, each without the layers that are all 0.

    Parameters
    ----------
    layer
        The only one that is wanted; None: all.
    look
        Is shown every excursion that was laid out again, perhaps more than once.
    """
    settings, ledger = grid.settings, grid.ledger
    batches = range(0, len(keys), TILES_AT_ONCE)
    outer, inner = (quiet, progress) if len(batches) == 1 else (progress, quiet)
    for start in outer(batches, "batch of tiles"):
        tiles: dict[TileKey, TileLayers] = {key: {} for key in keys[start : start + TILES_AT_ONCE]}
        touching: dict[int, list[TileKey]] = {}
        for key in tiles:
            for identity in ledger.known_in(key):
                touching.setdefault(identity, []).append(key)
        plans: list[ExcursionPlan] = []
        for identity in inner(sorted(touching), "excursion"):
            entry = ledger.entry_of(identity)
            if entry is None:
                raise grid.database.damaged(f"excursion number {identity} is not there")
            again = replay(grid, entry, settings)
            if look is not None:
                look(entry, again)
            plans.append(again.plan.among(touching[identity], layer))
            if sum(plan.pieces.nbytes + plan.segments.nbytes for plan in plans) > _GATHERED:
                _stamp(tiles, plans, settings)
        _stamp(tiles, plans, settings)
        yield from tiles.items()


def _stamp(
    tiles: dict[TileKey, TileLayers], plans: list[ExcursionPlan], settings: EvidenceSettings
) -> None:
    for work in by_tile(plans)[1]:
        held = tiles[work.key]
        held |= fuse_tile(work, held, settings)
    plans.clear()
