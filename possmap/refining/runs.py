"""An excursion as least squares need it: straight runs between nodes, and walls seen from them.

A *node* is where one run ends and the next begins; a *run* is straight, however many pieces it was
logged in. All is laid out as the estimator ``walls`` believes it, which is where refining starts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle, StretchErrors
from possmap.core.records import PartialMap, Pose, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import Stretch, stretches
from possmap.core.walls import (
    LEAST_LENGTH_M,
    LEAST_SPREAD_DEG,
    MOST_OUTLIERS,
    Observations,
    WallFilter,
    is_relabelling,
    is_told,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_WALL_M = 0.25
"""A shorter piece of wall does not tell in which direction it stands."""
MOST_TILT = math.radians(15)
"""A piece that stands farther off both axes is none of the building's walls [rad]."""
MOST_LEVER = 5.0
"""A wall seen so many lengths of its run away from it lies anywhere."""
LEAST_TURN = 1e-4
"""No heading is known better from one run to the next [rad, half-width]."""


class Sighting(NamedTuple):
    """A piece of wall seen during a run; its middle is start + a·Δ + b·Δ⊥, Δ the run's chord.

    record : its number; run : which run of the excursion.
    normal : 0: its coordinate is that along the axes' direction; 1: across.
    side : +1 if the robot was where coordinates are larger, else -1.
    low, high : from where to where along the wall, seen from its middle [m].
    half_width : of its place as seen from the robot [m].
    """

    record: int
    run: int
    normal: int
    side: int
    a: float
    b: float
    low: float
    high: float
    half_width: float


class Frame:
    """The building's axes."""

    def __init__(self, settings: EvidenceSettings) -> None:
        self.axes = math.radians(settings.axes)
        self._cos, self._sin = math.cos(self.axes), math.sin(self.axes)

    def turned(self, place: tuple[float, float]) -> Floats:
        """Return a place or vector of the site frame along and across the axes."""
        x, y = place
        return np.array([self._cos * x + self._sin * y, self._cos * y - self._sin * x])

    def back(self, places: Floats) -> Floats:
        """Return places along and across the axes in the site frame; shape (n, 2)."""
        x, y = places.T
        return np.stack([self._cos * x - self._sin * y, self._sin * x + self._cos * y], axis=1)

    def half_back(self, halves: Floats) -> Floats:
        """Return half-widths along and across the axes in the site frame; shape (n, 2).

        What both have in common is left out.
        """
        turn = np.array([[self._cos**2, self._sin**2], [self._sin**2, self._cos**2]])
        found: Floats = np.sqrt(halves**2 @ turn)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Excursion:
    """What one excursion brings to the problem; places in the frame of the building's axes.

    Attributes
    ----------
    version, model
        Its records, and the model in force.
    observations
        What walls told of its heading.
    start, start_half
        The first pose [m] and its half-widths.
    chord
        Each run as the filter lays it [m]; shape (runs, 2).
    heading_step
        How much more its direction was corrected than the turns before it told [rad].
    parts, distance
        45° turned, and metres to drift on, since the middle of the run before.
    turned_half, along_half, aligned_half
        Half-widths of ``heading_step`` [rad], of its length [m] and, of a followed run, of its
        direction [rad]; infinite: nothing is known of it.
    seen
        Directions of walls: run, how far off the axes [rad], half-width [rad]; shape (n, 3).
    sightings
        Walls seen.
    poses
        Of each pose the run, the shares a and b of its chord and the filter's heading error [rad];
        then, in the site's frame, place and half-widths of the filter [m]; shape (poses, 8).
    """

    version: PartialMap
    model: ErrorModel
    observations: Observations
    start: Floats
    start_half: Floats
    chord: Floats
    heading_step: Floats
    parts: Floats
    distance: Floats
    turned_half: Floats
    along_half: Floats
    aligned_half: Floats
    seen: Floats
    sightings: tuple[Sighting, ...]
    poses: Floats

    frame: Frame

    def laid(self, nodes: Floats, variances: Floats) -> tuple[Floats, Floats]:
        """Return the places and half-widths of its poses in the site's frame [m], for its nodes.

        nodes : shape (runs + 1, 2); variances : of their x and y, shape (runs + 1, 2 or more).
        """
        run, (a, b) = self.poses[:, 0].astype(np.int64), self.poses[:, 1:3].T[..., None]
        step = nodes[run + 1] - nodes[run]
        across = np.stack([-step[:, 1], step[:, 0]], axis=1)
        places = self.frame.back(nodes[run] + a * step + b * across)
        halves = self.model.factor * np.sqrt(variances[:, :2])
        share = np.clip(a, 0.0, 1.0)
        return places, self.frame.half_back((1 - share) * halves[run] + share * halves[run + 1])

    @property
    def is_orthogonal(self) -> bool:
        """Whether the walls it saw stand along the axes."""
        return self.observations.outliers <= self.observations.seen + MOST_OUTLIERS


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


