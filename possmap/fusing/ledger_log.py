"""A grid's ledger read as a log, and trusted no more than one (docs/trust.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from possmap.core.records import PartialMap
from possmap.errors import GridError, printable
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.rows import excursion_hash
from possmap.grid.soundness import is_sound
from possmap.logs import Delivery, LogFile, Origin
from possmap.logs.delivery import path_text
from possmap.logs.fields import Fault
from possmap.logs.rechecking import rechecked
from possmap.settings.limits import Limits


def read_ledger(path: Path, limits: Limits) -> LogFile:
    """Read all excursions of a grid, each version with the file that once held it.

    Whoever made the grid may have written what he liked into it. So each excursion is held to its
    hash and to every rule of logs.

    Raises
    ------
    GridError
        For a grid that cannot be read, or holds what no log could have brought; the line names the
        excursion.
    """
    deliveries: list[Delivery] = []
    with Grid(path) as grid, grid.snapshot():
        grid.database.check_structure()
        origin = Origin(str(path), hashlib.sha256(grid.digest().encode()).hexdigest(), 0)
        known = {entry.name: (entry, one) for entry, one in _versions(grid, limits)}
        missing = set(known)
        for one in grid.ledger.came.all():
            entry, whole = known[one.name]
            if not is_sound(one):
                raise _damaged(path, entry, "a file that brought it is not as possmap writes it")
            if one.records > entry.records:
                raise _damaged(path, entry, f"a file is said to have held {one.records} records")
            if one.records == entry.records:
                missing.discard(one.name)
            place = f"{path}: {entry.robot} {entry.excursion}"
            deliveries.append(Delivery(whole, place, one.origin, one.carrier, one.records))
        for name in sorted(missing):
            raise _damaged(path, known[name][0], "nothing says what brought its last record")
    return LogFile(origin, tuple(deliveries), is_ledger=True)


def _versions(grid: Grid, limits: Limits) -> Iterator[tuple[Entry, PartialMap]]:
    """Yield all excursions; the hash of each is that of its records."""
    entries = list(grid.ledger.entries())
    names = sorted(entry.name for entry in entries)  # the order in which hashes come
    hashes = dict(zip(names, grid.ledger.hashes(), strict=True))
    for entry in entries:
        try:
            version = rechecked(grid.ledger.version(entry), limits.limit_nesting - 1)
        except Fault as fault:
            where = path_text(fault.path)
            problem = f"{where}: {fault.problem}" if where else fault.problem
            raise _damaged(grid.path, entry, problem) from None
        if excursion_hash(version, entry.model) != hashes[entry.name]:
            raise _damaged(grid.path, entry, "its hash is not that of its records")
        yield entry, version


def _damaged(path: Path, entry: Entry, what: str) -> GridError:
    name, whose = printable(str(path)), entry.title
    return GridError(f"{name}: damaged: {whose[:160]}: {printable(what)[:200]}")
