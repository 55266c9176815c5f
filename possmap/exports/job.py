"""One export: what is to be written, the cells and records that it is of, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from possmap.core.evidence import Geometry
from possmap.core.lattice import TILE, Window
from possmap.core.propagation import ErrorRectangle
from possmap.core.records import Corner, Fix, Pose, Wall
from possmap.core.views import VIEWS
from possmap.errors import OutputError, printable, shown
from possmap.grid.grid import MOST_CELLS, Grid
from possmap.release import version

FRAME = "site: x right, y up, in metres"
MODES = ("trinary", "scale", "raw")
LAYERS = (*(view for view in VIEWS if view != "pignistic_logit"), "points")

A_PART = "take a part of it: --window X0,Y0,X1,Y1"

MOST = 1 << 22
"""Cells of a band, at most: small numbers for them fit in memory beside floats for a few tiles."""

Point: TypeAlias = tuple[float, float]
Marks: TypeAlias = NDArray[np.bool_]
Metres: TypeAlias = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""


@dataclass(frozen=True, slots=True)
class Choices:
    """The options of the formats.

    mode : of a ROS map, one of MODES.
    occupied : a cell is occupied where Bel reaches it, above 0 and at most 1.
    free : else it is free where Pl is not above it, at least 0 and below 1.
    layer : of a picture, one of LAYERS.
    base_rate : of the view probability, between 0 and 1.
    epsg : code of the reference system; None: a local frame.
    offset : where the site's (0, 0) lies in it, x and y [m].
    """

    mode: str = "trinary"
    occupied: float = 0.5
    free: float = 0.5
    layer: str = "belief"
    base_rate: float = 0.5
    epsg: int | None = None
    offset: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name, found, known in (("mode", self.mode, MODES), ("layer", self.layer, LAYERS)):
            if found not in known:
                raise ValueError(
                    f"{name}, found {shown(found)}, expected one of {', '.join(known)}"
                )
        for name in ("occupied", "free", "base_rate"):
            value = getattr(self, name)
            if not 0 <= value <= 1:  # phrased so that NaN is refused too
                raise ValueError(f"{name}, found {value}, expected a number from 0 to 1")


@dataclass(frozen=True, slots=True)
class Job:
    """One export.

    window : the cells to write.
    window_m : the rectangle asked for; None: all that holds evidence.
    outputs : the file asked for, then those that go with it.
    selection : in words, which excursions alone are shown; empty: all.
    """

    grid: Grid
    window: Window
    window_m: Metres | None
    outputs: tuple[Path, ...]
    choices: Choices
    selection: str = ""

    @property
    def name(self) -> str:
        """The grid as a message names it."""
        return printable(str(self.grid.path))

    @property
    def origin(self) -> tuple[float, float]:
        """Lower left corner of the window's first cell [m], without the dust of multiplication."""
        x, y = self.grid.origin(self.window)
        return tidy(x), tidy(y)

    @property
    def frame(self) -> str:
        """In what coordinates are, in words."""
        system = "no geographic reference" if self.choices.epsg is None else ""
        (x, y), code = self.choices.offset, self.choices.epsg
        told = f"{FRAME}; {system or f'EPSG:{code}'}"
        return told if (x, y) == (0, 0) else f"{told}; the site's (0, 0) lies at {x!r}, {y!r}"

    def facts(self, cells_are: str = "") -> Mapping[str, str]:
        """Return what a file says of itself: ASCII, one line each."""
        x, y = self.origin
        making = self.grid.ledger.tracks.making()
        rows, columns = self.window.shape
        found = {
            "possmap": version(),
            "digest": self.grid.digest(),
            **(
                {"refined": f"from the grid of digest {ascii(making.made_of)[1:-1]}"}
                if making
                else {}
            ),
            "resolution": f"{self.grid.resolution!r} m per cell",
            "frame": self.frame,
            "origin": f"{x!r}, {y!r} m, the lower left corner of the first cell",
            "cells": f"{rows} rows x {columns} columns",
            "excursions": ascii(self.selection)[1:-1],
            "cells are": cells_are,
        }
        return {key: fact for key, fact in found.items() if fact}

    def comments(self, cells_are: str = "") -> str:
        """Return the facts as lines of comment."""
        return "".join(f"# {key}: {fact}\n" for key, fact in self.facts(cells_are).items())

    def thresholds(self, otherwise: str = "unknown") -> str:
        """Return in words which cells count as occupied, and which as free."""
        occupied, free = self.choices.occupied, self.choices.free
        return (
            f"occupied where belief >= {occupied:g}, "
            f"else free where plausibility <= {free:g}, else {otherwise}"
        )

    def areas(self) -> Iterator[Window]:
        """Yield the parts of the window whose tiles hold anything, a few tiles at a time."""
        return self.grid.tiles.areas(self.window)

    def filled(
        self,
        band: Window,
        value: Callable[[Window], NDArray[Any]],
        ignorance: float,
        dtype: DTypeLike,
    ) -> NDArray[Any]:
        """Return an array of a band: ``value`` where tiles hold anything, else ``ignorance``."""
        found = np.full(band.shape, ignorance, dtype=dtype)
        for area in self.grid.tiles.areas(band):
            found[area.slices_in(band)] = value(area)
        return found

    def known(self, area: Window) -> Marks:
        """Return which cells of an area hold evidence of any kind."""
        grid = self.grid
        return (grid.necessity(area) > 0) | (grid.possibility(area) < 1) | (grid.points(area) > 0)

    def occupied(self, area: Window) -> Marks:
        """Return which cells of an area are occupied by the threshold."""
        return self.grid.view("belief", area) >= self.choices.occupied

    def free(self, area: Window) -> Marks:
        """Return which cells of an area are free by the thresholds: not if they are occupied.

        A cell that reaches both counts as occupied: the safe side for a robot that plans by the
        map.
        """
        likely = self.grid.view("plausibility", area) <= self.choices.free
        return likely & ~self.occupied(area)

    def outings(self) -> Iterator[LaidOuting]:
        """Yield the excursions one by one, in the order in which they were first fused.

        With a window asked for, only what reaches into it: walls and corners one by one, a track
        whole.
        """
        ledger = self.grid.ledger
        for entry in ledger.entries():
            records, found = ledger.version(entry).records, LaidOuting(entry.robot, entry.excursion)
            for number, at in ledger.geometry(entry).items():
                record = records[number]
                if isinstance(record, Pose):
                    found.poses.append((record, at))
                elif isinstance(record, Wall) and self._reaches([at]):
                    found.walls.append((record, at))
                elif isinstance(record, Corner) and self._reaches([at]):
                    found.corners.append((record, at))
            for record in records:
                if isinstance(record, Fix):
                    rect = ErrorRectangle(record.error_x, record.error_y)
                    at = Geometry.of_point(record.x, record.y, rect)
                    if self._reaches([at]):
                        found.fixes.append((record, at))
            if not self._reaches([at for _, at in found.poses]):
                found.poses.clear()
            yield found

    def _reaches(self, places: Sequence[Geometry]) -> bool:
        """Whether the smallest box around places meets the rectangle asked for, if there is one."""
        if self.window_m is None or not places:
            return self.window_m is None
        x0, y0, x1, y1 = self.window_m
        xs = [x for at in places for x in (at.x, at.x2)]
        ys = [y for at in places for y in (at.y, at.y2)]
        return min(xs) <= x1 and x0 <= max(xs) and min(ys) <= y1 and y0 <= max(ys)


