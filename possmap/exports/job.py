"""What one export is asked to write, and what every export says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from possmap.core.lattice import Window
from possmap.core.views import VIEWS
from possmap.errors import OutputError, printable, shown
from possmap.grid.grid import Grid
from possmap.release import version

FRAME = "site: x right, y up, in metres; no geographic reference"
MODES = ("trinary", "scale", "raw")
LAYERS = (*(view for view in VIEWS if view != "pignistic_logit"), "points")

Metres = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""


@dataclass(frozen=True, slots=True)
class Choices:
    """The options of the formats.

    mode : of a ROS map, one of MODES.
    occupied : a cell is occupied where Bel reaches it, above 0 and at most 1.
    free : else it is free where Pl is not above it, at least 0 and below 1.
    layer : of a picture, one of LAYERS.
    base_rate : of the view probability, between 0 and 1.
    """

    mode: str = "trinary"
    occupied: float = 0.5
    free: float = 0.5
    layer: str = "belief"
    base_rate: float = 0.5

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ValueError(f"mode, found {shown(self.mode)}, expected one of {', '.join(MODES)}")
        if self.layer not in LAYERS:
            known = ", ".join(LAYERS)
            raise ValueError(f"layer, found {shown(self.layer)}, expected one of {known}")
        if not 0 < self.occupied <= 1:
            raise ValueError(f"occupied, found {self.occupied}, expected above 0 and at most 1")
        if not 0 <= self.free < 1:
            raise ValueError(f"free, found {self.free}, expected at least 0 and below 1")
        if not 0 < self.base_rate < 1:
            raise ValueError(f"base_rate, found {self.base_rate}, expected between 0 and 1")


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

    def facts(self) -> Mapping[str, str]:
        """Return what a file says of itself: ASCII, one line each."""
        x, y = self.origin
        making = self.grid.ledger.tracks.making()
        rows, columns = self.window.shape
        return {
            "possmap": version(),
            "digest": self.grid.digest(),
            **(
                {"refined": f"from the grid of digest {ascii(making.made_of)[1:-1]}"}
                if making
                else {}
            ),
            "resolution": f"{self.grid.resolution!r} m per cell",
            "frame": FRAME,
            "origin": f"{x!r}, {y!r} m, the lower left corner of the first cell",
            "cells": f"{rows} rows x {columns} columns",
            **({"excursions": ascii(self.selection)[1:-1]} if self.selection else {}),
        }

    def thresholds(self) -> str:
        """Return in words which cells count as occupied, and which as free."""
        occupied, free = self.choices.occupied, self.choices.free
        return (
            f"occupied where belief >= {occupied:g}, "
            f"else free where plausibility <= {free:g}, else unknown"
        )


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
