"""The logged track, cut into stretches: from each pose to the next, with what was seen between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from possmap.core.angles import wrap_degrees
from possmap.core.records import Meet, Pose, Record, Sighting, Wall


@dataclass(frozen=True, slots=True)
class Stretch:
    """From one pose to the next, as logged: a run if the place differs, else a standstill.

    Attributes
    ----------
    start, end
        The two poses.
    end_index
        Number of ``end`` among the excursion's records: the stretch is known from there on.
    seen
        Walls, beams and corners between the two, each with its index among the records.
    """

    start: Pose
    end: Pose
    end_index: int
    seen: tuple[tuple[int, Sighting], ...]

    @property
    def is_run(self) -> bool:
        """Whether the robot moved."""
        return self.start.x != self.end.x or self.start.y != self.end.y

    @property
    def distance(self) -> float:
        """Logged length [m]."""
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    @property
    def turn_deg(self) -> float:
        """The turn after the run, left positive, wrapped [deg]."""
        return wrap_degrees(self.end.heading_deg - self.start.heading_deg)

    @property
    def has_wall(self) -> bool:
        """Whether any wall was recorded; a run without one is a free run."""
        return any(isinstance(sighting, Wall) for _, sighting in self.seen)

    @property
    def is_followed(self) -> bool:
        """Whether the robot ran lined up with a wall; at standstill ``followed`` claims nothing."""
        return self.is_run and any(
            isinstance(sighting, Wall) and sighting.followed for _, sighting in self.seen
        )


def stretches(records: Sequence[Record]) -> list[Stretch]:
    """Cut an excursion's records into stretches, without what waits after the last pose."""
    found: list[Stretch] = []
    last: Pose | None = None
    seen: list[tuple[int, Sighting]] = []
    for index, record in enumerate(records):
        if isinstance(record, Pose):
            if last is not None:
                found.append(Stretch(last, record, index, tuple(seen)))
            last, seen = record, []
        elif not isinstance(record, Meet):
            seen.append((index, record))
    return found


def waiting(records: Sequence[Record]) -> list[Sighting]:
    """Return the sightings after the last pose: they yield nothing until the next pose comes."""
    found: list[Sighting] = []
    for record in reversed(records):
        if isinstance(record, Pose):
            break
        if not isinstance(record, Meet):
            found.append(record)
    return found[::-1]
