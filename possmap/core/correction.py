"""The logged track corrected by what is known of the robot, before anything else (METHOD §1)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from possmap.core.model import ErrorModel
from possmap.core.track import Stretch


class CorrectedStretch(NamedTuple):
    """A stretch laid where the robot is now believed to have been.

    Attributes
    ----------
    logged
        The stretch as the robot told it.
    start, end
        Corrected places [m].
    length
        Corrected length of the run [m], >= 0; 0 at standstill.
    along
        Unit vector of the corrected run, (1, 0) at standstill.
    stretch
        Corrected length over logged length, signed; 1 at standstill.
    rotation
        Cosine and sine by which offsets are turned.
    heading_deg
        Corrected heading at the end, after the turn, not wrapped [deg].
    """

    logged: Stretch
    start: tuple[float, float]
    end: tuple[float, float]
    length: float
    along: tuple[float, float]
    stretch: float
    rotation: tuple[float, float]
    heading_deg: float

    @classmethod
    def along_chord(
        cls,
        logged: Stretch,
        start: tuple[float, float],
        end: tuple[float, float],
        angle: float,
        heading_deg: float,
    ) -> CorrectedStretch:
        """Lay a stretch from one place to another: direction and stretch are those of the chord.

        angle : by which offsets at standstill are turned [rad].
        """
        step_x, step_y = end[0] - start[0], end[1] - start[1]
        length = math.hypot(step_x, step_y) if logged.is_run else 0.0
        along = (step_x / length, step_y / length) if length else logged.unit
        stretch = length / logged.distance if logged.is_run else 1.0
        rotation = math.cos(angle), math.sin(angle)
        return cls(logged, start, end, length, along, stretch, rotation, heading_deg)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Move a point recorded during the stretch along with it.

        The offset from the run's first pose is split along and across the logged run and laid along
        and across the corrected one; the part along it is stretched like the run. At standstill
        it is only turned.
        """
        logged = self.logged
        off_x, off_y = x - logged.start.x, y - logged.start.y
        if logged.is_run:
            (unit_x, unit_y), (along_x, along_y) = logged.unit, self.along
            along = (off_x * unit_x + off_y * unit_y) * self.stretch
            across = off_y * unit_x - off_x * unit_y
            turned_x = along * along_x - across * along_y
            turned_y = along * along_y + across * along_x
        else:
            cos, sin = self.rotation
            turned_x, turned_y = off_x * cos - off_y * sin, off_x * sin + off_y * cos
        return self.start[0] + turned_x, self.start[1] + turned_y

    def share(self, x: float, y: float) -> float:
        """Return where a logged point projects onto the run, a share in [0, 1]; 0 at standstill."""
        logged = self.logged
        if not logged.is_run:
            return 0.0
        unit_x, unit_y = logged.unit
        off_x, off_y = x - logged.start.x, y - logged.start.y
        return min(1.0, max(0.0, (off_x * unit_x + off_y * unit_y) / logged.distance))


class Believed(NamedTuple):
    """Where the correction has come to.

    place : corrected [m].
    correction_deg : METHOD's corr, what the logged heading lacks [deg].
    """

    place: tuple[float, float]
    correction_deg: float = 0.0


def correct(stretches: Iterable[Stretch], model: ErrorModel) -> list[CorrectedStretch]:
    """Lay each stretch after the other, corrected by the model's known errors.

    Known: ``turn_bias``, ``turn_gain``, ``drift``, ``scale``; *true minus logged*, left positive.
    """
    corrected: list[CorrectedStretch] = []
    now: Believed | None = None
    for logged in stretches:
        now, stretch = advance(now or Believed((logged.start.x, logged.start.y)), logged, model)
        corrected.append(stretch)
    return corrected


def advance(now: Believed, logged: Stretch, model: ErrorModel) -> tuple[Believed, CorrectedStretch]:
    """Lay one more stretch behind what was laid; a robot does this while it drives."""
    place, correction_deg = now
    if logged.is_followed:
        correction_deg = 0.0
    if logged.is_run:
        # One arc bends by drift·d; its chord lies half of that to the side, and is shorter.
        bend_deg = 0.0 if logged.is_followed else model.drift * logged.distance
        half = math.radians(bend_deg / 2)
        stretch = model.scale * (math.sin(half) / half if half else 1.0)
        angle = math.radians(correction_deg) + half
        cos, sin = math.cos(angle), math.sin(angle)
        unit_x, unit_y = logged.unit
        along = (unit_x * cos - unit_y * sin, unit_x * sin + unit_y * cos)
        step = logged.distance * stretch
        end = (place[0] + step * along[0], place[1] + step * along[1])
        correction_deg += bend_deg
    else:
        angle = math.radians(correction_deg)
        cos, sin = math.cos(angle), math.sin(angle)
        stretch, along, step, end = 1.0, (1.0, 0.0), 0.0, place
    turn_deg = logged.turn_deg
    correction_deg += model.turn_gain * turn_deg + model.turn_bias * abs(turn_deg) / 45
    heading_deg = logged.end.heading_deg + correction_deg
    return Believed(end, correction_deg), CorrectedStretch(
        logged, place, end, abs(step), along, stretch, (cos, sin), heading_deg
    )
