"""``possmap export``: a window of a grid, in a format chosen by the output's suffix."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from possmap.atomic import leftovers, replacing_all
from possmap.errors import OutputError, did_you_mean, printable, shown
from possmap.exports.arrays import write_cells, write_npz
from possmap.exports.drawings import write_dxf, write_svg
from possmap.exports.geojson import write_geojson
from possmap.exports.job import (
    A_PART,
    Choices,
    Job,
    Metres,
    chosen_window,
    nothing_in_window,
    refuse_itself,
)
from possmap.exports.mcap import write_mcap
from possmap.exports.octomap import write_occupied, write_probabilities
from possmap.exports.png import write_layer
from possmap.exports.ros_map import image_beside, write_ros_map
from possmap.grid.copying import selected
from possmap.grid.grid import Grid
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
        ".mcap": Format(
            write_mcap, frozenset({"mode", "occupied", "free", "base_rate"}), least=1.0
        ),
        ".geojson": Format(write_geojson, frozenset({"occupied", "free", "epsg", "offset"})),
        ".csv": Format(write_cells),
        ".png": Format(
            write_layer,
            frozenset({"layer", "base_rate", "offset"}),
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
    window_m: Metres | None = None,
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
    with selected(path, selection) as part, Grid(part) as grid, grid.snapshot():
        grid.path = path  # in messages
        window = chosen_window(grid, window_m)
        said = selection.title if selection else ""
        job = Job(grid, window, window_m, outputs, choices, said)
        if not chosen.may_be_empty and not any(job.known(area).any() for area in job.areas()):
            raise nothing_in_window(grid, chosen_window(grid, None, most=None))
        if chosen.least and window_m is None:
            refuse_emptiness(job)
        least = 1.0 if any(one.suffix == ".pgm" for one in outputs) else chosen.least
        check_room(output, round(least * window.cells))
        with replacing_all(outputs, overwrite) as streams:
            chosen.write(job, streams)
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
            f"{free / 1e6:,.0f} MB left; {A_PART}"
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


def refuse_emptiness(job: Job) -> None:
    """Raise OutputError if the box around all evidence is large, and next to nothing is in it."""
    cells, (rows, columns) = job.window.cells, job.window.shape
    held = sum(area.cells for area in job.areas())
    if cells > MOST_EMPTY and held < cells * LEAST_FILLED:
        raise OutputError(
            f"{job.name}: {rows} × {columns} cells, of which tiles with evidence hold "
            f"{held / cells:.1%}; take a part of it, or all: --window X0,Y0,X1,Y1"
        )
