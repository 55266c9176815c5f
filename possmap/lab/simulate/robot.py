"""One robot's life: it sets out, explores, comes home or not, and sets out again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.simulate.body import Body, draw_faults
from possmap.lab.simulate.logbook import Logbook
from possmap.lab.simulate.navigation import Lost, Navigation
from possmap.lab.simulate.perception import Others, Perception
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.steering import Motion, Steering, Steps, Track
from possmap.lab.simulate.world import World

CALIBRATED_SPREAD_DEG = 0.5
"""The ``turn_spread`` of a calibrated robot."""
CALIBRATED_SENSOR_M = 0.03
"""Its ``sensor``: readings, straight pieces fitted to them, and walls between two samples."""

_PAPER = ErrorModel()
_STREAMS = ("faults", "motion", "senses", "decisions", "calibration")


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


def streams(seed: int, robot: int) -> dict[str, np.random.Generator]:
    """Return a robot's random streams, one for each purpose, whatever the others do."""
    return {
        purpose: np.random.default_rng([seed, robot, number])
        for number, purpose in enumerate(_STREAMS)
    }


class Robot:
    """A robot, true and believed."""

    def __init__(
        self, number: int, world: World, settings: MissionSettings, others: Others
    ) -> None:
        rng = streams(settings.seed, number)
        self.name = f"r{number + 1}"
        self.number = number
        self.excursions: list[Excursion] = []
        self.is_out = False
        self._world = world
        self._settings = settings
        self.faults = draw_faults(settings, rng["faults"])
        self.body = Body(settings, self.faults, rng["motion"])
        self._own_model = self._measured(rng["calibration"])
        self._model = _PAPER.with_own(self._own_model)
        self._perception = Perception(world, settings, rng["senses"], others)
        self.steering = Steering(settings, self.body, self._perception)
        behaviour = settings.behaviours[number % len(settings.behaviours)]
        self._navigation = Navigation(
            settings, behaviour, self.steering, self._perception, rng["decisions"],
            self._must_return, self._battery_left,
        )  # fmt: skip
        self._set_out_at = 0.0

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
        yield from self._rest(3.0 * self.number)  # one after the other through the same place
        while self.steering.time < 60 * settings.minutes:
            yield from self._outing(len(self.excursions) + 1)
            if self.excursions[-1].fate == "lost":
                return
            yield from self._rest(60 * settings.rest_minutes)

    def _rest(self, seconds: float) -> Steps:
        place = self.body.place
        done = yield Motion(seconds, place, place)
        self.steering.time = done.time

    def _outing(self, number: int) -> Steps:
        steering = self.steering
        heading_deg = 90.0 * ((self.number + number - 1) % 4)
        home = self._world.home
        self.body.set_down(*home, math.radians(heading_deg))
        name = (self.name, f"{self.name}-{number:02d}")
        steering.book = Logbook(name, self._own_model, self._model)
        steering.track, steering.trail = [], []
        self._set_out_at = steering.time
        self.is_out = True
        steering.note_pose(round(home[0], 4), round(home[1], 4), heading_deg)
        why = ""
        try:
            yield from self._navigation.explore()
            yield from self._navigation.go_home()
        except Lost as lost:
            why = str(lost)
        # Whoever collects robots finds those near home, whatever they think of where they are.
        missed = math.hypot(self.body.place.x - home[0], self.body.place.y - home[1])
        if missed <= self._settings.reach:
            fate, why = "home", ""
        else:
            fate, why = "lost", why or f"missed home by {missed:.1f} m"
        self.is_out = False
        self.excursions.append(
            Excursion(*name, fate, why, steering.time, steering.track, steering.log())
        )

    def _must_return(self) -> bool:
        settings, book = self._settings, self.steering.log()
        return (
            book.belief.worst >= settings.max_error
            or self._battery_left() < 30 * settings.battery_minutes
            or book.bytes > 0.9 * settings.memory_bytes
            or self.steering.time >= 60 * settings.minutes
        )

    def _battery_left(self) -> float:
        return 60 * self._settings.battery_minutes - (self.steering.time - self._set_out_at)

    def as_truth(self) -> list[dict[str, Any]]:
        """Return the robot's entries of the truth file."""
        return [
            {
                "robot": one.robot,
                "excursion": one.excursion,
                "fate": one.fate,
                "why": one.why,
                "track": one.track,
            }
            for one in self.excursions
        ]
