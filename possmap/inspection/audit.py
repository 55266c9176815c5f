"""``possmap audit``: which excursions and robots contradict the others most (docs/audit.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from possmap.budget import Budget
from possmap.core.lattice import Lattice, TileKey, Window
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.inspection.contradiction import Tally
from possmap.inspection.outliers import Others, above
from possmap.inspection.tallies import tallies
from possmap.progress import Progress, quiet

Metres: TypeAlias = tuple[float, float, float, float]

LEAST_SHARE = 0.1
"""Of its cells others must have said something, or a side is not judged."""
LEAST_M2 = 1.0
"""And so large must those cells be together [m²]."""

ROBOT_STANDS_OUT = 1.75
"""A robot stands out that lies so many spreads above the other robots."""
EXCURSION_STANDS_OUT = 5.0
"""An excursion stands out that lies so many spreads above those of the other robots."""


@dataclass(frozen=True, slots=True)
class Side:
    """An excursion, or all excursions of a robot, beside the others.

    Attributes
    ----------
    robot, excursion
        Its name; no excursion: the robot.
    records
        How many it has.
    compared, share
        Cells of which it and the others say something, and their share of its cells.
    contradiction
        What contradicts, of all that both commit themselves on; 0 to 1.
    conflict
        Mean of Dempster's K over the cells compared: the sum of the next two.
    wall_free, free_wall
        Its walls where the others are free, and the reverse.
    worst
        x and y [m] of where it contradicts most, and K there.
    judged
        Whether enough was compared.
    above
        How far its contradiction lies above the median of the other robots, or of their
        excursions, in spreads of their excursions; None where that cannot be said.
    stands_out
        Whether that is so far that somebody should look.
    """

    robot: str
    excursion: str | None
    records: int
    compared: int
    share: float
    contradiction: float
    conflict: float
    wall_free: float
    free_wall: float
    worst: tuple[float, float, float] | None
    judged: bool
    above: float | None = None
    stands_out: bool = False


@dataclass(frozen=True, slots=True)
class Audit:
    """A grid's robots and excursions, the most contradicting first, those not judged last."""

    grid: Path
    resolution: float
    robots: tuple[Side, ...]
    excursions: tuple[Side, ...]


def audit(
    path: Path,
    *,
    window_m: Metres | None = None,
    progress: Progress = quiet,
    budget: Budget | None = None,
) -> Audit:
    """Hold every excursion, and every robot, against what all others say of the same cells.

    Parameters
    ----------
    window_m
        Compare only the cells of this rectangle; excursions that say nothing there are left out.

    Raises
    ------
    GridError
        If the file is no grid, or is damaged.
    BudgetError
        If the excursions do not fit into the memory allowed.
    """
    budget = budget or Budget()
    with Grid(path, budget=budget) as grid, grid.snapshot():
        window = None if window_m is None else grid.lattice.window_of(*window_m)
        entries = list(_touching(grid, window))
        of_excursion, of_robot = tallies(grid, entries, window, progress, budget)
        lattice = grid.lattice
        records: Counter[str] = Counter()
        for entry in entries:
            records[entry.robot] += entry.records
        excursions = [
            _side(entry.robot, entry.excursion, entry.records, tally, lattice)
            for entry, tally in zip(entries, of_excursion, strict=True)
            if window is None or tally.said
        ]
        robots = [
            _side(robot, None, records[robot], tally, lattice)
            for robot, tally in sorted(of_robot.items())
            if window is None or tally.said
        ]
        return Audit(
            grid=path,
            resolution=grid.resolution,
            robots=tuple(_ranked(robots, excursions, ROBOT_STANDS_OUT)),
            excursions=tuple(_ranked(excursions, excursions, EXCURSION_STANDS_OUT)),
        )


def _touching(grid: Grid, window: Window | None) -> Iterator[Entry]:
    """Yield the excursions, all or those that touch a tile of a window."""
    if window is None:
        yield from grid.ledger.entries()
        return
    touching = {
        identity
        for row in grid.tiles.directory.rows(window)
        for column in grid.tiles.directory.columns(row, window)
        for identity in grid.ledger.known_in(TileKey(row, column))
    }
    yield from (entry for entry in grid.ledger.entries() if entry.identity in touching)


def _side(robot: str, excursion: str | None, records: int, tally: Tally, lattice: Lattice) -> Side:
    worst = None
    if tally.worst is not None:
        place = lattice.centre_of(tally.worst.row, tally.worst.column)
        worst = (*place, tally.worst.conflict)
    large = tally.compared * lattice.resolution**2 >= LEAST_M2
    return Side(
        robot=robot,
        excursion=excursion,
        records=records,
        compared=tally.compared,
        share=tally.share,
        contradiction=tally.contradiction,
        conflict=tally.conflict,
        wall_free=tally.wall_free / max(1, tally.compared),
        free_wall=tally.free_wall / max(1, tally.compared),
        worst=worst,
        judged=large and tally.share >= LEAST_SHARE,
    )


def _ranked(sides: Sequence[Side], excursions: Sequence[Side], threshold: float) -> Iterator[Side]:
    """Yield sides, the most contradicting first; then those that cannot be judged, by name."""
    judged = [one for one in sides if one.judged]
    alike, others = _others(judged), _others([one for one in excursions if one.judged])
    told = [_beside(one, alike, others, threshold) for one in judged]
    yield from sorted(told, key=lambda one: (-one.contradiction, _name(one)))
    yield from sorted((one for one in sides if not one.judged), key=_name)


def _others(sides: Sequence[Side]) -> Others:
    return Others([one.contradiction for one in sides], [one.robot for one in sides])


def _beside(side: Side, alike: Others, excursions: Others, threshold: float) -> Side:
    """Say how far a side stands out from the other robots: its own excursions share its faults."""
    far = None
    if alike.owners_without(side.robot) > 1:
        median, unit = alike.median_without(side.robot), excursions.spread_without(side.robot)
        far = above(side.contradiction, median, unit)
    return replace(side, above=far, stands_out=far is not None and far >= threshold)


def _name(side: Side) -> tuple[str, str]:
    return side.robot, side.excursion or ""
