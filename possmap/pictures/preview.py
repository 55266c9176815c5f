"""``possmap render --show``: the map in the terminal."""

from __future__ import annotations

from pathlib import Path

from possmap.budget import Budget
from possmap.grid.grid import Grid
from possmap.pictures import compose, raster, terminal
from possmap.pictures.render import Look, evidence_window, scene_of
from possmap.pictures.terminal import Depth

__all__ = ["Depth", "preview"]


def preview(
    path: Path,
    look: Look,
    columns: int,
    lines: int,
    colours: Depth,
    budget: Budget | None = None,
) -> str:
    """Return a picture of a grid as text for a terminal of so many columns and lines.

    Raises
    ------
    OutputError
        If there is no evidence.
    """
    name = look.layers[0]
    with Grid(path, budget=budget or Budget()) as grid, grid.snapshot():
        window = evidence_window(grid, look.window_m)
        rows_high, cells_wide = window.shape
        factor = max(cells_wide / columns, rows_high / (2 * lines), 1.0)
        chosen = raster.plan(window, 1, max(1, int(max(window.shape) / factor)))
        index, _ = compose.indices(scene_of(grid, look, chosen), name, chosen)
    if colours != "none":
        return terminal.in_colour(index, compose.colours(name, look.palette), colours)
    return terminal.in_letters(index, compose.letters(name))
