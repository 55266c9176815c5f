"""A grid's ledger read as a log, and trusted no more than one (docs/trust.md)."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

from possmap.core.records import PartialMap
from possmap.errors import GridError, printable
from possmap.grid.arrivals import Again, Part
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.rows import excursion_hash
from possmap.grid.soundness import title
from possmap.logs import Delivery, LogFile, Origin, Parcel
from possmap.logs.delivery import path_text
from possmap.logs.fields import Fault, name_of
from possmap.logs.rechecking import rechecked
from possmap.settings.limits import Limits

_SHA256 = re.compile("[0-9a-f]{64}")


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
        origin = Origin(str(path), hashlib.sha256(grid.digest().encode()).hexdigest(), 0)
        known = {entry.name: (entry, Parcel(one)) for entry, one in _versions(grid, limits)}
        missing = set(known)
        for _, name, what, *_ in grid.ledger.came.events():
            entry, whole = known[name]
            fault = _fault_of(what, entry)
            if fault:
                raise _damaged(path, entry, fault)
            if what.end == entry.records:
                missing.discard(name)
            # Files may be many, and each may have held another beginning: none is copied.
            parcel = whole.beginning(what.end)
            place = f"{path}: {entry.robot} {entry.excursion}"
            deliveries.append(Delivery(parcel, place, what.origin, what.carrier))
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


def _fault_of(what: Part | Again, entry: Entry) -> str | None:
    """Return what is wrong with what is said of a file, if anything is."""
    origin = what.origin
    first = what.first if isinstance(what, Part) else 0
    if not 0 <= first <= what.end <= entry.records:
        return f"a file is said to have held its records {first} to {what.end}"
    if type(origin.sha256) is not str or not _SHA256.fullmatch(origin.sha256):
        return "the SHA-256 of a file that brought it is none"
    if type(origin.size) is not int or origin.size < 0:
        return "the size of a file that brought it is none"
    try:
        for one in what.carrier or ():
            name_of("carrier", one)
    except Fault as fault:
        return f"carrier: {fault.problem}"
    return None


def _damaged(path: Path, entry: Entry, what: str) -> GridError:
    name, whose = printable(str(path)), printable(title(entry))
    return GridError(f"{name}: damaged: {whose[:160]}: {printable(what)[:200]}")
