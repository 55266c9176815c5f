"""One robot's life: it sets out, explores, comes home or not, and sets out again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.simulate.body import Body, Place, draw_faults
from possmap.lab.simulate.logbook import Logbook
from possmap.lab.simulate.navigation import Lost, Navigation
from possmap.lab.simulate.perception import Others, Perception
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.steering import Steering, Steps, Track
from possmap.lab.simulate.world import World

CALIBRATED_SPREAD_DEG = 0.5
"""The ``turn_spread`` of a calibrated robot."""
CALIBRATED_SENSOR_M = 0.03
"""Its ``sensor``: readings, straight pieces fitted to them, and walls between two samples."""

_PAPER = ErrorModel()


@dataclass(frozen=True)
class Excursion:
    """What became of one outing.

    fate : ``home`` or ``lost``; why: in words, if lost.
    ended_at : when [s].
    track : rows of LOGS' truth file.
    book : what the robot held when it ended.
    """

    robot: str
    excursion: str
    fate: str
    why: str
    ended_at: float
    track: Track
    book: Logbook

    def as_truth(self) -> dict[str, Any]:
        """Return its entry of the truth file."""
        names = ("robot", "excursion", "fate", "why", "track")
        return {name: getattr(self, name) for name in names}


class Robot:
    """A robot, true and believed."""

    def __init__(
        self, number: int, world: World, settings: MissionSettings, others: Others
    ) -> None:
        # One random stream for each purpose, whatever the other robots do.
        of_faults, of_motion, of_senses, of_decisions, of_calibration, self._of_dock = (
            np.random.default_rng([settings.seed, number, purpose]) for purpose in range(6)
        )
        self.name = f"r{number + 1}"
        self.number = number
        self.excursions: list[Excursion] = []
        self.is_out = False
        self._world = world
        self._settings = settings
        self.faults = draw_faults(settings, of_faults)
        self.body = Body(settings, self.faults, of_motion)
        self._own_model = self._measured(of_calibration)
        self._model = _PAPER.with_own(self._own_model)
        perception = Perception(world, settings, of_senses, others)
        self.steering = Steering(settings, self.body, perception)
        behaviour = settings.behaviours[number % len(settings.behaviours)]
        self._navigation = Navigation(settings, behaviour, self.steering, of_decisions)

    def _measured(self, rng: np.random.Generator) -> dict[str, float]:
        """Return the error model that the robot's logs carry; empty if it was never calibrated."""
        settings = self._settings
        model: dict[str, float] = {}
        if settings.calibrated:
            error = settings.calibration_sd * float(rng.standard_normal())
            model["turn_bias"] = round(self.faults.turn_bias + error, 2)
            model["turn_spread"] = CALIBRATED_SPREAD_DEG
            if settings.turn_noise:
                model["turn_noise"] = round(settings.factor * settings.turn_noise, 3)
            if settings.alignment_spread:
                model["alignment_spread"] = settings.alignment_spread
            model["sensor"] = CALIBRATED_SENSOR_M
            if settings.drift:
                model["drift"] = round(self.faults.drift, 3)
            if settings.scale_sd:
                model["scale"] = round(self.faults.scale, 5)
        for name in ("along", "across", "max_error"):
            if getattr(settings, name) != getattr(_PAPER, name):
                model[name] = getattr(settings, name)
        return model

    def live(self) -> Steps:
        """Set out again and again until the mission is over or the robot is lost."""
        settings = self._settings
        yield from self.steering.wait(
            3.0 * self.number
        )  # one after the other through the same place
        while self.steering.time < 60 * settings.minutes:
            yield from self._outing(len(self.excursions) + 1)
            if self.excursions[-1].fate == "lost":
                return
            yield from self.steering.wait(60 * settings.rest_minutes)

    def _outing(self, number: int) -> Steps:
        steering = self.steering
        quarters = (self.number + number - 1) % 4
        home = Place(*self._world.home, math.radians(90.0 * quarters))
        name = (self.name, f"{self.name}-{number:02d}")
        self._navigation.set_out_at = steering.time
        self.is_out = True
        steering.set_out(Logbook(name, self._own_model, self._model), home)
        why = ""
        try:
            yield from self._navigation.explore()
            yield from self._navigation.go_home()
        except Lost as lost:
            why = str(lost)
        # Whoever collects robots finds those near home, whatever they think of where they are.
        missed = math.hypot(self.body.place.x - home.x, self.body.place.y - home.y)
        fate, why = "lost", why or f"missed home by {missed:.1f} m"
        if missed <= self._settings.reach:
            fate, why = "home", ""
            if self._settings.dock_error:
                self._fix()
        self.is_out = False
        self.excursions.append(
            Excursion(*name, fate, why, steering.time, steering.track, steering.book)
        )

    def _fix(self) -> None:
        """Note where the robot truly is, as well as whoever collects it knows."""
        place, half = self.body.place, self._settings.dock_error
        spread = half / self._settings.factor
        off_x, off_y = (spread * self._of_dock.standard_normal(2)).tolist()
        self.steering.book.fix(self.steering.time, place.x + off_x, place.y + off_y, half)
