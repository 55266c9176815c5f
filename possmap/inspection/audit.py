"""``possmap audit``: which excursions and robots contradict others, or themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from operator import add
from pathlib import Path
from typing import TypeAlias

import numpy as np

from possmap.core.lattice import Lattice, TileKey, Window
from possmap.core.plan import ExcursionPlan
from possmap.core.walls import Fit, Observations
from possmap.errors import OutputError, plural, printable
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import replay
from possmap.grid.selection import Selection
from possmap.inspection.contradiction import Contradiction, Crowd, compare
from possmap.inspection.sides import TileSides, sides_by_tile
from possmap.inspection.told import Told
from possmap.progress import Progress, quiet

Metres: TypeAlias = tuple[float, float, float, float]

LEAST_SHARE = 0.1
"""Of its cells others must have said something, or a side is not judged."""
LEAST_M2 = 1.0
"""And so large must those cells be together [m²]."""

IN_A_SPELL = 10
"""Excursions of a robot that are judged together, in the order in which they came."""

ROBOT_STANDS_OUT = 3.0
"""A robot's spell stands out that lies so many spreads above those of the other robots."""
EXCURSION_STANDS_OUT = 8.0
"""An excursion stands out that lies so many spreads above those of the other robots."""
FEWEST = 5
"""So many values of others are needed to say how far values spread."""
LEAST_SPREAD = 0.02
"""No spread is taken for smaller: where nobody contradicts anybody, a trifle would stand out."""

_NORMAL = 1.4826
"""What makes a median absolute deviation a standard deviation, for a normal distribution."""

_MOST_BYTES = 1 << 30
"""Excursions laid out are not held beyond this."""


@dataclass(frozen=True, slots=True)
class Side:
    """An excursion, or all excursions of a robot, beside those of the other robots.

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
    told
        What its own walls told.
    judged
        Whether enough was compared.
    above
        How far its contradiction lies above the median of the others, in their spreads; of a robot,
        its worst spell. None where that cannot be said.
    reasons
        Why somebody should look; empty: it does not stand out.
    since
        The first excursion of a robot's worst spell that does.
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
    told: Told
    judged: bool
    above: float | None = None
    reasons: tuple[str, ...] = ()
    since: str | None = None

    @property
    def stands_out(self) -> bool:
        """Whether somebody should look."""
        return bool(self.reasons)


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
            robots=tuple(sorted(sides, key=_rank)),
            excursions=tuple(
                sorted((_told_apart(one, excursions) for one in excursions), key=_rank)
            ),
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
    plans: list[ExcursionPlan] = []
    told: list[tuple[Observations, Fit]] = []
    size = 0
    for entry in progress(entries, "excursion"):
        again = replay(grid, entry, settings)
        plans.append(again.plan)
        told.append((again.findings.observations, again.findings.fit))
        # Five copies while all are sorted by tile.
        size += 5 * (again.plan.pieces.nbytes + again.plan.segments.nbytes)
        if size > _MOST_BYTES:
            raise OutputError(
                f"{printable(str(grid.path))}: {plural(len(entries), 'excursion')} do not fit "
                "into memory together; audit some: --last N, --since, or a smaller --window"
            )
    found = [Contradiction() for _ in entries]
    count, tiles = sides_by_tile(plans, settings, window)
    for tile in progress(tiles, "tile", count):
        for number, one in _in_tile(tile, entries):
            found[number] += one
    return [_Judged(*one) for one in zip(entries, found, told, strict=True)]


def _in_tile(tile: TileSides, entries: Sequence[Entry]) -> Iterator[tuple[int, Contradiction]]:
    """Yield each excursion of a tile, held against what the other robots say there."""
    teams: dict[str, list[int]] = {}
    for number in tile.numbers:
        teams.setdefault(entries[number].robot, []).append(number)
    everybody = Crowd(tile.window)
    for number in tile.numbers:
        everybody.add(tile.said(number))
    for numbers in teams.values():
        own = Crowd(tile.window)
        for number in numbers:
            own.add(tile.said(number))
        others = everybody.without(own)
        for number in numbers:
            yield number, compare(tile.said(number), others)


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
    own = [_told_apart(one, every, ROBOT_STANDS_OUT) for one in spells[robot]]
    known = [one.above for one in own if one.above is not None]
    reasons = tuple(dict.fromkeys(reason for one in own for reason in one.reasons))
    since = next((one.excursion for one in own if one.reasons), None)
    above = max(known) if known else None
    return replace(whole, above=above, reasons=reasons, since=since)


def _told_apart(side: Side, sides: Sequence[Side], limit: float = EXCURSION_STANDS_OUT) -> Side:
    """Say how far a side stands out from other robots' sides: its own share its faults."""
    others = [one for one in sides if one.robot != side.robot]
    reasons = []
    above = None
    judged = [one for one in others if one.judged]
    if side.judged and len(judged) >= FEWEST and len({one.robot for one in judged}) > 1:
        values = np.array([one.contradiction for one in judged])
        median = float(np.median(values))
        spread = max(LEAST_SPREAD, _NORMAL * float(np.median(np.abs(values - median))))
        above = (side.contradiction - median) / spread
        if above >= limit:
            reasons.append("contradicts the others")
    reasons += side.told.reasons([one.told for one in others])
    return replace(side, above=above, reasons=tuple(reasons))


def _rank(side: Side) -> tuple[bool, bool, float, str, str]:
    return (
        not side.judged,
        not side.stands_out,
        -side.contradiction,
        side.robot,
        side.excursion or "",
    )
