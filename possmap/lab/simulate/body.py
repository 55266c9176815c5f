"""What truly happens when a robot runs and turns: its faults, drawn from named random streams."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world import Floats

Metres = TypeVar("Metres", float, Floats)


@dataclass(frozen=True, slots=True)
class Faults:
    """What is wrong with one robot for good; *true minus logged*, left positive (METHOD §1).

    turn_bias : over-turn per 45° turned either way [deg]; drift [deg/m]; scale: true over logged.
    """

    turn_bias: float
    drift: float
    scale: float


class Place(NamedTuple):
    """Where a robot truly is: x, y [m], heading [rad]."""

    x: float
    y: float
    heading: float

    def at(self, along: Metres, across: float) -> tuple[Metres, Metres]:
        """Return a point, or several, given in the robot's own frame [m], across to the left."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.x + along * cos - across * sin, self.y + along * sin + across * cos

    def moved(self, distance: float) -> Place:
        """Return the place so far straight ahead [m], or behind if negative."""
        return Place(*self.at(distance, 0.0), self.heading)

    def turned(self, angle: float) -> Place:
        """Return the place after a turn on the spot [rad]."""
        return Place(self.x, self.y, self.heading + angle)


def draw_faults(settings: MissionSettings, rng: np.random.Generator) -> Faults:
    """Draw one robot's faults: sides by a coin, sizes around the mission's."""
    side, drift_side = rng.choice([-1.0, 1.0], size=2).tolist()
    size = settings.turn_bias + settings.turn_bias_sd * float(rng.standard_normal())
    scale = 1 + settings.scale_sd * float(rng.standard_normal())
    return Faults(side * size if settings.turn_bias else 0.0, drift_side * settings.drift, scale)


class Body:
    """The true robot; only it knows its true place."""

    def __init__(self, settings: MissionSettings, faults: Faults, rng: np.random.Generator) -> None:
        self.place = Place(0.0, 0.0, 0.0)
        self.faults = faults
        self._settings = settings
        self._rng = rng
        self._stretch = 1.0
        self._run: bool | None = None  # lined up or not; None before one begins
        self.off = 0.0  # how far it stands off the wall that it has lined up with [rad]

    def set_down(self, place: Place) -> None:
        """Put the robot somewhere; that ends its run."""
        self.place = place
        self._run, self.off = None, 0.0

    def turned(self, asked_deg: float) -> Place:
        """Return the place after a turn that was asked for [deg]; it ends the run."""
        self.set_down(self.place)
        parts = abs(asked_deg) / 45
        true_deg = asked_deg + self.faults.turn_bias * parts + self._turn_noise(parts)
        return self.place.turned(math.radians(true_deg))

    def counted_turn(self, true_deg: float) -> float:
        """Return what the wheels make of a turn that a wall, not they, brought to an end [deg]."""
        side = math.copysign(1.0, true_deg)
        without_noise = true_deg - self._turn_noise(abs(true_deg) / 45)
        return without_noise / (1 + side * self.faults.turn_bias / 45)

    def _turn_noise(self, parts: float) -> float:
        return self._settings.turn_noise * math.sqrt(parts) * float(self._rng.standard_normal())

    @property
    def along_wall(self) -> Place:
        """The place with the heading of the wall that it has lined up with: where it will go."""
        return self.place.turned(-self.off)

    def misalignment(self) -> float:
        """Draw how far off a wall's direction the robot lines up with it [rad]."""
        half, factor = math.radians(self._settings.alignment_spread), self._settings.factor
        return half / factor * float(self._rng.standard_normal()) if half else 0.0

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
        kick, stretch = (self._rng.standard_normal(2) / settings.factor).tolist()
        self._stretch = 1 + settings.along * stretch
        if not lined_up:
            self.off = 0.0
            self.place = self.place.turned(settings.across * kick)

    def logged(self, distance: float) -> float:
        """Return what the wheels count over a true distance [m], in whole steps."""
        step = self._settings.odometry_step
        return round(distance / (self.faults.scale * self._stretch) / step) * step

    def bend(self, distance: float, lined_up: bool) -> float:
        """Return how far the drift turns the robot over a distance [rad]."""
        return 0.0 if lined_up else math.radians(self.faults.drift * distance)
