"""Walls found and tracks moved in turn, until both stay; who does not fit is left alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.refining.association import AMBIGUOUS, NONE, PlacedSightings, associate
from possmap.refining.problem import TrackProblem
from possmap.refining.runs import CutExcursion, Floats, Ints

ROUNDS = 4
"""How often walls are found anew, with tracks moved by what the last round found."""
STEPS = 3
"""How often a round solves, with directions and weights of the solution before."""
ROBUST = 3.0
"""Standard deviations at which a residual begins to count little (Geman and McClure's)."""

LEAST_SCALE, MOST_SCALE = 0.4, 4.0
"""How much better or worse than their models say robots may see walls."""
SLACK = 1.5
"""Tracks yield to sightings, which so seem to agree better than they do."""

NOT_ASKED, NOT_ORTHOGONAL = "not asked for", "its walls are not along the axes"
UNHEARD = (NOT_ASKED, NOT_ORTHOGONAL)
"""Why an excursion may have no part in the walls from the beginning."""
FEWEST = 2
"""Sightings of walls without which an excursion is left alone."""
DOUBTFUL = 3.0
"""Standard deviations from its wall, or from where the filter had a pose, that are too many."""
LEAST_MOVED_M = 0.05
"""No pose was so sure that it may not move by this."""
MOST_DOUBTFUL = 0.1
"""Share of an excursion's sightings, or poses, that may be so."""


@dataclass(frozen=True, slots=True, eq=False)
class TracksFit:
    """What the last round found.

    Attributes
    ----------
    nodes, heading, variances
        Of all nodes: place [m], h [rad] of the run that begins there (0 at an excursion's last) and
        the variances of x, y and h; shapes (nodes, 2), (nodes,) and (nodes, 3).
    wall_of
        Of each sighting: the number of its wall, or why it has none.
    placed
        Where the sightings lay when walls were found last.
    walls, wall_variances
        Coordinates of walls [m], and their variances.
    residuals
        Of each sighting [standard deviations]; 0 without a wall.
    alone
        Why an excursion was left alone; empty: it was moved.
    """

    nodes: Floats
    heading: Floats
    variances: Floats
    wall_of: Ints
    placed: PlacedSightings
    walls: Floats
    wall_variances: Floats
    residuals: Floats
    alone: tuple[str, ...]


def fit(
    excursions: Sequence[CutExcursion], problem: TrackProblem, robots: Collection[str]
) -> TracksFit:
    """Fit all excursions to each other.

    robots : whose excursions may be moved; none: all.
    """
    alone = [
        NOT_ASKED if robots and one.version.robot not in robots
        else "" if one.is_orthogonal else NOT_ORTHOGONAL
        for one in excursions
    ]  # fmt: skip
    nobody = np.full(len(problem.kind), NONE)
    scale = 1.0
    now = _solved(problem, nobody, np.zeros(len(problem.owner)), scale)
    for number in range(ROUNDS):
        placed, chosen = _placed(problem, now, alone, scale)
        wall_of = np.full(len(problem.kind), NONE)
        wall_of[chosen] = associate(placed)
        now = _solved(problem, wall_of, now.heading, scale)
        if number < ROUNDS - 1:
            scale = float(
                np.clip(
                    scale * SLACK * _spread(now.residuals[wall_of >= 0]), LEAST_SCALE, MOST_SCALE
                )
            )
        if number == ROUNDS - 2:
            alone = [
                why or _misfit(one, problem, i, now, wall_of)
                for i, (one, why) in enumerate(zip(excursions, alone, strict=True))
            ]
    every, _ = _placed(problem, now, [""] * len(excursions), scale)
    heading = np.zeros(len(now.nodes))
    heading[problem.node] = now.heading
    return TracksFit(
        now.nodes, heading, now.variances, wall_of, every, now.walls, now.wall_variances,
        now.residuals, tuple(alone),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """As in ``TracksFit``, but for ``heading``: of each run."""

    nodes: Floats
    heading: Floats
    variances: Floats
    walls: Floats
    wall_variances: Floats
    residuals: Floats


def _spread(residuals: Floats) -> float:
    """Return the root mean square of residuals, of each 9 at most; 1 without any."""
    return float(np.sqrt(np.mean(np.minimum(residuals**2, 9.0)))) if len(residuals) else 1.0


def _solved(problem: TrackProblem, wall_of: Ints, heading: Floats, scale: float) -> _Solved:
    """Solve for one association, weighing residuals by the solution before."""
    weights, seen = np.ones(len(wall_of)), np.ones(len(problem.seen_sd))
    rows = np.arange(len(wall_of))
    for step in range(STEPS):
        found = problem.solve(wall_of, heading, weights / scale**2, seen, step == STEPS - 1)
        main = found.main.reshape(-1, 3)
        nodes, heading = main[:, :2], main[problem.node, 2]
        walls = np.append(found.walls, 0.0)  # for those of no wall, numbered below 0
        off = problem.middles(nodes)[rows, problem.normal] - walls[np.maximum(wall_of, -1)]
        residuals = np.where(wall_of >= 0, off / (scale * problem.noise_sd), 0.0)
        weights = _weights(residuals)
        seen = _weights((problem.seen_off + heading[problem.seen_run]) / problem.seen_sd)
    assert found.main_variances is not None
    assert found.wall_variances is not None
    variances = found.main_variances.reshape(-1, 3)
    return _Solved(nodes, heading, variances, found.walls, found.wall_variances, residuals)


def _weights(residuals: Floats) -> Floats:
    weights: Floats = (ROBUST**2 / (ROBUST**2 + residuals**2)) ** 2
    return weights


def _placed(
    problem: TrackProblem, now: _Solved, alone: Sequence[str], scale: float
) -> tuple[PlacedSightings, Ints]:
    """Return where the sightings of those who are not left alone lie, and their numbers."""
    middles, rows = problem.middles(now.nodes), np.arange(len(problem.kind))
    along = middles[rows, 1 - problem.normal]
    asked = np.array([not why for why in alone], dtype=bool)
    chosen = np.flatnonzero(asked[problem.sighting_owner])
    placed = PlacedSightings(
        problem.sighting_owner[chosen],
        problem.kind[chosen],
        middles[rows, problem.normal][chosen],
        (along + problem.low)[chosen],
        (along + problem.high)[chosen],
        problem.at_sightings(now.variances)[chosen],
        (scale * problem.noise_sd[chosen]) ** 2,
    )
    return placed, chosen


def _misfit(
    one: CutExcursion, problem: TrackProblem, number: int, now: _Solved, wall_of: Ints
) -> str:
    """Return why an excursion is to be left alone, if it is."""
    mine = problem.sighting_owner == number
    used, ambiguous = int((wall_of[mine] >= 0).sum()), int((wall_of[mine] == AMBIGUOUS).sum())
    if used < FEWEST:
        return "few sightings"
    if ambiguous > used:
        return "ambiguous"
    doubtful = int((np.abs(now.residuals[mine]) > DOUBTFUL).sum())
    if doubtful > max(1.0, MOST_DOUBTFUL * used):
        return f"misfit: {doubtful} of {used} sightings"
    first, last = problem.first_node[number], problem.first_node[number + 1]
    places, _ = one.laid(now.nodes[first:last], now.variances[first:last])
    before = one.poses[:, 4:]
    most = DOUBTFUL / one.model.factor * np.maximum(before[:, 2:], LEAST_MOVED_M)
    far = float((np.abs(places - before[:, :2]) > most).any(axis=1).mean())
    if far > MOST_DOUBTFUL:
        return f"misfit: {far:.0%} of its poses moved too far"
    return ""
