"""Excursions cut into runs, beside the filter that lays them out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.placing import placed
from possmap.core.propagation import StretchErrors
from possmap.core.records import PartialMap, Pose, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import Stretch, fixes, stretches
from possmap.core.walls import (
    LEAST_LENGTH_M,
    LEAST_SPREAD_DEG,
    WallFilter,
    is_relabelling,
    is_told,
)
from possmap.refining.runs import CutExcursion, Floats, Frame, Place, Sighting

LEAST_WALL_M = 0.25
"""A shorter piece of wall does not tell in which direction it stands."""
MOST_TILT = math.radians(15)
"""A piece that stands farther off both axes is none of the building's walls [rad]."""
MOST_LEVER = 5.0
"""A wall seen so many lengths of its run away from it lies anywhere."""
LEAST_TURN = 1e-4
"""No heading is known better from one run to the next [rad, half-width]."""


class _Step(NamedTuple):
    """A stretch as the filter laid it.

    began : whether it began a run; heading_half : H before it [rad].
    known, parts : what its turn adds to the heading error [rad], and 45° turned.
    is_told : whether the log tells of its turn.
    """

    laid: CorrectedStretch
    errors: StretchErrors
    began: bool
    heading_half: float
    known: float
    parts: float
    is_told: bool


def cut(version: PartialMap, model: ErrorModel, settings: EvidenceSettings) -> CutExcursion | None:
    """Cut an excursion into runs; None if it has none."""
    version = placed(version, model)
    first = next((one for one in version.records if isinstance(one, Pose)), None)
    track = stretches(version.records)
    if first is None or not any(one.is_run for one in track):
        return None
    now = WallFilter(first, model, settings)
    start = (first.x, first.y, *now.rectangle)
    steps: list[_Step] = []
    for logged, following in zip_longest(track, track[1:]):
        heading_half = now.heading_half
        laid, errors = now.advance(logged, following)
        turn = _turn(logged, following, model)
        steps.append(_Step(laid, errors, now.began, heading_half, *turn))
    starts = [number for number, step in enumerate(steps) if step.began]
    groups = [steps[i:j] for i, j in pairwise([*starts, len(steps)])]
    before = [steps[: starts[0]], *groups[:-1]]
    frame = Frame(settings)
    chord = [frame.turned(_sum(group)) for group in groups]
    poses: list[tuple[float, ...]] = [(0, 0.0, 0.0, 0.0, *start)]
    poses += [(0, 0.0, 0.0, _heading_error(s), *s.laid.end, *s.errors.end) for s in before[0]]
    seen: list[tuple[float, float, float]] = []
    sightings: list[Sighting] = []
    for run, group in enumerate(groups):
        poses += _poses(run, group, chord[run], frame)
        seen += _seen(run, group, model, frame)
        sightings += _sightings(run, group, chord[run], model, frame)
    return CutExcursion(
        version,
        model,
        now.observations,
        start=np.array(frame.turned((first.x, first.y))),
        start_half=np.array([first.error_x, first.error_y]),
        chord=np.array(chord),
        **_turns(groups, before, first, model),
        seen=np.array(seen, dtype=np.float64).reshape(-1, 3),
        sightings=tuple(sightings),
        fixed=_fixed(version, frame, [row[3] if row[1] else _angle(groups[0]) for row in poses]),
        poses=np.array(poses),
        frame=frame,
    )


def _fixed(version: PartialMap, frame: Frame, errors: Sequence[float]) -> Floats:
    """Return where the robot was known to be, as ``CutExcursion.fixed``.

    errors : of the filter's heading, at each pose [rad].
    """
    told = [(number, one) for number, some in fixes(version.records).items() for one in some]
    logged = [one.heading_deg for one in version.records if isinstance(one, Pose)]
    halves = frame.half_back(
        np.array([(one.error_x, one.error_y) for _, one in told]).reshape(-1, 2)
    )
    rows = []
    for (number, one), half in zip(told, halves.tolist(), strict=True):
        off, off_half = 0.0, math.inf
        if one.heading_deg is not None and one.error_heading_deg is not None:
            off = math.radians(one.heading_deg - logged[number]) - errors[number]
            off, off_half = math.remainder(off, math.tau), math.radians(one.error_heading_deg)
        rows.append((number, *frame.turned((one.x, one.y)), *half, off, off_half))
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def _turns(
    groups: Sequence[Sequence[_Step]],
    before: Sequence[Sequence[_Step]],
    first: Pose,
    model: ErrorModel,
) -> dict[str, Floats]:
    """Return what is known of each run's length and direction, by the names of ``CutExcursion``.

    before : the steps whose turns come before each run.
    """
    length = np.array([sum(step.laid.logged.distance for step in group) for group in groups])
    followed = np.array([group[0].laid.logged.is_followed for group in groups])
    free = np.where(followed, 0.0, length)  # a follower does not drift
    distance = (np.append(0.0, free[:-1]) + free) / 2
    known = np.array([math.fsum(step.known for step in some) for some in before])
    known += math.radians(model.drift) * distance
    gained = np.diff([_angle(group) for group in groups], prepend=0.0) - known
    parts = np.array([math.fsum(step.parts for step in some) for some in before])
    turned = parts * math.radians(model.turn_noise) ** 2 + np.where(followed, 0, model.across**2)
    turned[0] += math.radians(first.error_heading_deg) ** 2
    is_told = np.array([all(step.is_told for step in some) for some in before])
    spread = math.hypot(math.radians(model.alignment_spread), math.radians(LEAST_SPREAD_DEG))
    return {
        "heading_step": (gained + math.pi) % (2 * math.pi) - math.pi,
        "parts": parts,
        "distance": distance,
        "turned_half": np.where(
            followed & ~is_told, np.inf, np.maximum(LEAST_TURN, np.sqrt(turned))
        ),
        "along_half": model.along * length,
        "aligned_half": np.where(followed, spread, np.inf),
    }


