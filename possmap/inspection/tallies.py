"""Every excursion and every robot of a grid held against the others, a tile at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from possmap.budget import Budget
from possmap.core.evidence import findings
from possmap.core.lattice import Window
from possmap.core.plan import ExcursionPlan, plan_excursion
from possmap.errors import plural, printable
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.inspection.contradiction import Crowd, Tally, compare
from possmap.inspection.sides import TileSides, sides_by_tile
from possmap.progress import Progress, quiet

_RECORD_BYTES = 1000
"""A record planned, with a piece in one tile, and sorted."""
_LAID_OUT_BYTES = 2000
"""A record laid out, too: those of one excursion at a time."""
_EXCURSION_BYTES = 2000
"""Beside its records."""
_PIECE_BYTES = 360
"""Each further piece: 72, held five times while all are sorted by tile."""
_HEAP_BYTES = 31 << 20
"""glibc learns from arrays below 32 MiB."""
_MOST_KEPT = 1 << 25
"""More is not kept of a tile: to stamp it again takes hardly longer than to keep it."""


def tallies(
    grid: Grid,
    entries: Sequence[Entry],
    window: Window | None = None,
    progress: Progress = quiet,
    budget: Budget | None = None,
) -> tuple[list[Tally], dict[str, Tally]]:
    """Hold each excursion against all others, and each robot against all other robots.

    Raises
    ------
    GridError
        If the ledger is damaged.
    BudgetError
        If the excursions, laid out, do not fit into the memory allowed.
    """
    _settle_heap()
    of_excursion = [Tally() for _ in entries]
    of_robot = {entry.robot: Tally() for entry in entries}
    for tile in sides(grid, entries, window, progress, budget):
        teams: dict[str, list[int]] = {}
        for number in tile.numbers:
            teams.setdefault(entries[number].robot, []).append(number)
        _hold(tile, teams, of_excursion, of_robot)
    return of_excursion, of_robot


def _settle_heap() -> None:
    """Have the C library keep the memory of a tile's arrays for the next tile.

    glibc fetches arrays of 128 KiB and more from the kernel each time, and all their pages are
    faults: half of what an audit took. It learns otherwise from one large array that is freed.
    Elsewhere this does nothing; the array's pages are never touched.
    """
    np.empty(_HEAP_BYTES, dtype=np.uint8)


def sides(
    grid: Grid,
    entries: Sequence[Entry],
    window: Window | None = None,
    progress: Progress = quiet,
    budget: Budget | None = None,
) -> Iterator[TileSides]:
    """Yield each tile with what each excursion says in it, by its number among the entries.

    All are laid out again from the ledger, under the grid's settings and their models in force.
    """
    budget = budget or Budget()
    settings = grid.settings
    plans, size = _plans(grid, entries, progress, budget)
    room = min(_MOST_KEPT, (budget.held - size) // 2)
    count, tiles = sides_by_tile(plans, settings, window, room)
    yield from progress(tiles, "tile", count)


def _plans(
    grid: Grid, entries: Sequence[Entry], progress: Progress, budget: Budget
) -> tuple[list[ExcursionPlan], int]:
    """Lay out and plan all excursions; return also what they take [bytes].

    How many records there are is known before; into how many pieces tiles cut them shows only
    then. What does not fit is counted to the end and not held, so that the message tells all.
    """
    records = sum(entry.records for entry in entries)
    what = f"{printable(str(grid.path))}: laying out {plural(records, 'record')}"
    size = records * _RECORD_BYTES + len(entries) * _EXCURSION_BYTES
    size += max((entry.records for entry in entries), default=0) * _LAID_OUT_BYTES
    budget.check_held(what, size, "give a smaller --window")
    settings = grid.settings  # once: the file is asked for them each time
    plans: list[ExcursionPlan] = []
    for entry in progress(entries, "excursion"):
        found = findings(grid.ledger.version(entry), entry.model, settings)
        plan = plan_excursion(found, 0, settings)
        size += max(0, len(plan.pieces) - entry.records) * _PIECE_BYTES
        plans.append(plan)
        if size > budget.held:
            plans.clear()
    budget.check_held(what, size, "give a smaller --window")
    return plans, size


def _hold(
    tile: TileSides,
    teams: Mapping[str, Sequence[int]],
    of_excursion: Sequence[Tally],
    of_robot: Mapping[str, Tally],
) -> None:
    """Compare each excursion and robot of a tile with the others.

    All are added up first, and then each is held against the rest: what was not kept is stamped
    twice, so that memory does not grow with the number of excursions.
    """
    crowd, robots = _crowds(tile, teams)
    for robot, numbers in teams.items():
        own = Crowd(tile.window, tile.free_fusion) if len(numbers) > 1 else None
        for number in numbers:
            side = tile.said(number)
            found = compare(side, crowd.without(side) if crowd else {}, tile.free_fusion)
            of_excursion[number].add(found)
            if own:
                own.add(side)
        if own:
            team = own.whole()
            found = compare(team, robots.without(team) if robots else {}, tile.free_fusion)
        # Else its only excursion here is all of it, and the other excursions are other robots'.
        of_robot[robot].add(found)


def _crowds(
    tile: TileSides, teams: Mapping[str, Sequence[int]]
) -> tuple[Crowd | None, Crowd | None]:
    """Return all excursions of a tile, and all its robots; None where nobody needs them."""
    if len(tile.numbers) < 2:
        return None, None
    crowd = Crowd(tile.window, tile.free_fusion)
    robots = Crowd(tile.window, tile.free_fusion) if 1 < len(teams) < len(tile.numbers) else None
    for numbers in teams.values():
        own = Crowd(tile.window, tile.free_fusion) if robots and len(numbers) > 1 else None
        for number in numbers:
            side = tile.said(number)
            crowd.add(side)
            if own:
                own.add(side)
        if robots:
            robots.add(own.whole() if own else side)
    return crowd, robots