def cut(version: PartialMap, model: ErrorModel, settings: EvidenceSettings) -> Excursion | None:
    """Cut an excursion into runs; None if it has none."""
    first = next((one for one in version.records if isinstance(one, Pose)), None)
    track = stretches(version.records)
    if first is None or not any(one.is_run for one in track):
        return None
    now = WallFilter(first, model, settings)
    start = now.rectangle
    steps = []
    for logged, following in zip_longest(track, track[1:]):
        heading_half = now.heading_half
        laid, errors = now.advance(logged, following)
        turn = _turn(logged, following, model)
        steps.append(_Step(laid, errors, now.began, heading_half, *turn))
    starts = [number for number, step in enumerate(steps) if step.began]
    groups = [steps[i:j] for i, j in zip(starts, [*starts[1:], len(steps)], strict=True)]
    frame = Frame(settings)
    chord = np.array([frame.turned(_sum(group)) for group in groups])
    angle = [_angle(group) for group in groups]
    length = np.array([_distance(group) for group in groups])
    followed = np.array([group[0].laid.logged.is_followed for group in groups])
    free = np.where(followed, 0.0, length)
    before = [steps[: starts[0]], *groups[:-1]]  # whose turns come before a run
    known = np.array([sum(step.known for step in some) for some in before])
    parts = np.array([sum(step.parts for step in some) for some in before])
    distance = (np.append(0.0, free[:-1]) + free) / 2
    known += math.radians(model.drift) * distance
    step = np.diff(angle, prepend=0.0) - known
    turned = parts * math.radians(model.turn_noise) ** 2 + np.where(followed, 0, model.across**2)
    turned[0] += math.radians(first.error_heading_deg) ** 2
    unknown = [
        one and not all(s.is_told for s in some) for one, some in zip(followed, before, strict=True)
    ]
    spread = math.hypot(math.radians(model.alignment_spread), math.radians(LEAST_SPREAD_DEG))
    return Excursion(
        version,
        model,
        now.observations,
        start=frame.turned((first.x, first.y)),
        start_half=np.array([first.error_x, first.error_y]),
        chord=chord,
        heading_step=(step + math.pi) % (2 * math.pi) - math.pi,
        parts=parts,
        distance=distance,
        turned_half=np.where(unknown, np.inf, np.maximum(LEAST_TURN, np.sqrt(turned))),
        along_half=model.along * length,
        aligned_half=np.where(followed, spread, np.inf),
        seen=np.array(
            [row for run, group in enumerate(groups) for row in _seen(run, group, model, frame)]
        ).reshape(-1, 3),
        sightings=tuple(
            one
            for run, group in enumerate(groups)
            for one in _sightings(run, group, chord[run], model, frame)
        ),
        frame=frame,
        poses=np.array(
            [
                *_before(first, start, steps[: starts[0]]),
                *(
                    row
                    for run, group in enumerate(groups)
                    for row in _poses(run, group, chord[run], frame)
                ),
            ]
        ),
    )