def _turn(
    logged: Stretch, following: Stretch | None, model: ErrorModel
) -> tuple[float, float, bool]:
    """Return ``known``, ``parts`` and ``is_told`` of the turn that ends a stretch."""
    t = logged.turn_deg
    if not t:
        return 0.0, 0.0, True
    if is_relabelling(logged, following):
        return -math.radians(t), 0.0, True
    parts = abs(t) / 45
    known = math.radians(model.turn_gain * t + model.turn_bias * parts)
    return known, parts, logged.is_run or is_told(logged)


def _vector(step: _Step) -> Place:
    (x0, y0), (x1, y1) = step.laid.start, step.laid.end
    return (x1 - x0, y1 - y0) if step.laid.logged.is_run else (0.0, 0.0)


def _sum(group: Sequence[_Step]) -> Place:
    vectors = [_vector(step) for step in group]
    return sum(x for x, _ in vectors), sum(y for _, y in vectors)


def _angle(group: Sequence[_Step]) -> float:
    """Return by how much a run's direction was corrected [rad]."""
    logged = [step.laid.logged for step in group]
    x = sum(one.end.x - one.start.x for one in logged)
    y = sum(one.end.y - one.start.y for one in logged)
    chord = _sum(group)
    return math.atan2(chord[1], chord[0]) - math.atan2(y, x)


def _shares(offset: Place, chord: Place) -> Place:
    """Return a and b of a place that lies so far from the start of a run."""
    (x, y), (chord_x, chord_y) = offset, chord
    squared = chord_x * chord_x + chord_y * chord_y
    return (x * chord_x + y * chord_y) / squared, (chord_x * y - chord_y * x) / squared


def _heading_error(step: _Step) -> float:
    return math.radians(step.laid.heading_deg - step.laid.logged.end.heading_deg)


def _poses(
    run: int, group: Sequence[_Step], chord: Place, frame: Frame
) -> Iterator[tuple[float, ...]]:
    """Yield the poses that end the stretches of a run."""
    x = y = off = 0.0
    for step in group:
        step_x, step_y = frame.turned(_vector(step))
        x, y = x + step_x, y + step_y
        if step.began and step.laid.logged.is_followed:  # it may not head where it goes
            cos, sin = step.laid.rotation
            off = (math.atan2(sin, cos) - _angle(group) + math.pi) % (2 * math.pi) - math.pi
        error = _heading_error(step) - off
        yield run, *_shares((x, y), chord), error, *step.laid.end, *step.errors.end


def _seen(
    run: int, group: Sequence[_Step], model: ErrorModel, frame: Frame
) -> Iterator[tuple[float, float, float]]:
    """Yield directions of walls seen in passing, unless they may mean either of the axes."""
    if group[0].laid.logged.is_followed:
        return
    turned, quarter = _angle(group), math.pi / 2
    for step in group:
        for _, wall in step.laid.logged.seen:
            if not isinstance(wall, Wall):
                continue
            x, y = wall.x2 - wall.x, wall.y2 - wall.y
            length = math.hypot(x, y)
            if length < LEAST_LENGTH_M:
                continue
            off = math.atan2(y, x) + turned - frame.axes
            off -= quarter * math.floor(off / quarter + 0.5)
            half = math.hypot(
                math.sqrt(2) * model.wall_noise / length, math.radians(model.wall_tilt)
            )
            sure = 3 * math.hypot(half, step.heading_half, model.across) / model.factor
            if abs(off) <= sure <= quarter / 2:
                yield run, off, half


def _sightings(
    run: int, group: Sequence[_Step], chord: Place, model: ErrorModel, frame: Frame
) -> Iterator[Sighting]:
    """Yield the walls seen during a run that can be told apart by their coordinate."""
    half = math.hypot(model.wall_noise, model.sensor)
    at_x = at_y = 0.0  # of the piece's start, from that of the run
    for step in group:
        laid = step.laid
        start = frame.turned(laid.start)
        for record, wall in laid.logged.seen if laid.logged.is_run else ():
            if not isinstance(wall, Wall):
                continue
            x0, y0 = frame.turned(laid.place(wall.x, wall.y))
            x1, y1 = frame.turned(laid.place(wall.x2, wall.y2))
            wide, high = abs(x1 - x0), abs(y1 - y0)
            if math.hypot(wide, high) < LEAST_WALL_M:
                continue
            if math.atan2(min(wide, high), max(wide, high)) > MOST_TILT:
                continue
            normal = int(wide > high)
            middle = (x0 + x1) / 2, (y0 + y1) / 2
            offset = at_x + middle[0] - start[0], at_y + middle[1] - start[1]
            a, b = _shares(offset, chord)
            if abs(b) > MOST_LEVER or not -1 <= a <= 2:
                continue
            robot = start[normal] - (at_x, at_y)[normal] + min(1.0, max(0.0, a)) * chord[normal]
            side = 1 if robot >= middle[normal] else -1
            reach = max(wide, high) / 2
            yield Sighting(record, run, normal, side, a, b, -reach, reach, half)
        step_x, step_y = frame.turned(_vector(step))
        at_x, at_y = at_x + step_x, at_y + step_y
