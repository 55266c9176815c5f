"""``possmap export``: a window of a grid, in a format chosen by the output's suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from possmap.core.lattice import Window
from possmap.errors import OutputError, did_you_mean, printable, shown
from possmap.files.atomic import replacing
from possmap.files.gridfile.grid import MOST_CELLS, Grid
from possmap.files.npz import write_npz

FORMATS: Mapping[str, Callable[[Grid, Window, BinaryIO], None]] = MappingProxyType(
    {".npz": write_npz}
)


@dataclass(frozen=True, slots=True)
class ExportSummary:
    """What was written. ``origin``: lower left corner of the first cell [m]."""

    output: Path
    rows: int
    columns: int
    origin: tuple[float, float]
    resolution: float


def export(
    path: Path,
    output: Path,
    window_m: tuple[float, float, float, float] | None = None,
    overwrite: bool = False,
) -> ExportSummary:
    """Write a grid, or a window of it given as x0, y0, x1, y1 [m].

    Raises
    ------
    OutputError
        For a suffix without a format, no evidence, too many cells, or an output that exists.
    GridError
        If ``path`` is no grid.
    """
    write = FORMATS.get(output.suffix.lower())
    if write is None:
        guess = did_you_mean(output.suffix, FORMATS) or f", expected one of {', '.join(FORMATS)}"
        raise OutputError(f"{printable(str(output))}: unknown suffix {shown(output.suffix)}{guess}")
    refuse_itself(path, output)
    with Grid(path) as grid, grid.snapshot():
        window = chosen_window(grid, window_m)
        with replacing(output, overwrite) as stream:
            write(grid, window, stream)
        return ExportSummary(output, *window.shape, grid.origin(window), grid.resolution)


def refuse_itself(grid: Path, output: Path) -> None:
    """Raise OutputError if the output is the grid itself."""
    try:
        same = output.exists() and output.samefile(grid)
    except OSError:
        return  # writing it says why
    if same:
        raise OutputError(f"{printable(str(output))}: is the grid itself, expected another file")


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
