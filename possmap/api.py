"""The Python API, small and typed: open a grid, read arrays, fuse logs (docs/python.md)."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from possmap.core.lattice import Window
from possmap.core.views import VIEWS
from possmap.errors import PossmapError
from possmap.fusing.fuse import FuseSummary
from possmap.fusing.fuse import fuse as _fuse
from possmap.grid.grid import Grid as _Grid
from possmap.inspection.diff import DiffSummary
from possmap.lab.evaluate.results import Evaluation
from possmap.release import version
from possmap.settings.request import Request
from possmap.settings.setting_table import Value, parse_setting

__all__ = [
    "VIEWS",
    "DiffSummary",
    "Evaluation",
    "FuseSummary",
    "Grid",
    "PossmapError",
    "Window",
    "diff",
    "evaluate",
    "fuse",
    "open_grid",
    "version",
]


class PicturedGrid(_Grid):
    """An open grid that a notebook shows as its picture."""

    def _repr_png_(self) -> bytes | None:
        from possmap.pictures.render import Look, picture

        if self.window is None:
            return None
        stream = io.BytesIO()
        picture(self, Look()).save(stream, "PNG")
        return stream.getvalue()


Grid = PicturedGrid
"""What ``open_grid`` returns."""


def open_grid(path: str | Path) -> Grid:
    """Open a grid file for reading.

    Raises
    ------
    possmap.PossmapError
        If it is no grid, is damaged, or was written by a newer version.
    """
    return Grid(path)


def fuse(
    logs: str | Path | Iterable[str | Path],
    grid: str | Path,
    settings: Mapping[str, Value | Mapping[str, Mapping[str, float]]] | None = None,
    *,
    strict: bool = False,
    dry_run: bool = False,
    allow_truncated: bool = False,
) -> FuseSummary:
    """Fuse logs into a grid file, as ``possmap fuse`` does, and return what became of each log.

    Parameters
    ----------
    logs
        Files, folders, or other grids; one or several.
    settings
        As in a settings file: flat names, and ``robots``, a mapping of mappings.

    Raises
    ------
    possmap.PossmapError
        If a setting is wrong or the grid cannot be used. A refused log does not raise: see the
        summary.
    """
    flat: dict[str, Value] = {}
    for name, value in (settings or {}).items():
        if isinstance(value, Mapping):
            for robot, parameters in value.items():
                flat |= {f"{name}.{robot}.{key}": one for key, one in parameters.items()}
        else:
            flat[name] = value
    given = {name: parse_setting(name, _text(value), "settings") for name, value in flat.items()}
    paths = [logs] if isinstance(logs, (str, Path)) else logs
    return _fuse(
        [str(log) for log in paths],
        Path(grid),
        Request(overrides=given),
        strict=strict,
        dry_run=dry_run,
        allow_truncated=allow_truncated,
    )


def evaluate(
    grid: str | Path,
    truth: str | Path,
    *,
    beside: Iterable[str | Path] = (),
    base_rate: float = 0.5,
    truth_resolution: float | None = None,
    truth_origin: tuple[float, float] | None = None,
) -> Evaluation:
    """Hold a grid against the truth, as ``possmap evaluate`` does (docs/evaluate.md).

    Parameters
    ----------
    truth
        A truth file, a ROS ``map.yaml``, or the image of a floor plan.
    beside
        More grids of the same logs, judged on the same cells.
    base_rate
        Of a wall, for the scores of probabilities.
    truth_resolution, truth_origin
        Of an image: metres per pixel, and its lower left corner [m].

    Raises
    ------
    possmap.PossmapError
        If a file cannot be read, or the truth does not belong to the grid.
    """
    from possmap.lab.evaluate.run import Question
    from possmap.lab.evaluate.run import evaluate as _evaluate

    question = Question(
        beside=tuple(map(Path, beside)),
        base_rate=base_rate,
        truth_resolution=truth_resolution,
        truth_origin=truth_origin,
    )
    return _evaluate(Path(grid), Path(truth), question)


def diff(a: str | Path, b: str | Path, *, largest: int = 5) -> DiffSummary:
    """Compare two grid files of one resolution, as ``possmap diff`` does (docs/diff.md).

    Parameters
    ----------
    largest
        How many of the largest changes to name.

    Raises
    ------
    possmap.PossmapError
        If a grid cannot be read, or their resolutions differ.
    """
    from possmap.inspection.diff import diff as _diff

    return _diff(Path(a), Path(b), largest=largest)


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
