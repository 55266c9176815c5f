"""What truly happens when a robot runs and turns: its faults, drawn from named random streams."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from possmap.lab.simulate.settings import MissionSettings


@dataclass(frozen=True, slots=True)
class Faults:
    """What is wrong with one robot for good; *true minus logged*, left positive (METHOD §1).

    turn_bias : over-turn per 45° turned either way [deg]; drift [deg/m]; scale: true over logged.
    """

    turn_bias: float
    drift: float
    scale: float


@dataclass(frozen=True, slots=True)
class Place:
    """Where a robot truly is: x, y [m], heading [rad]."""

    x: float
    y: float
    heading: float

    def at(self, along: float, across: float) -> tuple[float, float]:
        """Return a point given in the robot's own frame [m], across to the left."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.x + along * cos - across * sin, self.y + along * sin + across * cos

    def moved(self, distance: float) -> Place:
        """Return the place so far straight ahead [m], or behind if negative."""
        x, y = self.at(distance, 0.0)
        return Place(x, y, self.heading)


def draw_faults(settings: MissionSettings, rng: np.random.Generator) -> Faults:
    """Draw one robot's faults: sides by a coin, sizes around the mission's."""
    side, drift_side = rng.choice([-1.0, 1.0], size=2)
    size = settings.turn_bias + settings.turn_bias_sd * rng.standard_normal()
    scale = 1 + settings.scale_sd * rng.standard_normal()
    if not settings.turn_bias:
        size = 0.0
    return Faults(float(side * size), float(drift_side * settings.drift), float(scale))


class Body:
    """The true robot; only it knows its true place."""

    def __init__(self, settings: MissionSettings, faults: Faults, rng: np.random.Generator) -> None:
        self.place = Place(0.0, 0.0, 0.0)
        self.faults = faults
        self._settings = settings
        self._rng = rng
        self._stretch = 1.0
        self._run: bool | None = None
        self._off = 0.0

    def set_down(self, x: float, y: float, heading: float) -> None:
        """Put the robot somewhere [m, rad]."""
        self.place = Place(x, y, heading)
        self._run, self._off = None, 0.0

    def turned(self, asked_deg: float) -> Place:
        """Return the place after a turn that was asked for [deg]; it ends the run."""
        self._run, self._off = None, 0.0
        parts = abs(asked_deg) / 45
        true_deg = asked_deg + self.faults.turn_bias * parts + self._turn_noise(parts)
        return replace(self.place, heading=self.place.heading + math.radians(true_deg))

    def counted_turn(self, true_deg: float) -> float:
        """Return what the wheels make of a turn that a wall, not they, brought to an end [deg]."""
        side = math.copysign(1.0, true_deg)
        without_noise = true_deg - self._turn_noise(abs(true_deg) / 45)
        return without_noise / (1 + side * self.faults.turn_bias / 45)

    def _turn_noise(self, parts: float) -> float:
        return self._settings.turn_noise * math.sqrt(parts) * float(self._rng.standard_normal())

    def line_up(self, heading: float | None = None) -> None:
        """Stand as the wall does: at a heading [rad], or as when it was last followed."""
        if heading is None:
            heading = self.place.heading - self._off
        self.place = replace(self.place, heading=heading)
        self._off = 0.0

    def leave_wall(self) -> None:
        """Draw how far the robot stands off the wall that it has followed."""
        settings = self._settings
        if settings.alignment_spread:
            half = math.radians(settings.alignment_spread)
            self._off = half / settings.factor * float(self._rng.standard_normal())
            self.place = replace(self.place, heading=self.place.heading + self._off)

    def begin_run(self, lined_up: bool) -> None:
        """Draw what goes wrong with a run: a heading error that stays, and a length.

        Who stops and goes on in the same way is still on its run, as METHOD §1 has it.
        The paper's straight runs of 10 ft end in a 95 % rectangle of 2.5 × 11 in; both grow in
        proportion to the distance. Lined up with a wall, a robot does not leave its direction.
        """
        if lined_up is self._run:
            return
        self._run = lined_up
        settings = self._settings
        kick, stretch = self._rng.standard_normal(2) / settings.factor
        self._stretch = 1 + settings.along * float(stretch)
        if not lined_up:
            heading = self.place.heading + settings.across * float(kick)
            self.place = replace(self.place, heading=heading)

    def logged(self, distance: float) -> float:
        """Return what the wheels count over a true distance [m], in whole steps."""
        step = self._settings.odometry_step
        return round(distance / (self.faults.scale * self._stretch) / step) * step

    def bend(self, distance: float, lined_up: bool) -> float:
        """Return how far the drift turns the robot over a distance [rad]."""
        return 0.0 if lined_up else math.radians(self.faults.drift * distance)
