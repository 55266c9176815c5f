"""The walls that refining found, and those that stand where others do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from possmap.refining.association import NONE
from possmap.refining.fitting import UNHEARD, TracksFit
from possmap.refining.problem import TrackProblem
from possmap.refining.runs import CutExcursion, Floats, Ints

FARTHEST_M = 0.6
"""Two faces farther apart are two pieces of furniture."""
LEAST_SHARED = 0.5
"""Share of the shorter one that both have in common along the wall."""

Metres = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class RefinedWall:
    """One face of a wall.

    line : x0, y0, x1, y1 in the site's frame [m].
    sightings, excursions : how many saw it.
    half_width : of its coordinate [m].
    residual : root mean square of its sightings off it, in standard deviations.
    """

    line: Metres
    sightings: int
    excursions: int
    half_width: float
    residual: float


@dataclass(frozen=True, slots=True)
class Rival:
    """A face that some saw where all the others saw it somewhere else, within ``FARTHEST_M``.

    line : where these saw it [m]; apart : how far that is from where the others did [m].
    by : robot and excursion of these; others : how many saw the other one.
    """

    line: Metres
    apart: float
    by: tuple[tuple[str, str], ...]
    others: int


def walls_of(
    excursions: Sequence[CutExcursion], problem: TrackProblem, found: TracksFit
) -> tuple[RefinedWall, ...]:
    """Return the walls that were seen more than once."""
    placed, made = found.placed, []
    for number, mine in enumerate(_members(found.wall_of, len(found.walls))):
        kind = int(placed.kind[mine[0]])
        at = float(found.walls[number])
        ends = at, float(placed.low[mine].min()), float(placed.high[mine].max())
        factor = excursions[placed.excursion[mine[0]]].model.factor
        made.append(
            RefinedWall(
                _line(excursions[0], kind, *ends),
                len(mine),
                len(set(placed.excursion[mine].tolist())),
                factor * float(np.sqrt(found.wall_variances[number])),
                float(np.sqrt(np.mean(found.residuals[mine] ** 2))),
            )
        )
    return tuple(made)


def rivals_of(
    excursions: Sequence[CutExcursion], problem: TrackProblem, found: TracksFit
) -> tuple[Rival, ...]:
    """Return faces, seen once or more, of which others saw only another; the farthest first."""
    placed = found.placed
    told = np.array([why not in UNHEARD for why in found.alone])
    single = np.flatnonzero((found.wall_of == NONE) & told[placed.excursion])
    groups = [*_members(found.wall_of, len(found.walls)), *(np.array([i]) for i in single)]
    kinds = np.array([placed.kind[g[0]] for g in groups], dtype=np.int64)
    at = np.array([float(np.median(placed.coordinate[g])) for g in groups])
    low = np.array([placed.low[g].min() for g in groups])
    high = np.array([placed.high[g].max() for g in groups])
    seen_by = [frozenset(placed.excursion[g].tolist()) for g in groups]
    made: list[tuple[float, Rival]] = []
    for i in range(len(groups)):
        shared = np.minimum(high, high[i]) - np.maximum(low, low[i])
        least = LEAST_SHARED * np.minimum(high - low, high[i] - low[i])
        apart = np.abs(at - at[i])
        near = (kinds == kinds[i]) & (apart <= FARTHEST_M) & (shared > least) & (apart > 0)
        for j in np.flatnonzero(near).tolist():
            more = len(seen_by[j]), len(groups[j]), -j
            if more < (len(seen_by[i]), len(groups[i]), -i) or len(seen_by[j]) < 2:
                continue
            if seen_by[i] & seen_by[j]:
                continue
            by = tuple(sorted(excursions[k].version.name for k in seen_by[i]))
            line = _line(excursions[0], int(kinds[i]), float(at[i]), float(low[i]), float(high[i]))
            made.append((float(apart[j]), Rival(line, float(apart[j]), by, len(seen_by[j]))))
    made.sort(key=lambda one: (-one[0], one[1].line))
    return tuple(rival for _, rival in made)


def _members(wall_of: Ints, count: int) -> list[Ints]:
    """Return the sightings of each wall."""
    order = np.argsort(wall_of, kind="stable")
    cuts = np.searchsorted(wall_of[order], np.arange(count + 1))
    return [order[first:last] for first, last in pairwise(cuts.tolist())]


def _line(one: CutExcursion, kind: int, at: float, low: float, high: float) -> Metres:
    ends: Floats = np.array([[at, low], [at, high]] if kind < 2 else [[low, at], [high, at]])
    (x0, y0), (x1, y1) = one.frame.back(ends).tolist()
    return x0, y0, x1, y1
