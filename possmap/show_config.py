"""``possmap config``: the settings in force."""

from __future__ import annotations

from pathlib import Path

from possmap.grid.grid import Grid
from possmap.settings.request import Request, in_force
from possmap.settings.settings import Settings


def config(request: Request, grid: Path | None = None) -> Settings:
    """Return the settings that a call would work with, on a grid if one is given.

    Raises
    ------
    SettingsError
        If a given setting is wrong, or differs from the grid's.
    """
    given = request.given()
    if grid is None:
        return in_force(given)
    with Grid(grid) as known:
        return in_force(given, known.stored_settings(), grid)
