"""Helpers of the tests: logs written to files, grids read back as the literal version has them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import possmap
from possmap.fusing.fuse import FuseSummary
from possmap.settings.settings_yaml import read_profile

ROBUST: Mapping[str, Any] = {name: value for name, (value, _) in read_profile("robust").items()}
"""The settings of the profile ``robust``."""

Cells = dict[tuple[int, int], float]


def flat_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with ``robots`` under flat names, as the Python API takes them."""
    flat = {name: value for name, value in settings.items() if name != "robots"}
    for robot, parameters in settings.get("robots", {}).items():
        flat |= {f"robots.{robot}.{name}": value for name, value in parameters.items()}
    return flat


def write_logs(folder: Path, logs: Sequence[Mapping[str, Any]]) -> list[Path]:
    """Write each log as a JSON file of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{number:03d}.json" for number in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        path.write_text(json.dumps(log))
    return paths


def fuse(logs: Sequence[Path], grid: Path, settings: Mapping[str, Any]) -> FuseSummary:
    """Fuse, and fail unless every log was taken."""
    summary = possmap.fuse(logs, grid, flat_settings(settings))
    assert summary.count("refused") == 0, [log.error for log in summary.logs]
    return summary


def digest(grid: Path) -> str:
    """Return a grid's digest."""
    with possmap.open_grid(grid) as opened:
        return opened.digest()


def cells(grid: Path) -> tuple[Cells, Cells, Cells]:
    """Return N > 0, Π < 1 and the singular points, by (column, row)."""
    with possmap.open_grid(grid) as opened:
        window = opened.window
        if window is None:
            return {}, {}, {}

        def picked(array: np.ndarray[Any, Any], blank: float) -> Cells:
            return {
                (int(column) + window.column0, int(row) + window.row0): float(array[row, column])
                for row, column in np.argwhere(array != blank)
            }

        return (
            picked(opened.necessity(), 0.0),
            picked(opened.possibility(), 1.0),
            picked(opened.points(), 0.0),
        )


def largest_difference(one: Cells, other: Cells, blank: float) -> float:
    """Return how far two maps of cells are apart where they differ most."""
    keys = one.keys() | other.keys()
    return max((abs(one.get(k, blank) - other.get(k, blank)) for k in keys), default=0.0)
