"""``possmap refine``: a new grid in which one wall is one wall (docs/refine.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from possmap.budget import DEFAULT_MIB, Budget
from possmap.core.model import ErrorModel
from possmap.core.records import PartialMap
from possmap.errors import GridError, did_you_mean, plural
from possmap.fusing.advice import refuse_refined
from possmap.fusing.appearing import appearing
from possmap.grid.copying import Refined, copy_excursions
from possmap.grid.grid import Grid
from possmap.grid.refined import Making
from possmap.progress import Progress, quiet
from possmap.refining import check_extra

if TYPE_CHECKING:
    from possmap.refining.refine import Refinement

_RECORD_BYTES = 3000
"""What refining takes of a record, measured."""


@dataclass(frozen=True, slots=True)
class RefineSummary:
    """What was done.

    made_of, digest : of the grid that was refined, and of the new one.
    found : walls and excursions.
    """

    grid: Path
    made_of: str
    digest: str
    found: Refinement


def refine(
    path: Path,
    output: Path,
    *,
    robots: Sequence[str] = (),
    overwrite: bool = False,
    budget: Budget | None = None,
    progress: Progress = quiet,
) -> RefineSummary:
    """Write a new grid of the same ledger, its tracks moved so that sightings of one wall agree.

    Parameters
    ----------
    path
        The grid, of estimator ``walls``; it is not changed.
    output
        The new one; it appears when it is whole.
    robots
        Whose tracks may be moved; none: all.
    budget
        Memory that it may take.

    Raises
    ------
    GridError
        If the file is no grid, is refined already, is of another estimator, holds no wall or no
        such robot, or cannot be solved.
    BudgetError
        If its ledger does not fit into memory.
    MissingExtra
        If the extra ``refine`` is not installed.
    OutputError
        If ``output`` exists and ``overwrite`` is off, or cannot be written.
    """
    check_extra("possmap refine")
    import numpy as np

    from possmap.refining.refine import refine as move

    with appearing(path, output, overwrite) as beside, Grid(path) as old, old.snapshot():
        settings = old.settings
        _check(old, robots, budget or Budget(DEFAULT_MIB))
        making = Making(old.digest(), tuple(sorted(set(robots))))
        try:
            found = move(_versions(old), settings, making.robots)
        except np.linalg.LinAlgError as error:
            raise GridError(f"{old.database.name}: cannot be refined: {error}") from error
        if not any(one.sightings for one in found.outings):
            raise GridError(f"{old.database.name}: holds no piece of wall that tells how it stands")
        with Grid(beside, write=True) as new:
            entries = sorted(old.ledger.entries(), key=lambda entry: entry.name)
            refined = Refined(making, found.tracks)
            copy_excursions(old, new, progress(entries, "excursion"), refined=refined)
            return RefineSummary(output, making.made_of, new.digest(), found)


def _versions(grid: Grid) -> Iterator[tuple[PartialMap, ErrorModel]]:
    return ((grid.ledger.version(entry), entry.model) for entry in grid.ledger.entries())


def _check(grid: Grid, robots: Sequence[str], budget: Budget) -> None:
    """Refuse what cannot be refined, before anything is read."""
    name, settings = grid.database.name, grid.settings
    refuse_refined(grid, "fuse into")
    for wanted, what, found in (
        (settings.estimator == "walls", "estimator walls", f"estimator {settings.estimator}"),
        (settings.orthogonal, "orthogonal: true", "orthogonal: false"),
    ):
        if not wanted:
            raise GridError(
                f"{name}: {found}, expected {what}; fuse its ledger into a new grid: "
                f"possmap fuse {name} -g NEW.possmap --profile robust"
            )
    entries = list(grid.ledger.entries())
    known = {entry.robot for entry in entries}
    for robot in robots:
        if robot not in known:
            raise GridError(f"{name}: knows no robot {robot}{did_you_mean(robot, sorted(known))}")
    records = sum(entry.records for entry in entries)
    budget.check_held(f"{name}: {plural(records, 'record')}", records * _RECORD_BYTES)
