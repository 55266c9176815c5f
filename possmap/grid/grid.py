"""A grid as a value to work with: what ``possmap.open_grid`` returns (docs/python.md)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Self

import numpy as np

from possmap.budget import Budget
from possmap.core import views
from possmap.core.evidence import Layer
from possmap.core.fusion import necessity_of, possibility_of
from possmap.core.lattice import Lattice, Window
from possmap.core.patches import extent_of, spread
from possmap.core.settings import EvidenceSettings, RobotModels
from possmap.core.views import CellArray
from possmap.errors import SettingsError, brief, did_you_mean
from possmap.grid.database import Database
from possmap.grid.ledger import Ledger
from possmap.grid.tiles import TileStore
from possmap.settings.setting_table import SHAPING, Value, parse_setting
from possmap.settings.settings import assemble, flat_evidence, flat_robots

LATER: Mapping[str, Value] = MappingProxyType(
    {
        "orthogonal": False,
        "axes": 0.0,
        "path_width": 0.0,
        "free_fusion": "minimum",
        "certainty_power": 1.0,
        "pass_weight": 1.0,
        "wall_noise": 0.045,
        "wall_tilt": 4.5,
        "frame_x": 0.0,
        "frame_y": 0.0,
        "frame_heading": 0.0,
    }
)
"""Settings that came after the first digests, with what was so before: then they are not in it."""


MOST_CELLS = 10**9
"""More than these are never read at once."""

_CELL_BYTES = 8


class Grid:
    """An open grid file: a possibility/necessity map, with the ledger of what it was made of.

    Cells are addressed as (row, column) on a lattice anchored at (0, 0) m, row 0 at the lowest y;
    both may be negative. Use it as a context manager, or close it.

    Parameters
    ----------
    path
        The file; with ``write`` it is made in the first transaction, if need be.
    budget
        What bounds the arrays of a window; None: any of up to 10⁹ cells.

    Attributes
    ----------
    path
        The file.
    ledger
        Excursions, records and arrivals.
    tiles
        The stored tiles.
    database
        The connection, for who looks for faults.

    Raises
    ------
    GridError
        If the file is no grid, is cut short, or is of another format.
    """

    def __init__(
        self, path: Path | str, *, write: bool = False, budget: Budget | None = None
    ) -> None:
        self.path = Path(path)
        self.budget = budget
        self.database = self._database = Database(self.path, write)
        self._digest: tuple[tuple[int, int], str] | None = None
        self._settings: tuple[tuple[int, int], EvidenceSettings] | None = None
        self.ledger = Ledger(self._database)
        self.tiles = TileStore(self._database)

    def __repr__(self) -> str:
        return f"<possmap grid {self._database.name}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    @property
    def is_new(self) -> bool:
        """Whether nothing was ever committed to the file."""
        return self._database.is_new()

    @property
    def settings(self) -> EvidenceSettings:
        """The settings that shape evidence, those of the first fuse."""
        state = self._database.state()
        if self._settings is None or self._settings[0] != state:
            self._settings = state, assemble(self.stored_settings()).evidence
        return self._settings[1]

    @property
    def robots(self) -> RobotModels:
        """What is known of single robots: name -> parameters, in the units of METHOD §1."""
        return assemble(self.stored_settings()).robots

    @property
    def resolution(self) -> float:
        """Metres per cell."""
        return self.settings.resolution

    @property
    def lattice(self) -> Lattice:
        """Conversions between metres and cells."""
        return Lattice(self.resolution)

    @property
    def window(self) -> Window | None:
        """The smallest window that holds all evidence; None if there is none."""
        return self.tiles.directory.bounds()

    @property
    def excursion_count(self) -> int:
        """How many excursions the ledger holds."""
        return self.ledger.count()

    def origin(self, window: Window | None = None) -> tuple[float, float]:
        """Return (x, y) [m] of the lower left corner of the first cell of a window, or of all."""
        chosen = self._chosen(window)
        return self.lattice.corner_of(chosen.row0, chosen.column0)

    def necessity(self, window: Window | None = None) -> CellArray:
        """Return N of each cell of a window, or of all evidence; shape (rows, columns)."""
        return self._necessity(Layer.WALLS, window)

    def possibility(self, window: Window | None = None) -> CellArray:
        """Return Π of each cell of a window, or of all evidence; shape (rows, columns)."""
        chosen = self._array_of(window)
        found = np.ones(chosen.shape)
        free_fusion = self.settings.free_fusion
        for crop in self.tiles.crops(Layer.FREE, chosen):
            found[crop.window.slices_in(chosen)] = possibility_of(crop.cells, free_fusion)
        return _frozen(found)

    def points(self, window: Window | None = None) -> CellArray:
        """Return the necessity of a singular point in every cell; shape (rows, columns)."""
        return self._necessity(Layer.POINTS, window)

    def view(self, name: str, window: Window | None = None, base_rate: float = 0.5) -> CellArray:
        """Return a view of METHOD §4 by its name (``possmap.VIEWS``); shape (rows, columns).

        Raises
        ------
        ValueError
            If there is no such view.
        """
        if name == "points":
            return self.points(window)
        if name not in views.VIEWS:
            names = [*views.VIEWS, "points"]
            guess = did_you_mean(name, names) or f", expected one of {', '.join(names)}"
            raise ValueError(f'unknown view "{name}"{guess}')
        chosen = self._array_of(window)
        unknown = views.VIEWS[name](views.NOTHING, base_rate)
        found = np.broadcast_to(unknown, chosen.shape).copy()
        free_fusion = self.settings.free_fusion
        for patch in self.tiles.patches(chosen):
            area = extent_of(patch)
            cells = views.Readout.of(
                spread(patch, Layer.WALLS, area), spread(patch, Layer.FREE, area), free_fusion
            )
            found[area.slices_in(chosen)] = views.VIEWS[name](cells, base_rate)
        return _frozen(found)

    def digest(self) -> str:
        """Return the digest, hexadecimal: two grids of the same evidence have one (METHOD §3)."""
        state = self._database.state()
        if self._digest is None or self._digest[0] != state:
            self._digest = state, self._computed_digest()
        return self._digest[1]

    def _computed_digest(self) -> str:
        # A setting that came later and does as before leaves every digest as it was.
        telling = {
            name: value
            for name, value in flat_evidence(self.settings).items()
            if name not in LATER or value != LATER[name]
        }
        shaping = json.dumps(telling, separators=(",", ":"))
        digest = hashlib.sha256(b"possmap grid 1\n" + shaping.encode() + b"\ntiles\n")
        for tile_hash in self.tiles.directory.hashes():
            digest.update(tile_hash)
        digest.update(b"\nexcursions\n")
        for excursion_hash in self.ledger.hashes():
            digest.update(excursion_hash)
        for part in self.ledger.tracks.parts():
            digest.update(part)
        return digest.hexdigest()

    def stored_settings(self) -> dict[str, Value]:
        """Return the stored settings, flat; those of robots as ``robots.NAME.parameter``.

        Raises
        ------
        GridError
            If one of them is no setting, or is missing.
        """
        stored: dict[str, Value] = {}
        for name, value in self._database.all("SELECT name, value FROM setting"):
            try:
                found = json.loads(value)
                text = str(found).lower() if isinstance(found, bool) else str(found)
                stored[name] = parse_setting(name, text, "").value
            except (ValueError, RecursionError, SettingsError) as error:
                raise self._database.damaged(f"setting {brief(name)}: {error}") from error
        for name in SHAPING:
            if name.startswith("frame_"):  # grids are older than these
                stored.setdefault(name, LATER[name])
            if name not in stored:
                raise self._database.damaged(f"setting {name} is missing")
        return stored

    def transaction(self) -> AbstractContextManager[None]:
        """Change the grid: all of what is done inside, or nothing, whatever happens."""
        return self._database.transaction()

    def snapshot(self) -> AbstractContextManager[None]:
        """Read one state of the grid throughout; a writer waits meanwhile."""
        return self._database.snapshot()

    def prepare(self, settings: EvidenceSettings, robots: RobotModels) -> None:
        """Lay out a new grid, inside a transaction; a known one only takes over robots' entries.

        Raises
        ------
        SettingsError
            If another process has meanwhile made this grid with other settings.
        """
        if self.is_new:
            self._database.create()
            self._store(flat_evidence(settings))
        else:
            stored, mine = self.stored_settings(), flat_evidence(settings)
            for name in SHAPING:
                if stored[name] != mine[name]:
                    raise SettingsError(
                        f"{self._database.name}: made meanwhile by another process, with "
                        f"{name} {stored[name]}, where this one has {mine[name]}"
                    )
        self._store(flat_robots(robots))

    def _store(self, values: Mapping[str, Value]) -> None:
        self._database.many(
            "INSERT INTO setting (name, value) VALUES (?, ?)"
            " ON CONFLICT (name) DO UPDATE SET value = excluded.value"
            " WHERE value <> excluded.value",
            ((name, json.dumps(value)) for name, value in values.items()),
        )

    def _necessity(self, layer: Layer, window: Window | None) -> CellArray:
        # Tile by tile: the result itself is all that is as large as the window.
        chosen = self._array_of(window)
        found = np.zeros(chosen.shape)
        for crop in self.tiles.crops(layer, chosen):
            weights = crop.cells.astype(np.int64, copy=False)
            found[crop.window.slices_in(chosen)] = necessity_of(weights)
        return _frozen(found)

    def _chosen(self, window: Window | None) -> Window:
        if window is None:
            return self.window or Window(0, 0, 0, 0)
        if not isinstance(window, Window):
            raise TypeError(
                f"found {window!r:.60}, expected a possmap.Window: grid.lattice.window_of"
            )
        if window.cells > MOST_CELLS:
            raise ValueError(
                f"{window.cells} cells, expected at most {MOST_CELLS}: read parts of it"
            )
        return window

    def _array_of(self, window: Window | None) -> Window:
        """Choose a window for an array, which must fit into the memory allowed."""
        window = self._chosen(window)
        if self.budget is not None:
            rows, columns = window.shape
            self.budget.check_held(
                f"{self._database.name}: an array of {rows} × {columns} cells",
                window.cells * _CELL_BYTES,
                "read parts of it",
            )
        return window


def _frozen(array: CellArray) -> CellArray:
    array.flags.writeable = False
    return array
