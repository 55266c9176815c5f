"""The Python API, small and typed: open a grid, read arrays, fuse logs (docs/python.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from possmap.app.fuse import FuseSummary
from possmap.app.fuse import fuse as _fuse
from possmap.app.settings import Request
from possmap.core.lattice import Window
from possmap.core.views import VIEWS
from possmap.errors import PossmapError
from possmap.files.gridfile.grid import Grid
from possmap.files.settings import Value, parse_setting
from possmap.release import version

__all__ = [
    "VIEWS",
    "FuseSummary",
    "Grid",
    "PossmapError",
    "Window",
    "fuse",
    "open_grid",
    "version",
]


def open_grid(path: str | Path) -> Grid:
    """Open a grid file for reading.

    Raises
    ------
    possmap.PossmapError
        If it is no grid, is damaged, or was written by a newer version.
    """
    return Grid(path)


def fuse(
    logs: Iterable[str | Path],
    grid: str | Path,
    settings: Mapping[str, Value] | None = None,
    *,
    strict: bool = False,
    dry_run: bool = False,
    allow_truncated: bool = False,
) -> FuseSummary:
    """Fuse logs into a grid file, as ``possmap fuse`` does, and return what became of each log.

    Parameters
    ----------
    logs
        Files, folders, or other grids.
    settings
        Flat names, as in a settings file; ``robots.NAME.parameter`` for one robot.

    Raises
    ------
    possmap.PossmapError
        If a setting is wrong or the grid cannot be used. A refused log does not raise: see the
        summary.
    """
    given = {
        name: parse_setting(name, _text(value), "settings")
        for name, value in (settings or {}).items()
    }
    return _fuse(
        [str(log) for log in logs],
        Path(grid),
        Request(overrides=given),
        strict=strict,
        dry_run=dry_run,
        allow_truncated=allow_truncated,
    )


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
