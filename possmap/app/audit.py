"""``possmap audit``: which excursions and robots contradict the others most (docs/audit.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TypeAlias

from possmap.app.progress import Progress, quiet
from possmap.core.contradiction import Crowd, Said, Tally, said, together
from possmap.core.evidence import Layer, findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import Lattice, TileKey, Window, tile_window
from possmap.core.outliers import above, spread
from possmap.core.plan import ExcursionPlan, TileWork, by_tile, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.errors import plural, printable
from possmap.files.budget import Budget
from possmap.files.gridfile.grid import Grid
from possmap.files.gridfile.ledger import Entry

Metres: TypeAlias = tuple[float, float, float, float]

LEAST_SHARE = 0.1
"""Of its cells others must have said something, or a side is not judged."""
LEAST_M2 = 1.0
"""And so large must those cells be together [m²]."""

ROBOT_STANDS_OUT = 1.75
"""A robot stands out that lies so many spreads above the other robots."""
EXCURSION_STANDS_OUT = 5.0
"""An excursion stands out that lies so many spreads above those of the other robots."""

_RECORD_BYTES = 1500
"""A record, laid out and planned."""


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
        records = sum(entry.records for entry in entries)
        budget.check_held(
            f"{printable(str(path))}: laying out {plural(records, 'record')}",
            records * _RECORD_BYTES,
            "give a smaller --window",
        )
        of_excursion, of_robot = _tallies(grid, entries, window, progress, budget)
        lattice = grid.lattice
        excursions = [
            _side(entry.robot, entry.excursion, entry.records, tally, lattice)
            for entry, tally in zip(entries, of_excursion, strict=True)
            if window is None or tally.said
        ]
        robots = [
            _side(robot, None, sum(e.records for e in entries if e.robot == robot), tally, lattice)
            for robot, tally in sorted(of_robot.items())
            if window is None or tally.said
        ]
        return Audit(
            grid=path,
            resolution=grid.resolution,
            robots=tuple(_ranked(robots, excursions, ROBOT_STANDS_OUT)),
            excursions=tuple(_ranked(excursions, excursions, EXCURSION_STANDS_OUT)),
        )


def _tallies(
    grid: Grid,
    entries: Sequence[Entry],
    window: Window | None,
    progress: Progress,
    budget: Budget,
) -> tuple[list[Tally], dict[str, Tally]]:
    """Hold each excursion, and each robot, against the others, a tile at a time."""
    of_excursion = [Tally() for _ in entries]
    of_robot = {entry.robot: Tally() for entry in entries}
    for key, sides in progress(tiles(grid, entries, window, progress), "tile"):
        budget.check_held(
            f"{printable(str(grid.path))}: a tile that {plural(len(sides), 'excursion')} touch",
            2 * sum(array.nbytes for side in sides.values() for array in side),
        )
        by_robot: dict[str, list[Said]] = {}
        for number, side in sides.items():
            by_robot.setdefault(entries[number].robot, []).append(side)
        _compare(key, list(sides.values()), [of_excursion[number] for number in sides])
        teams = [together(some) for some in by_robot.values()]
        _compare(key, teams, [of_robot[robot] for robot in by_robot])
    return of_excursion, of_robot


def _compare(key: TileKey, sides: Sequence[Said], tallies: Sequence[Tally]) -> None:
    crowd = Crowd(sides)
    for number, (side, tally) in enumerate(zip(sides, tallies, strict=True)):
        tally.add(key, side, crowd.without(number))


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


def tiles(
    grid: Grid, entries: Sequence[Entry], window: Window | None, progress: Progress = quiet
) -> Iterator[tuple[TileKey, dict[int, Said]]]:
    """Yield each tile with what each excursion says in it, by its number among the entries.

    All are laid out again from the ledger, under the grid's settings and their models in force.
    """
    settings = grid.settings
    works = []
    for number, entry in progress(list(enumerate(entries)), "excursion"):
        found = findings(grid.ledger.version(entry), entry.model, settings)
        works.append(_works(number, plan_excursion(found, 0, settings)))
    for key, group in groupby(merge(*works, key=itemgetter(0, 1)), key=itemgetter(0)):
        if window is not None and not tile_window(key).intersection(window).cells:
            continue
        yield key, {number: _stamped(work, settings, window) for _, number, work in group}


def _works(number: int, plan: ExcursionPlan) -> Iterator[tuple[TileKey, int, TileWork]]:
    for work in by_tile([plan])[1]:
        yield work.key, number, work


def _stamped(work: TileWork, settings: EvidenceSettings, window: Window | None) -> Said:
    # Singular points contradict nobody.
    pieces = dict(work.pieces)
    pieces.pop(Layer.POINTS, None)
    return said(fuse_tile(work._replace(pieces=pieces), {}, settings), work.key, window)


def _side(robot: str, excursion: str | None, records: int, tally: Tally, lattice: Lattice) -> Side:
    worst = None
    if tally.worst is not None:
        row, column, conflict = tally.worst
        worst = (*lattice.centre_of(row, column), conflict)
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
    told = [_beside(one, judged, excursions, threshold) for one in judged]
    yield from sorted(told, key=lambda one: (-one.contradiction, _name(one)))
    yield from sorted((one for one in sides if not one.judged), key=_name)


def _beside(
    side: Side, alike: Sequence[Side], excursions: Sequence[Side], threshold: float
) -> Side:
    """Say how far a side stands out from the other robots: its own excursions share its faults."""
    others = [one.contradiction for one in alike if one.robot != side.robot]
    robots = {one.robot for one in alike if one.robot != side.robot}
    unit = spread([one.contradiction for one in _judged_of_others(side, excursions)])
    far = above(side.contradiction, others, unit) if len(robots) > 1 else None
    return replace(side, above=far, stands_out=far is not None and far >= threshold)


def _judged_of_others(side: Side, excursions: Sequence[Side]) -> Iterator[Side]:
    yield from (one for one in excursions if one.judged and one.robot != side.robot)


def _name(side: Side) -> tuple[str, str]:
    return side.robot, side.excursion or ""
