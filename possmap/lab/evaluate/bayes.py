"""The baseline ``bayes``: a grid of log-odds from the same ledger, pose errors ignored."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.lab.evaluate.observations import JudgedExcursion, Observation, Rasterizer, observations
from possmap.lab.evaluate.raster import Flags, Floats, Ints

LogOdds = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOddsSettings:
    """What a record adds; the defaults are those in common use.

    hit : log-odds that a wall record, or the end of a beam, adds to its cells.
    free : what the floor under the body loses, and the way of a beam up to its hit.
    low, high : between which log-odds are held.
    body : width of the floor that a run sweeps [m].
    """

    hit: float = 0.85
    free: float = 0.40
    low: float = -2.0
    high: float = 3.5
    body: float = 0.15


@dataclass(frozen=True, eq=False)
class LogOddsGrid:
    """A map of log-odds of a wall, 0 where nothing is known; arrays of the window's shape.

    touched : cells of which some record said something.
    """

    log_odds: LogOdds
    touched: Flags


def bayes(
    excursions: Iterable[JudgedExcursion],
    window: Window,
    resolution: float,
    settings: LogOddsSettings,
) -> LogOddsGrid:
    """Add up what each record says of the cells where it puts them, in the order of the ledger.

    The places are the corrected ones: a user who knows the robot's bias would use it too. The
    beams between two poses are one scan, which changes a cell once; a hit beats the way to others.
    Log-odds are held within their bounds after every record.
    """
    log_odds = np.zeros(window.cells, dtype=np.float32)
    touched = np.zeros(window.cells, dtype=np.bool_)
    raster = Rasterizer(window, resolution)
    for excursion in excursions:
        for one in observations(excursion):
            hits, free = _told(one, raster, settings)
            for cells, gain in ((free, -settings.free), (hits, settings.hit)):
                log_odds[cells] = np.clip(log_odds[cells] + gain, settings.low, settings.high)
                touched[cells] = True
    return LogOddsGrid(log_odds.reshape(window.shape), touched.reshape(window.shape))


def _told(one: Observation, raster: Rasterizer, settings: LogOddsSettings) -> tuple[Ints, Ints]:
    """Return the cells that an observation calls wall, and those it calls free, each once."""
    hits = _places([raster.line(hit).flat(raster.window) for hit in one.hits])
    ways = [raster.seen_through(*beam).flat(raster.window) for beam in one.seen_through]
    if one.driven is not None:
        ways.append(raster.floor(one.driven, settings.body).flat(raster.window))
    free = _places(ways)
    return hits, np.setdiff1d(free, hits, assume_unique=True) if len(hits) else free


def _places(parts: list[Ints]) -> Ints:
    return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int64)


def probability(log_odds: Floats, base_rate: float) -> Floats:
    """Return the probability of a wall: log-odds are what evidence adds to the base rate's."""
    logit = log_odds + math.log(base_rate / (1 - base_rate))
    found: Floats = 1 / (1 + np.exp(-logit))
    return found