@dataclass(frozen=True, slots=True)
class LaidOuting:
    """One excursion's records that lie on the map, each with its place."""

    robot: str
    excursion: str
    poses: list[tuple[Pose, Geometry]] = field(default_factory=list)
    walls: list[tuple[Wall, Geometry]] = field(default_factory=list)
    corners: list[tuple[Corner, Geometry]] = field(default_factory=list)
    fixes: list[tuple[Fix, Geometry]] = field(default_factory=list)


def bands(window: Window, from_top: bool = False, most: int = MOST) -> Iterator[Window]:
    """Cut a window into bands from its lowest row up, or from its highest down.

    A band lies within one row of tiles: unless the window is very wide, each tile is read once.
    Bands are as wide as the window, unless one row has more than ``most`` cells: then pieces of it
    follow each other.
    """
    columns = max(1, window.shape[1])
    height = TILE
    while height > 1 and height * columns > most:
        height //= 2  # so a border of tiles stays a border of bands
    starts = range(window.row0 // height, -(-window.row1 // height))
    for start in reversed(starts) if from_top else starts:
        row0, row1 = max(window.row0, start * height), min(window.row1, (start + 1) * height)
        for column in range(window.column0, window.column1, most):
            yield Window(row0, row1, column, min(column + most, window.column1))


def chosen_window(grid: Grid, window_m: Metres | None, most: int | None = MOST_CELLS) -> Window:
    """Return the window asked for, or the smallest that holds all evidence.

    Raises
    ------
    OutputError
        If there is no evidence, or the window has more than ``most`` cells.
    """
    name = printable(str(grid.path))
    window = grid.window if window_m is None else grid.lattice.window_of(*window_m)
    if window is None:
        raise OutputError(f"{name}: holds no evidence, so there is nothing to show")
    if most is not None and window.cells > most:
        rows, columns = window.shape
        raise OutputError(f"{name}: {rows} × {columns} cells, expected at most 10⁹; {A_PART}")
    return window


def nothing_in_window(grid: Grid, everything: Window) -> OutputError:
    """Return the error that says where there is something instead."""
    x0, y0 = grid.lattice.corner_of(everything.row0, everything.column0)
    x1, y1 = grid.lattice.corner_of(everything.row1, everything.column1)
    return OutputError(
        f"{printable(str(grid.path))}: nothing in the window; all evidence lies within "
        f"{x0:.2f},{y0:.2f},{x1:.2f},{y1:.2f}"
    )


def refuse_itself(grid: Path, output: Path) -> None:
    """Raise OutputError if the output is the grid itself."""
    try:
        same = output.exists() and output.samefile(grid)
    except OSError:
        return  # writing it says why
    if same:
        raise OutputError(f"{printable(str(output))}: is the grid itself, expected another file")


def tidy(metres: float) -> float:
    """Return a length without the last digits that a product of doubles leaves (7.550000000001)."""
    return round(metres, 12) + 0.0  # no -0.0


def library(job: Job, name: str, extra: str) -> Any:
    """Return a library that comes with an extra of possmap.

    Raises
    ------
    OutputError
        If it is not installed, with the command that installs it, or if it does not work.
    """
    output = printable(str(job.outputs[0]))
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name == name:
            raise OutputError(
                f"{output}: needs {name}, which is not installed: pip install 'possmap[{extra}]'"
            ) from None
        raise OutputError(f"{output}: {name} does not work: {error}") from error
    except ImportError as error:  # a shared library that is not there, say
        reason = " ".join(str(error).split())
        raise OutputError(f"{output}: {name} does not work: {printable(reason)}") from error
