"""The baseline ``bayes``: a grid of log-odds from the same ledger, pose errors ignored."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.lab.evaluate.raster import Flags, Floats, Ints
from possmap.lab.evaluate.strokes import Outing, Stroke, floor_cells, line_cells, strokes, way_cells

LogOdds = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class BayesSettings:
    """What a record adds; the defaults are those in common use.

    hit : log-odds that a wall record, or the end of a beam, adds to its cells.
    free : what the floor under the body loses, and the way of a beam up to its hit.
    low, high : between which log-odds are held, after every record.
    body : width of the floor that a run sweeps [m].
    beam_paths : whether beams deny walls on their way.
    """

    hit: float = 0.85
    free: float = 0.40
    low: float = -2.0
    high: float = 3.5
    body: float = 0.15
    beam_paths: bool = True


@dataclass(frozen=True, eq=False)
class LogOddsGrid:
    """A map of log-odds of a wall, 0 where nothing is known; arrays of the window's shape.

    touched : cells of which some record said something.
    """

    log_odds: LogOdds
    touched: Flags


def bayes(
    outings: Iterable[Outing], window: Window, resolution: float, settings: BayesSettings
) -> LogOddsGrid:
    """Add up what each record says of the cells where it puts them, in the order of the ledger.

    The places are the corrected ones: a user who knows the robot's bias would use it too. The
    beams between two poses are one scan, which changes a cell once; a hit beats the way to others.
    """
    log_odds = np.zeros(window.cells, dtype=np.float32)
    touched = np.zeros(window.cells, dtype=np.bool_)
    for outing in outings:
        for stroke in strokes(outing):
            hits, free = _told(stroke, window, resolution, settings)
            for cells, gain in ((free, -settings.free), (hits, settings.hit)):
                held = np.clip(log_odds[cells] + gain, settings.low, settings.high)
                log_odds[cells] = held
                touched[cells] = True
    return LogOddsGrid(log_odds.reshape(window.shape), touched.reshape(window.shape))


def _told(
    stroke: Stroke, window: Window, resolution: float, settings: BayesSettings
) -> tuple[Ints, Ints]:
    """Return the cells that a stroke calls wall, and those that it calls free, each once."""
    hits = _places([line_cells(hit, window, resolution).flat(window) for hit in stroke.hits])
    ways: list[Ints] = []
    if stroke.driven is not None:
        ways.append(floor_cells(stroke.driven, settings.body, window, resolution).flat(window))
    if settings.beam_paths:
        ways += [way_cells(*beam, window, resolution).flat(window) for beam in stroke.seen_through]
    free = _places(ways)
    return hits, np.setdiff1d(free, hits, assume_unique=True) if len(hits) else free


def _places(parts: list[Ints]) -> Ints:
    return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int64)


def probability(log_odds: Floats, base_rate: float) -> Floats:
    """Return the probability of a wall: log-odds are what evidence adds to the base rate's."""
    logit = log_odds + math.log(base_rate / (1 - base_rate))
    found: Floats = 1 / (1 + np.exp(-logit))
    return found
