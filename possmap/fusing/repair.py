"""``possmap repair``: a new grid file from the ledger of one that is damaged (docs/trust.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from possmap.errors import GridError
from possmap.fusing.advice import refuse_refined
from possmap.fusing.appearing import appearing
from possmap.grid.copying import copy_excursions
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.soundness import Soundness, is_sound
from possmap.grid.verify import verify
from possmap.progress import Progress, quiet


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was saved.

    excursions, records, tiles : what the new file holds.
    lost : why an excursion could not be saved, or is in doubt, one line each.
    digest : of the new file.
    same : whether the damaged file has, or had, the same digest.
    """

    grid: Path
    excursions: int
    records: int
    tiles: int
    lost: tuple[str, ...]
    digest: str
    same: bool


def repair(
    path: Path, output: Path, *, overwrite: bool = False, progress: Progress = quiet
) -> Repaired:
    """Write a new grid with every sound excursion of a ledger, and the tiles that they make.

    Parameters
    ----------
    path
        The damaged file; it is not changed.
    output
        The new one; it appears when it is whole.

    Raises
    ------
    GridError
        If the file cannot be opened, or neither its settings nor its ledger can be read.
    OutputError
        If ``output`` exists and ``overwrite`` is off, or cannot be written.
    """
    lost: list[str] = []
    with appearing(path, output, overwrite) as beside:
        with Grid(path) as old, old.snapshot(), Grid(beside, write=True) as new:
            refuse_refined(old, "repair")
            identities = progress(old.ledger.identities(), "excursion")
            copy_excursions(old, new, _sound(old, identities, lost), lost=lost)
            with new.transaction():
                for one in old.ledger.forgotten.all():
                    if is_sound(one):
                        new.ledger.forgotten.add(one)
                    else:
                        lost.append("a note of what was forgotten is damaged")
            records = sum(one.records for one in new.ledger.entries())
            digest, same = new.digest(), _had(old, new.digest())
        verdict = verify(beside, progress=progress)
        lost += [f"the new grid does not verify: {fault}" for fault in verdict.faults]
    return Repaired(output, verdict.excursions, records, verdict.tiles, tuple(lost), digest, same)


def _had(old: Grid, digest: str) -> bool:
    try:
        return old.digest() == digest
    except GridError:
        return False


def _sound(old: Grid, identities: Iterable[int], lost: list[str]) -> Iterator[Entry]:
    """Yield the excursions that the new grid can hold, and note what is wrong with the others."""
    soundness = Soundness(old)
    for identity in identities:
        faults = list(soundness.excursion(identity))
        entry = None if faults else old.ledger.entry_of(identity)
        lost += faults
        if entry is not None:
            lost += [f"in doubt, and kept: {doubt}" for doubt in soundness.model(entry)]
            yield entry
