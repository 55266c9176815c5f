"""``possmap info``: what a grid holds; its cells are read only to tell how many are contested."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path

from possmap.core.lattice import TILE, Window
from possmap.grid.arrivals import Arrival
from possmap.grid.forgotten import Forgotten
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.refined import Making
from possmap.grid.tiles import MOST_COUNTED, Undecided
from possmap.settings.setting_table import Value
from possmap.settings.settings import Settings, assemble


@dataclass(frozen=True, slots=True)
class Share:
    """What some excursions of a grid come to.

    beyond : records that say nothing, since the error there reaches ``max_error``.
    """

    excursions: int
    records: int
    beyond: int
    robots: int

    @classmethod
    def of(cls, entries: Iterable[Entry]) -> Share:
        """Add up."""
        some = list(entries)
        return cls(
            len(some),
            sum(one.records for one in some),
            sum(one.beyond for one in some),
            len({one.robot for one in some}),
        )


@dataclass(frozen=True)
class GridInfo:
    """A grid's size, settings and history.

    window : what holds all evidence; None if there is none.
    extent_m : the same as x0, y0, x1, y1 [m].
    tiles, tile_cells : how many tiles hold anything, and the cells in them.
    file_size : [bytes].
    times : when each excursion first came, by its identity: UTC, ISO 8601.
    arrivals : what came by which file, also what was known already.
    forgotten : what was taken out, and is not let in.
    undecided : how many cells are known and contested; None of more than MOST_COUNTED tiles.
    refined : how it was made of another grid; None: of logs.
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
    times: dict[int, str]
    arrivals: tuple[Arrival, ...]
    forgotten: tuple[Forgotten, ...]
    undecided: Undecided | None
    refined: Making | None

    @property
    def robots(self) -> list[str]:
        """Names of the robots, sorted."""
        return sorted({entry.robot for entry in self.excursions})

    @property
    def records(self) -> int:
        """Records of all excursions."""
        return sum(entry.records for entry in self.excursions)

    @cached_property
    def by_robot(self) -> dict[str, Share]:
        """What each robot came home with."""
        return self._by(lambda entry: entry.robot)

    @cached_property
    def by_week(self) -> dict[str, Share]:
        """What came in each week, by its ISO name: ``2026-W49``."""
        return self._by(self._week)

    def _week(self, entry: Entry) -> str:
        came = self.times.get(entry.identity)
        return f"{datetime.fromisoformat(came):%G-W%V}" if came else "unknown"

    def _by(self, key: Callable[[Entry], str]) -> dict[str, Share]:
        groups: dict[str, list[Entry]] = {}
        for entry in self.excursions:
            groups.setdefault(key(entry), []).append(entry)
        return {name: Share.of(groups[name]) for name in sorted(groups)}


def info(path: Path) -> GridInfo:
    """Look into a grid file.

    Raises
    ------
    GridError
        If it is no grid.
    """
    with Grid(path) as grid, grid.snapshot():
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
            times=grid.ledger.came.times(),
            arrivals=tuple(grid.ledger.came.all()),
            forgotten=grid.ledger.forgotten.all(),
            undecided=_undecided(grid, tiles),
            refined=grid.ledger.tracks.making(),
        )


def _undecided(grid: Grid, tiles: int) -> Undecided | None:
    if tiles > MOST_COUNTED:
        return None
    return grid.tiles.undecided(grid.tiles.directory.keys())
