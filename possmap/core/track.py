"""The logged track, cut into stretches: from each pose to the next, with what was seen between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from possmap.core.records import Beam, Corner, Fix, Pose, Record, Sighting, Wall

HALF_TURN_TOLERANCE_DEG = 1e-6
"""Within this of ±180° a turn counts as +180°, a left turn."""


def wrap_degrees(angle_deg: float) -> float:
    """Return the angle wrapped to (-180, 180]; a half turn, within 1e-6°, is +180 (METHOD §0)."""
    wrapped = math.remainder(angle_deg, 360.0)
    if 180.0 - abs(wrapped) <= HALF_TURN_TOLERANCE_DEG:
        return 180.0
    return wrapped


class Stretch(NamedTuple):
    """From one pose to the next, as logged: a run if the place differs, else a standstill.

    What follows from the poses and sightings is worked out once, by ``between``: correction,
    propagation and layout all ask for it.

    Attributes
    ----------
    start, end
        The two poses.
    end_index
        Number of ``end`` among the excursion's records: the stretch is known from there on.
    seen
        Walls, beams and corners between the two, each with its index among the records.
    is_run
        Whether the robot moved.
    distance
        Logged length [m].
    unit
        Direction of the logged displacement, not of the heading (METHOD §1, Correction);
        (1, 0) at standstill.
    turn_deg
        The turn after the run, left positive, wrapped [deg].
    has_wall
        Whether any wall was recorded; a run without one is a free run.
    is_followed
        Whether the robot ran lined up with a wall; at standstill ``followed`` claims nothing.
    """

    start: Pose
    end: Pose
    end_index: int
    seen: tuple[tuple[int, Sighting], ...]
    is_run: bool
    distance: float
    unit: tuple[float, float]
    turn_deg: float
    has_wall: bool
    is_followed: bool

    @classmethod
    def between(
        cls, start: Pose, end: Pose, end_index: int, seen: tuple[tuple[int, Sighting], ...]
    ) -> Stretch:
        """Return the stretch from one pose to another."""
        step_x, step_y = end.x - start.x, end.y - start.y
        is_run = step_x != 0 or step_y != 0
        distance, unit = 0.0, (1.0, 0.0)
        if is_run:
            distance = math.hypot(step_x, step_y)
            unit = (step_x / distance, step_y / distance)
        turn_deg = wrap_degrees(end.heading_deg - start.heading_deg)
        walls = [one for _, one in seen if isinstance(one, Wall)] if seen else []
        is_followed = is_run and any(wall.followed for wall in walls) if walls else False
        return cls(
            start, end, end_index, seen, is_run, distance, unit, turn_deg, bool(walls), is_followed
        )


def stretches(records: Sequence[Record]) -> list[Stretch]:
    """Cut an excursion's records into stretches, without what waits after the last pose."""
    found: list[Stretch] = []
    last: Pose | None = None
    seen: list[tuple[int, Sighting]] = []
    for index, record in enumerate(records):
        if isinstance(record, Pose):
            if last is not None:
                found.append(Stretch.between(last, record, index, tuple(seen)))
            last, seen = record, []
        elif isinstance(record, Wall | Beam | Corner):
            seen.append((index, record))
    return found


def fixes(records: Sequence[Record]) -> dict[int, list[Fix]]:
    """Return the fixes by the number of the pose that they stand after; the first is 0."""
    found: dict[int, list[Fix]] = {}
    number = -1
    for record in records:
        if isinstance(record, Pose):
            number += 1
        elif isinstance(record, Fix):
            found.setdefault(number, []).append(record)
    return found


def waiting(records: Sequence[Record]) -> list[Sighting]:
    """Return the sightings after the last pose: they yield nothing until the next pose comes."""
    found: list[Sighting] = []
    for record in reversed(records):
        if isinstance(record, Pose):
            break
        if isinstance(record, Wall | Beam | Corner):
            found.append(record)
    return found[::-1]
