"""What ``possmap refine`` finds: tracks and walls, and who was left alone.

Nothing here depends on the order in which excursions came.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from possmap.core.model import ErrorModel
from possmap.core.records import PartialMap
from possmap.core.refined import RefinedPose, RefinedTrack
from possmap.core.settings import EvidenceSettings
from possmap.refining.association import AMBIGUOUS
from possmap.refining.cutting import cut
from possmap.refining.fitting import DOUBTFUL, TracksFit, fit
from possmap.refining.problem import TrackProblem
from possmap.refining.runs import CutExcursion, Floats
from possmap.refining.walls import RefinedWall, Rival, rivals_of, walls_of

LEAST_HALF = 0.6
"""No refined place is better known than this, in cells: what lies in a cell may, rounded to the
lattice, be stamped into the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedOuting:
    """What became of one excursion.

    Attributes
    ----------
    alone
        Why it was left where it was; empty: it was moved.
    sightings, used, ambiguous
        Of walls: how many it holds, how many met a wall that was seen more than once, and how many
        might have met either of two.
    moved, most_moved
        Mean and most of what its poses moved [m]; 0 if it was left alone.
    residual
        Root mean square of its sightings off their walls, in standard deviations.
    doubtful
        seq of wall records that lie more than three of those off.
    half_before, half_after
        Mean half-width of its poses [m].
    """

    robot: str
    excursion: str
    alone: str
    sightings: int
    used: int
    ambiguous: int
    moved: float
    most_moved: float
    residual: float
    doubtful: tuple[int, ...]
    half_before: float
    half_after: float


@dataclass(frozen=True, slots=True)
class Refinement:
    """What refining found.

    tracks : of every excursion that was moved, by robot and excursion.
    outings : all excursions, by robot and name.
    walls : those that were seen more than once.
    rivals : walls that stand where others, by all others, do not.
    """

    tracks: Mapping[tuple[str, str], RefinedTrack]
    outings: tuple[MovedOuting, ...]
    walls: tuple[RefinedWall, ...]
    rivals: tuple[Rival, ...]


def refine(
    versions: Iterable[tuple[PartialMap, ErrorModel]],
    settings: EvidenceSettings,
    robots: Collection[str] = (),
) -> Refinement:
    """Move tracks so that sightings of one wall agree.

    Parameters
    ----------
    versions
        Every excursion, with the model in force.
    settings
        The grid's; estimator ``walls``.
    robots
        Whose tracks may be moved; none: all.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the errors of the models are such that nothing can be solved.
    """
    ordered = sorted(versions, key=lambda one: one[0].name)
    excursions = [(version, cut(version, model, settings)) for version, model in ordered]
    moving = [one for _, one in excursions if one is not None]
    if not moving:
        return Refinement({}, tuple(_idle(version) for version, _ in excursions), (), ())
    problem = TrackProblem(moving)
    found = fit(moving, problem, robots)
    tracks: dict[tuple[str, str], RefinedTrack] = {}
    outings, number = [], 0
    for version, one in excursions:
        if one is None:
            outings.append(_idle(version))
            continue
        poses = _poses(one, problem, number, found, LEAST_HALF * settings.resolution)
        outings.append(_outing(one, problem, number, found, poses))
        if not found.alone[number]:
            tracks[version.name] = [RefinedPose(*row) for row in poses.tolist()]
        number += 1
    walls = walls_of(moving, problem, found)
    return Refinement(tracks, tuple(outings), walls, rivals_of(moving, problem, found))


def _idle(version: PartialMap) -> MovedOuting:
    return MovedOuting(
        robot=version.robot, excursion=version.excursion, alone="it never ran",
        sightings=0, used=0, ambiguous=0, moved=0.0, most_moved=0.0, residual=0.0, doubtful=(),
        half_before=0.0, half_after=0.0,
    )  # fmt: skip


def _poses(
    one: CutExcursion, problem: TrackProblem, number: int, found: TracksFit, least: float
) -> Floats:
    """Return the refined poses of an excursion, the fields of ``RefinedPose``; shape (poses, 6).

    least : no half-width is smaller [m].
    """
    first, last = problem.first_node[number], problem.first_node[number + 1]
    places, halves = one.laid(found.nodes[first:last], found.variances[first:last])
    run = first + one.poses[:, 0].astype(np.int64)
    error = one.poses[:, 3] + np.where(one.poses[:, 1] > 0, found.heading[run], 0.0)
    heading_half = one.model.factor * np.sqrt(found.variances[run, 2])
    return np.column_stack([places, np.maximum(halves, least), error, heading_half])


def _outing(
    one: CutExcursion, problem: TrackProblem, number: int, found: TracksFit, poses: Floats
) -> MovedOuting:
    mine = np.flatnonzero(problem.sighting_owner == number)
    wall_of, residuals = found.wall_of[mine], found.residuals[mine]
    met = wall_of >= 0
    alone = found.alone[number]
    before = one.poses[:, 4:]
    moved = np.zeros(1) if alone else np.hypot(*(poses[:, :2] - before[:, :2]).T)
    doubtful = np.flatnonzero(np.abs(residuals) > DOUBTFUL)
    records = one.version.records
    return MovedOuting(
        robot=one.version.robot,
        excursion=one.version.excursion,
        alone=alone,
        sightings=len(mine),
        used=int(met.sum()),
        ambiguous=int((wall_of == AMBIGUOUS).sum()),
        moved=float(moved.mean()),
        most_moved=float(moved.max()),
        residual=float(np.sqrt(np.mean(residuals[met] ** 2))) if met.any() else 0.0,
        doubtful=tuple(records[one.sightings[i].record].seq for i in doubtful.tolist()),
        half_before=float(before[:, 2:].mean()),
        half_after=float((before[:, 2:] if alone else poses[:, 2:4]).mean()),
    )