def _turn(
    logged: Stretch, following: Stretch | None, model: ErrorModel
) -> tuple[float, float, bool]:
    t = logged.turn_deg
    if not t:
        return 0.0, 0.0, True
    if is_relabelling(logged, following):
        return -math.radians(t), 0.0, True
    parts = abs(t) / 45
    known = math.radians(model.turn_gain * t + model.turn_bias * parts)
    return known, parts, logged.is_run or is_told(logged)


def _vector(step: _Step) -> tuple[float, float]:
    (x0, y0), (x1, y1) = step.laid.start, step.laid.end
    return (x1 - x0, y1 - y0) if step.laid.logged.is_run else (0.0, 0.0)


def _sum(group: Sequence[_Step]) -> tuple[float, float]:
    vectors = [_vector(step) for step in group]
    return sum(x for x, _ in vectors), sum(y for _, y in vectors)


def _distance(group: Sequence[_Step]) -> float:
    return sum(step.laid.logged.distance for step in group)


def _angle(group: Sequence[_Step]) -> float:
    """Return by how much a run's direction was corrected [rad]."""
    logged = [step.laid.logged for step in group]
    x = sum(one.end.x - one.start.x for one in logged)
    y = sum(one.end.y - one.start.y for one in logged)
    chord = _sum(group)
    return math.atan2(chord[1], chord[0]) - math.atan2(y, x)


def _shares(offset: Floats, chord: Floats) -> tuple[float, float]:
    """Return a and b of a place that lies so far from the start of a run."""
    squared = float(chord @ chord)
    along = float(offset @ chord) / squared
    across = float(chord[0] * offset[1] - chord[1] * offset[0]) / squared
    return along, across


def _before(
    first: Pose, start: ErrorRectangle, steps: Sequence[_Step]
) -> Iterator[tuple[float, ...]]:
    """Yield the poses before the first run."""
    yield 0, 0.0, 0.0, 0.0, first.x, first.y, *start
    for step in steps:
        yield 0, 0.0, 0.0, _heading_error(step), *step.laid.end, *step.errors.end


def _heading_error(step: _Step) -> float:
    return math.radians(step.laid.heading_deg - step.laid.logged.end.heading_deg)


def _poses(
    run: int, group: Sequence[_Step], chord: Floats, frame: Frame
) -> Iterator[tuple[float, ...]]:
    """Yield the poses that end the stretches of a run."""
    at = np.zeros(2)
    for step in group:
        at = at + frame.turned(_vector(step))
        yield run, *_shares(at, chord), _heading_error(step), *step.laid.end, *step.errors.end


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
    run: int, group: Sequence[_Step], chord: Floats, model: ErrorModel, frame: Frame
) -> Iterator[Sighting]:
    """Yield the walls seen during a run that can be told apart by their coordinate."""
    half = math.hypot(model.wall_noise, model.sensor)
    at = np.zeros(2)
    for step in group:
        laid = step.laid
        origin = frame.turned(laid.start)
        for record, wall in laid.logged.seen:
            if not (isinstance(wall, Wall) and laid.logged.is_run):
                continue
            ends = [
                frame.turned(laid.place(*end)) for end in ((wall.x, wall.y), (wall.x2, wall.y2))
            ]
            x, y = (ends[1] - ends[0]).tolist()
            if math.hypot(x, y) < LEAST_WALL_M:
                continue
            normal = int(abs(x) > abs(y))
            if math.atan2(min(abs(x), abs(y)), max(abs(x), abs(y))) > MOST_TILT:
                continue
            middle = (ends[0] + ends[1]) / 2
            a, b = _shares(at + middle - origin, chord)
            if abs(b) > MOST_LEVER or not -1 <= a <= 2:
                continue
            robot = origin - at + min(1.0, max(0.0, a)) * chord
            side = 1 if robot[normal] >= middle[normal] else -1
            reach = abs(x if normal else y) / 2
            yield Sighting(record, run, normal, side, a, b, -reach, reach, half)
        at = at + frame.turned(_vector(step))
