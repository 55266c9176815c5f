"""``possmap audit``: which excursions and robots contradict others, or themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from operator import add
from pathlib import Path

from possmap.core.evidence import findings
from possmap.core.lattice import Lattice, TileKey, Window
from possmap.core.observations import Fit, Observations
from possmap.core.plan import ExcursionPlan
from possmap.errors import OutputError, plural, printable
from possmap.exports.job import Metres
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import replay
from possmap.grid.selection import Selection
from possmap.inspection.contradiction import Contradiction, sides_by_tile
from possmap.inspection.judgement import (
    LEAST_M2,
    LEAST_SHARE,
    ROBOT_STANDS_OUT,
    Side,
    Told,
    rank,
    told_apart,
)
from possmap.progress import Progress, quiet

IN_A_SPELL = 10
"""Excursions of a robot that are judged together, in the order in which they came."""

_MOST_BYTES = 1 << 30
"""Excursions laid out are not held beyond this."""


@dataclass(frozen=True, slots=True)
class Audit:
    """A grid's robots and excursions, the most contradicting first, those not judged last."""

    grid: Path
    resolution: float
    robots: tuple[Side, ...]
    excursions: tuple[Side, ...]


@dataclass(frozen=True, slots=True)
class _Judged:
    """An excursion, what it contradicts, and what its walls told."""

    entry: Entry
    found: Contradiction
    told: tuple[Observations, Fit]


def audit(
    path: Path,
    *,
    window_m: Metres | None = None,
    selection: Selection | None = None,
    progress: Progress = quiet,
) -> Audit:
    """Hold every excursion against what all other robots say of the same cells.

    Parameters
    ----------
    window_m
        Compare only the cells of this rectangle; excursions that say nothing there are left out.
    selection
        Judge only these excursions, against each other.

    Raises
    ------
    GridError
        If the file is no grid, is damaged, or holds no such excursion.
    OutputError
        If the excursions do not fit into memory.
    """
    with Grid(path) as grid, grid.snapshot():
        window = None if window_m is None else grid.lattice.window_of(*window_m)
        entries = selection.entries(grid) if selection else list(_in_order(grid))
        entries = [entry for entry in entries if window is None or _touches(grid, entry, window)]
        judged = _contradictions(grid, entries, window, progress)
        judged = [one for one in judged if window is None or one.found.said]
        excursions = [_side(grid.lattice, [one], one.entry.excursion) for one in judged]
        robots = sorted({one.entry.robot for one in judged})
        spells = {robot: _spells(grid.lattice, robot, judged) for robot in robots}
        sides = [_robot(grid.lattice, robot, judged, spells) for robot in robots]
        return Audit(
            grid=path,
            resolution=grid.resolution,
            robots=tuple(sorted(sides, key=rank)),
            excursions=tuple(sorted((told_apart(one, excursions) for one in excursions), key=rank)),
        )


def _in_order(grid: Grid) -> Iterator[Entry]:
    """Yield the excursions in the order in which they first came."""
    entries = {entry.identity: entry for entry in grid.ledger.entries()}
    for identity in grid.ledger.came.times():
        if identity in entries:
            yield entries.pop(identity)
    yield from entries.values()


def _touches(grid: Grid, entry: Entry, window: Window) -> bool:
    return any(
        entry.identity in grid.ledger.known_in(TileKey(row, column))
        for row in grid.tiles.directory.rows(window)
        for column in grid.tiles.directory.columns(row, window)
    )


def _contradictions(
    grid: Grid, entries: Sequence[Entry], window: Window | None, progress: Progress
) -> list[_Judged]:
    """Lay all excursions out again, and hold each against the other robots, tile by tile."""
    settings = grid.settings
    refined = grid.ledger.tracks.making() is not None
    plans: list[ExcursionPlan] = []
    told: list[tuple[Observations, Fit]] = []
    size = 0
    for entry in progress(entries, "excursion"):
        again = replay(grid, entry, settings)
        plans.append(again.plan)
        # A track that was refined tells of no observations: those of the filter count.
        told_by = findings(again.version, entry.model, settings) if refined else again.findings
        told.append((told_by.observations, told_by.fit))
        # Five copies while all are sorted by tile.
        size += 5 * (again.plan.pieces.nbytes + again.plan.segments.nbytes)
        if size > _MOST_BYTES:
            raise OutputError(
                f"{printable(str(grid.path))}: {plural(len(entries), 'excursion')} do not fit "
                "into memory together; audit some: --last N, --since, or a smaller --window"
            )
    found = [Contradiction() for _ in entries]
    robots = [entry.robot for entry in entries]
    count, tiles = sides_by_tile(plans, settings, window)
    for tile in progress(tiles, "tile", count):
        for number, one in tile.compared(robots):
            found[number] += one
    return [_Judged(*one) for one in zip(entries, found, told, strict=True)]


def _side(lattice: Lattice, some: Sequence[_Judged], excursion: str | None = None) -> Side:
    """Return excursions of one robot as one side."""
    found = reduce(add, (one.found for one in some))
    worst = None
    if found.worst is not None:
        worst = (*lattice.centre_of(found.worst.row, found.worst.column), found.worst.conflict)
    large = found.compared * lattice.resolution**2 >= LEAST_M2
    return Side(
        robot=some[0].entry.robot,
        excursion=excursion,
        records=sum(one.entry.records for one in some),
        compared=found.compared,
        share=found.share,
        contradiction=found.degree,
        conflict=found.conflict,
        wall_free=found.wall_free / max(1, found.compared),
        free_wall=found.free_wall / max(1, found.compared),
        worst=worst,
        told=Told.of([one.told for one in some]),
        judged=large and found.share >= LEAST_SHARE,
    )


def _spells(lattice: Lattice, robot: str, judged: Sequence[_Judged]) -> list[Side]:
    """Return a robot's excursions some at a time, each side named after the first of them."""
    own = [one for one in judged if one.entry.robot == robot]
    count = max(1, round(len(own) / IN_A_SPELL))
    starts = [len(own) * number // count for number in range(count + 1)]
    return [
        _side(lattice, own[begin:end], own[begin].entry.excursion)
        for begin, end in pairwise(starts)
    ]


def _robot(
    lattice: Lattice, robot: str, judged: Sequence[_Judged], spells: dict[str, list[Side]]
) -> Side:
    """Return a robot as a side: it stands out where one of its spells does."""
    whole = _side(lattice, [one for one in judged if one.entry.robot == robot])
    every = [one for some in spells.values() for one in some]
    own = [told_apart(one, every, ROBOT_STANDS_OUT) for one in spells[robot]]
    known = [one.above for one in own if one.above is not None]
    reasons = tuple(dict.fromkeys(reason for one in own for reason in one.reasons))
    since = next((one.excursion for one in own if one.reasons), None)
    above = max(known) if known else None
    return replace(whole, above=above, reasons=reasons, since=since)
