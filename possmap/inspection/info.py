"""``possmap info``: what a grid holds, without reading a cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from possmap.budget import Budget
from possmap.core.lattice import TILE, Window
from possmap.errors import plural, printable
from possmap.grid.arrivals import Event
from possmap.grid.forgotten import Forgotten
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.settings.setting_table import Value
from possmap.settings.settings import Settings, assemble


@dataclass(frozen=True, slots=True)
class GridInfo:
    """A grid's size, settings and history.

    window : what holds all evidence; None if there is none.
    extent_m : the same as x0, y0, x1, y1 [m].
    tiles, tile_cells : how many tiles hold anything, and the cells in them.
    file_size : [bytes].
    events : what came by which file, also what was known already.
    forgotten : what was taken out, and is not let in.
    """

    grid: Path
    digest: str
    resolution: float
    window: Window | None
    extent_m: tuple[float, float, float, float] | None
    tiles: int
    tile_cells: int
    file_size: int
    settings: Settings
    stored: dict[str, Value]
    excursions: tuple[Entry, ...]
    events: tuple[Event, ...]
    forgotten: tuple[Forgotten, ...]

    @property
    def robots(self) -> list[str]:
        """Names of the robots, sorted."""
        return sorted({entry.robot for entry in self.excursions})

    @property
    def records(self) -> int:
        """Records of all excursions."""
        return sum(entry.records for entry in self.excursions)

    def events_by_excursion(self) -> dict[tuple[str, str], list[Event]]:
        """Return what came of each excursion, in the order of arrival."""
        found: dict[tuple[str, str], list[Event]] = {}
        for event in self.events:
            found.setdefault(event.name, []).append(event)
        return found


_EXCURSION_BYTES = 8000
"""An excursion with what brought it, as values and as text."""


def info(path: Path, budget: Budget | None = None) -> GridInfo:
    """Look into a grid file.

    Raises
    ------
    GridError
        If it is no grid.
    BudgetError
        If its excursions are too many to list.
    """
    budget = budget or Budget()
    with Grid(path, budget=budget) as grid, grid.snapshot():
        known = grid.excursion_count
        budget.check_held(
            f"{printable(str(path))}: a list of {plural(known, 'excursion')}",
            known * _EXCURSION_BYTES,
        )
        window = grid.window
        extent = None
        if window is not None:
            low = grid.lattice.corner_of(window.row0, window.column0)
            high = grid.lattice.corner_of(window.row1, window.column1)
            x0, y0, x1, y1 = (round(value, 9) for value in (*low, *high))
            extent = (x0, y0, x1, y1)
        tiles = grid.tiles.directory.count()
        stored = grid.stored_settings()
        return GridInfo(
            grid=path,
            digest=grid.digest(),
            resolution=grid.resolution,
            window=window,
            extent_m=extent,
            tiles=tiles,
            tile_cells=tiles * TILE * TILE,
            file_size=path.stat().st_size,
            settings=assemble(stored),
            stored=stored,
            excursions=tuple(grid.ledger.entries()),
            events=tuple(grid.ledger.came.events()),
            forgotten=grid.ledger.forgotten.all(),
        )
