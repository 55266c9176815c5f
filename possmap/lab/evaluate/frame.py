"""Whether truth and map share a frame: robots that know their place see its walls, and no others.

Nor do they drive through them. Where tracks match the logs, what was seen from the true places is
asked instead, so that a wrong error model cannot hide behind the check.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from possmap.core.evidence import Segment
from possmap.core.records import PartialMap
from possmap.errors import PossmapError, printable
from possmap.lab.evaluate.observations import JudgedExcursion, Rasterizer, observations
from possmap.lab.evaluate.raster import Floats, Segments, cells_of, extent_of
from possmap.lab.evaluate.tracks import apart, matched
from possmap.lab.evaluate.true_poses import true_walls
from possmap.truth.truth import Truth

SURE_M = 0.15
"""Robots know their place where both half-widths are smaller [m]."""

LEAST_M = 0.5
"""Shorter runs are not asked: they hardly ever meet a wall [m]."""

NEAR_M = 0.5
"""So near to a true wall lies what a robot that knows its place saw of one [m]."""

DOUBTFUL, IMPOSSIBLE, FROM_TRACKS = 0.1, 0.5, 0.25
"""Share of what robots that know their place did or saw which the truth may belie.

Above the first there is a note, above the second a refusal: a robot whose error model is wrong may
also not be where it is sure to be, and that is worth an evaluation. True tracks leave less
room."""

ROUNDED_M = 0.01
"""How far a pose as logged may lie from what the truth says was believed [m]."""


class TruthError(PossmapError):
    """A truth that does not belong to the grid, or leaves nothing to judge."""


class Witnesses(NamedTuple):
    """How many things robots that know their place report, and how many the truth belies."""

    asked: int
    belied: int
    what: str


def doubts_of_frame(
    excursions: Sequence[JudgedExcursion], truth: Truth, path: Path, resolution: float
) -> tuple[str, ...]:
    """Refuse a truth that cannot be that of a grid; return what makes one doubt it.

    Raises
    ------
    TruthError
        If nothing of it is where the map is, robots would have driven through its walls, or its
        tracks are those of other logs.
    """
    name = printable(str(path))
    if not truth.walls:
        raise TruthError(f"{name}: found no walls, expected some")
    walls = np.array(truth.walls, dtype=np.float64)
    refuse_other_logs(excursions, truth, name)
    laid = [true_walls(*one) for one in _tracked(excursions, truth)]
    saw = "walls lie near none of its walls, as seen"
    if laid:
        told = [_sightings(np.concatenate(laid), walls, f"{saw} from its tracks")]
        return _doubts(name, told, FROM_TRACKS)
    every = [one for excursion in excursions for one in observations(excursion)]
    seen = [(hit.x0, hit.y0, hit.x1, hit.y1) for one in every for hit in one.hits if _knows(hit)]
    runs = [
        one.driven
        for one in every
        if one.driven is not None and _knows(one.driven) and _reach(one.driven) >= LEAST_M
    ]
    told = [
        _sightings(np.array(seen).reshape(-1, 4), walls, f"{saw} by robots that knew their place"),
        Witnesses(
            len(runs),
            sum(_crossings(runs, walls, resolution)) if runs else 0,
            "runs by robots that knew their place go through its walls",
        ),
    ]
    return _doubts(name, told, IMPOSSIBLE)


def refuse_other_logs(excursions: Sequence[JudgedExcursion], truth: Truth, name: str) -> None:
    """Refuse a truth whose robots believed themselves elsewhere than the logs have them.

    Raises
    ------
    TruthError
        If its tracks are those of other logs.
    """
    for version, track, rows in _tracked(excursions, truth):
        off = float(np.median(apart(version, track, rows)))
        if off > ROUNDED_M:
            raise TruthError(
                f"{name}: excursion {version.excursion} of {version.robot} believed itself "
                f"{off:.2f} m from where the log has it, expected the logs' own truth"
            )


def _tracked(
    excursions: Sequence[JudgedExcursion], truth: Truth
) -> Iterator[tuple[PartialMap, Floats, dict[int, int]]]:
    for excursion in excursions:
        track = truth.tracks.get(excursion.version.name)
        rows = {} if track is None else matched(excursion.version, track)
        if track is not None and rows:
            yield excursion.version, track, rows


def _doubts(name: str, told: Sequence[Witnesses], impossible: float) -> tuple[str, ...]:
    """Refuse a truth that too large a share of witnesses belie, and return what some do."""
    found = []
    for asked, belied, what in told:
        line = f"{name}: {belied} of {asked} {what}: is it of another frame or resolution?"
        if belied > impossible * asked:
            raise TruthError(line)
        if belied > DOUBTFUL * asked:
            found.append(line)
    return tuple(found)


def _knows(run: Segment) -> bool:
    one, other = run.rect0, run.rect1
    return max(one.half_x, one.half_y, other.half_x, other.half_y) < SURE_M


def _reach(run: Segment) -> float:
    return max(abs(run.x1 - run.x0), abs(run.y1 - run.y0))


def _crossings(runs: Sequence[Segment], walls: Segments, resolution: float) -> Iterator[bool]:
    """Tell of each run whether it goes through a true wall."""
    extent = extent_of(np.array([(r.x0, r.y0, r.x1, r.y1) for r in runs]), resolution)
    window = extent.intersection(extent_of(walls, resolution))
    solid, raster = cells_of(walls, window, resolution).ravel(), Rasterizer(window, resolution)
    return (bool(solid[raster.line(run).flat(window)].any()) for run in runs)


def _sightings(seen: Segments, walls: Segments, what: str) -> Witnesses:
    """Count walls that were seen, and those whose middle lies near no true wall."""
    away = distances((seen[:, :2] + seen[:, 2:]) / 2, walls)
    return Witnesses(len(seen), int((away > NEAR_M).sum()), what)


def distances(points: Floats, walls: Segments) -> Floats:
    """Return how far points, shape (m, 2), lie from the nearest of some walls [m]; shape (m,)."""
    found = np.full(len(points), np.inf)
    step = max(1, 2_000_000 // max(1, len(walls)))  # bounds memory
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    square = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
    for k in range(0, len(points), step):
        off = points[k : k + step, None, :] - start[None]
        share = np.clip((off * along).sum(axis=2) / square, 0.0, 1.0)
        apart_m = np.hypot(*np.moveaxis(off - share[:, :, None] * along, 2, 0))
        found[k : k + step] = apart_m.min(axis=1, initial=np.inf)
    return found
