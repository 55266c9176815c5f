"""Excursions of one ledger fused into a new grid: what ``repair`` and a selection need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from possmap.core.fusion import fuse_tile
from possmap.core.plan import ExcursionPlan, by_tile
from possmap.core.refined import RefinedTrack
from possmap.errors import GridError
from possmap.grid.arrivals import Arrival
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.refined import Making
from possmap.grid.replay import replay
from possmap.grid.rows import excursion_rows
from possmap.grid.selection import Selection
from possmap.progress import Progress, quiet


class Refined(NamedTuple):
    """What makes a copy a refined grid: how it was made, and the tracks that were moved."""

    making: Making
    tracks: Mapping[tuple[str, str], RefinedTrack]


_AT_ONCE = 1 << 26
"""What may wait to be stamped [bytes]: each tile is written once for so much."""


def copy_excursions(
    old: Grid,
    new: Grid,
    entries: Iterable[Entry],
    *,
    lost: list[str] | None = None,
    refined: Refined | None = None,
    progress: Progress = quiet,
) -> None:
    """Fuse excursions of a ledger into a new grid, under the models that they had.

    What came by which file goes with them, in its order, but not what was forgotten.

    Parameters
    ----------
    lost
        Gets a line for each excursion that cannot be laid out, and is left out; None: that is an
        error.
    refined
        Tracks to lay excursions along, in place of those that the old grid keeps.

    Raises
    ------
    GridError
        If a record cannot be read or laid out; then the new grid is left as it was.
    """
    settings, came = old.settings, list[Arrival]()
    making = refined.making if refined else old.ledger.tracks.making()
    with new.transaction():
        new.prepare(settings, old.robots)
        if making is not None:
            new.ledger.tracks.prepare(making)
        plans: list[ExcursionPlan] = []
        for entry in entries:
            track = (
                refined.tracks.get(entry.name) if refined
                else old.ledger.tracks.track(entry.identity)
            )  # fmt: skip
            try:
                version, found, plan = replay(old, entry, settings, refined=track)
            except GridError as error:
                if lost is None:
                    raise
                lost.append(old.database.bare(error))
                continue
            told = found.observations if track is None else entry.observations
            new.ledger.add(
                excursion_rows(version, entry.model, 0, found.geometry, plan.touched(), told)
            )
            if track is not None:
                new.ledger.tracks.add(entry.name, track)
            came += old.ledger.came.of(entry.name)
            plans.append(plan)
            if sum(one.pieces.nbytes + one.segments.nbytes for one in plans) > _AT_ONCE:
                _stamp(new, plans, progress)
        _stamp(new, plans, progress)
        came.sort(key=_delivery)
        for (_, fused_at, version_of), some in groupby(came, key=_delivery):
            new.ledger.came.add(some, fused_at, version_of)


def _delivery(one: Arrival) -> tuple[int, str, str]:
    return one.source, one.fused_at, one.version


def _stamp(new: Grid, plans: list[ExcursionPlan], progress: Progress) -> None:
    settings = new.settings
    count, works = by_tile(plans)
    for work in progress(works, "tile", count):
        new.tiles.write(work.key, fuse_tile(work, new.tiles.read(work.key), settings))
    plans.clear()


@contextmanager
def selected(path: Path, selection: Selection, progress: Progress = quiet) -> Iterator[Path]:
    """Lend a grid of the selected excursions alone; without a selection, the grid itself.

    Raises
    ------
    GridError
        If the file is no grid, or nothing is selected.
    """
    if not selection:
        yield path
        return
    with TemporaryDirectory(prefix="possmap-") as folder:
        part = Path(folder) / path.name
        with Grid(path) as old, old.snapshot(), Grid(part, write=True) as new:
            entries = progress(selection.entries(old), "excursion")
            copy_excursions(old, new, entries)
        yield part
