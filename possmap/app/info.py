"""``possmap info``: what a grid holds, without reading a cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from possmap.core.lattice import TILE, Window
from possmap.files.gridfile.grid import Grid
from possmap.files.gridfile.ledger import Arrival, Entry
from possmap.files.setting_table import Value
from possmap.files.settings import Settings, assemble


@dataclass(frozen=True, slots=True)
class GridInfo:
    """A grid's size, settings and history.

    window : what holds all evidence; None if there is none.
    extent_m : the same as x0, y0, x1, y1 [m].
    tiles, tile_cells : how many tiles hold anything, and the cells in them.
    file_size : [bytes].
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
    arrivals: tuple[Arrival, ...]

    @property
    def robots(self) -> list[str]:
        """Names of the robots, sorted."""
        return sorted({entry.robot for entry in self.excursions})

    @property
    def records(self) -> int:
        """Records of all excursions."""
        return sum(entry.records for entry in self.excursions)


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
        tiles = grid.tiles.count()
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
            arrivals=tuple(grid.ledger.arrivals()),
        )
