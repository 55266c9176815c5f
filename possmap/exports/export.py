"""``possmap export``: a window of a grid, in a format chosen by the output's suffix."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from possmap.atomic import leftovers, replacing_all
from possmap.core.lattice import Window
from possmap.errors import OutputError, did_you_mean, printable, shown
from possmap.exports.cells import holds_evidence
from possmap.exports.cells_csv import write_cells
from possmap.exports.dxf import write_dxf
from possmap.exports.geojson import write_geojson
from possmap.exports.job import Choices, Job
from possmap.exports.npz import write_npz
from possmap.exports.octomap import write_occupied, write_probabilities
from possmap.exports.png import write_layer
from possmap.exports.ros_map import image_beside, write_ros_map
from possmap.exports.svg import write_svg
from possmap.grid.copying import selected
from possmap.grid.grid import MOST_CELLS, Grid
from possmap.grid.selection import Selection


@dataclass(frozen=True, slots=True)
class Format:
    """How one suffix is written.

    write : a job, into a stream for each of its outputs.
    options : names of the Choices that it heeds.
    beside : the files that go with the one asked for.
    may_be_empty : whether a window without evidence is a result too.
    least : what a cell takes on the disk even where nothing is known [bytes].
    """

    write: Callable[[Job, Sequence[BinaryIO]], None]
    options: frozenset[str] = frozenset()
    beside: Callable[[Path, Choices], tuple[Path, ...]] = lambda output, choices: ()
    may_be_empty: bool = False
    least: float = 0.0


_ROS = Format(
    write_ros_map,
    frozenset({"mode", "occupied", "free", "base_rate"}),
    beside=image_beside,
    least=0.001,  # as PNG; a PGM takes a byte
)

FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        ".npz": Format(write_npz, may_be_empty=True, least=0.08),
        ".yaml": _ROS,
        ".yml": _ROS,
        ".geojson": Format(write_geojson, frozenset({"occupied", "free"})),
        ".csv": Format(write_cells),
        ".png": Format(
            write_layer,
            frozenset({"layer", "base_rate"}),
            beside=lambda output, choices: (output.with_suffix(".pgw"),),
            least=0.002,
        ),
        ".svg": Format(write_svg, frozenset({"occupied"})),
        ".dxf": Format(write_dxf, frozenset({"occupied"})),
        ".bt": Format(write_occupied, frozenset({"occupied", "free"})),
        ".ot": Format(write_probabilities, frozenset({"base_rate"})),
    }
)
"""By suffix, in lower case."""

MOST_EMPTY, LEAST_FILLED = 10**8, 0.05
"""A box of so many cells is not written cell by cell unasked, if less of it lies in tiles."""

WRITTEN_WITH = MappingProxyType({".pgm": ".yaml", ".pgw": ".png"})
"""Suffixes that somebody may ask for, with the one that writes them too."""


@dataclass(frozen=True, slots=True)
class ExportSummary:
    """What was written.

    outputs : the file asked for, then those that go with it.
    origin : lower left corner of the first cell [m].
    leftovers : files of exports to these names that were killed, or are not done yet.
    """

    outputs: tuple[Path, ...]
    rows: int
    columns: int
    origin: tuple[float, float]
    resolution: float
    leftovers: tuple[Path, ...] = ()

    @property
    def output(self) -> Path:
        """The file asked for."""
        return self.outputs[0]


def export(
    path: Path,
    output: Path,
    window_m: tuple[float, float, float, float] | None = None,
    overwrite: bool = False,
    choices: Choices | None = None,
    selection: Selection | None = None,
) -> ExportSummary:
    """Write a grid, or a window of it given as x0, y0, x1, y1 [m], or only some excursions.

    Raises
    ------
    OutputError
        For a suffix without a format, no evidence, too many cells, a format whose library is not
        installed, or an output that exists.
    GridError
        If ``path`` is no grid, or holds no such excursion.
    """
    chosen = format_of(output)
    choices, selection = choices or Choices(), selection or Selection()
    outputs = (output, *chosen.beside(output, choices))
    for one in outputs:
        refuse_itself(path, one)
    with selected(path, selection) as shown_path, Grid(shown_path) as grid, grid.snapshot():
        window = chosen_window(grid, window_m)
        if not chosen.may_be_empty:
            refuse_nothing(grid, window)
        if chosen.least and window_m is None:
            refuse_emptiness(grid, window)
        least = 1.0 if any(one.suffix == ".pgm" for one in outputs) else chosen.least
        check_room(output, round(least * window.cells))
        with replacing_all(outputs, overwrite) as streams:
            said = selection.title if selection else ""
            chosen.write(Job(grid, window, window_m, outputs, choices, said), streams)
        left = tuple(leftover for one in outputs for leftover in leftovers(one))
        return ExportSummary(outputs, *window.shape, grid.origin(window), grid.resolution, left)


def check_room(output: Path, least: int) -> None:
    """Raise OutputError if the disk has not even the least room that an output takes [bytes]."""
    try:
        free = shutil.disk_usage(output.resolve().parent).free
    except OSError:
        return  # writing it says why
    if 0 < free < least:  # some file systems tell nothing
        raise OutputError(
            f"{printable(str(output))}: takes {least / 1e6:,.0f} MB at least, and the disk has "
            f"{free / 1e6:,.0f} MB left; take a part of it: --window X0,Y0,X1,Y1"
        )


def format_of(output: Path) -> Format:
    """Return the format of an output's suffix.

    Raises
    ------
    OutputError
        If there is none.
    """
    suffix = output.suffix.lower()
    if suffix in FORMATS:
        return FORMATS[suffix]
    if suffix in WRITTEN_WITH:
        guess = f", expected {WRITTEN_WITH[suffix]}, which writes {suffix} beside it"
    else:
        guess = did_you_mean(suffix, FORMATS) or f", expected one of {', '.join(FORMATS)}"
    raise OutputError(f"{printable(str(output))}: unknown suffix {shown(output.suffix)}{guess}")


def strange_options(output: Path, names: Iterable[str]) -> list[tuple[str, list[str]]]:
    """Return those of the options named that the output's format does not heed.

    With each, the suffixes that do. Empty if there is no such format: exporting says so.
    """
    chosen = FORMATS.get(output.suffix.lower())
    if chosen is None:
        return []
    return [
        (name, [suffix for suffix, one in FORMATS.items() if name in one.options])
        for name in names
        if name not in chosen.options
    ]


def refuse_itself(grid: Path, output: Path) -> None:
    """Raise OutputError if the output is the grid itself."""
    try:
        same = output.exists() and output.samefile(grid)
    except OSError:
        return  # writing it says why
    if same:
        raise OutputError(f"{printable(str(output))}: is the grid itself, expected another file")


def refuse_nothing(grid: Grid, window: Window) -> None:
    """Raise OutputError if no cell of a window holds evidence."""
    everything = chosen_window(grid, None, most=None)
    if holds_evidence(grid, window):
        return
    x0, y0 = grid.lattice.corner_of(everything.row0, everything.column0)
    x1, y1 = grid.lattice.corner_of(everything.row1, everything.column1)
    raise OutputError(
        f"{printable(str(grid.path))}: nothing in the window; all evidence lies within "
        f"{x0:.2f},{y0:.2f},{x1:.2f},{y1:.2f}"
    )


def refuse_emptiness(grid: Grid, window: Window) -> None:
    """Raise OutputError if the box around all evidence is large, and next to nothing is in it."""
    held = sum(area.cells for area in grid.tiles.areas(window))
    if window.cells > MOST_EMPTY and held < window.cells * LEAST_FILLED:
        rows, columns = window.shape
        raise OutputError(
            f"{printable(str(grid.path))}: {rows} × {columns} cells, of which tiles with evidence "
            f"hold {held / window.cells:.1%}; take a part of it, or all: --window X0,Y0,X1,Y1"
        )


def chosen_window(
    grid: Grid,
    window_m: tuple[float, float, float, float] | None,
    most: int | None = MOST_CELLS,
) -> Window:
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
        raise OutputError(
            f"{name}: {rows} × {columns} cells, expected at most 10⁹; "
            "take a part of it: --window X0,Y0,X1,Y1"
        )
    return window
