"""Helpers of the simulator's tests: worlds, missions driven in memory, and what truly happened."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from possmap.core.model import ErrorModel
from possmap.lab.simulate.body import Body, Faults
from possmap.lab.simulate.floor_plan import sides
from possmap.lab.simulate.logbook import Logbook
from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.mission_file import read_mission
from possmap.lab.simulate.perception import Perception
from possmap.lab.simulate.robot import Excursion
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.steering import Done, Motion, Steering, Steps, Track
from possmap.lab.simulate.world import World
from possmap.settings.shipped import shipped

Floats = NDArray[np.float64]

NO_ERRORS: dict[str, Any] = {
    "along": 0.0, "across": 0.0, "turn_bias": 0.0, "turn_noise": 0.0, "ir_noise": 0.0,
    "odometry_step": 1e-6, "calibration_sd": 0.0,
}  # fmt: skip


def hall(width: float, height: float, *, drops: tuple[tuple[float, ...], ...] = ()) -> World:
    """Return a bare room with home in its middle."""
    walls = np.array(sides((0.0, 0.0, width, height)))
    return World("hall", walls, np.array(drops).reshape(-1, 4), (width / 2, height / 2))


def shipped_world(name: str) -> World:
    return read_mission(shipped(f"missions/{name}.yaml"), {}).world


def drive(world: World, **settings: Any) -> Mission:
    """Return a mission that is over."""
    mission = Mission(world, MissionSettings(**settings))
    for _ in mission:
        pass
    return mission


def excursions(mission: Mission) -> Iterator[Excursion]:
    for robot in mission.robots:
        yield from robot.excursions


def logs_of(mission: Mission) -> list[dict[str, Any]]:
    """Return the logs that the host receives."""
    return [one.book.as_log() for one in excursions(mission) if one.fate == "home"]


def true_places(one: Excursion, speed: float, times: Floats) -> Floats:
    """Return where a robot truly was, shape (n, 2); NaN when it was not out.

    A row of a track stands for the end of a motion; a run lasts as long as its length asks for.
    """
    clock, places = [one.track[0][0]], [one.track[0][1:3]]
    for before, after in pairwise(one.track):
        run = math.dist(before[1:3], after[1:3])
        clock += [max(clock[-1], after[0] - run / speed), after[0]]
        places += [before[1:3], after[1:3]]
    x, y = np.array(places).T
    found = np.stack([np.interp(times, clock, x), np.interp(times, clock, y)], axis=1)
    found[(times < clock[0]) | (times > one.ended_at)] = np.nan
    return found


def along_track(track: Track, step: float) -> Floats:
    """Return true places at most a step apart [m], shape (n, 2)."""
    pieces = [
        np.linspace(a[1:3], b[1:3], math.ceil(math.dist(a[1:3], b[1:3]) / step) + 1)
        for a, b in pairwise(track)
    ]
    return np.concatenate([np.array([track[0][1:3]]), *pieces])


class Bench:
    """One robot on an empty plain, to be run and turned by hand; home is (0, 0), heading +x."""

    def __init__(
        self, seed: int, faults: Faults, world: World | None = None, **settings_given: Any
    ) -> None:
        settings = MissionSettings(**settings_given)
        rng = np.random.default_rng(seed)
        self.body = Body(settings, faults, rng)
        if world is None:
            walls = np.array([[-1e4, -1e4, 1e4, -1e4]])
            world = World("plain", walls, np.empty((0, 4)), (0.0, 0.0))
        senses = Perception(world, settings, rng, lambda *_: None)
        self.steering = Steering(settings, self.body, senses)
        self.steering.book = Logbook(("r1", "r1-01"), {}, ErrorModel())
        self.steering.note_pose(0.0, 0.0, 0.0)

    def do(self, steps: Steps) -> None:
        """Let motions come to their ends."""
        try:
            motion: Motion = next(steps)
            while True:
                motion = steps.send(Done(self.steering.time + motion.seconds))
        except StopIteration:
            pass

    def run(self, distance: float) -> None:
        """Run straight [m]."""
        self.do(self.steering.run(distance))

    def turn(self, degrees: float) -> None:
        """Turn on the spot."""
        self.do(self.steering.turn(degrees))

    def missed(self) -> tuple[float, float]:
        """Return true minus logged place [m]."""
        place, pose = self.body.place, self.steering.book.belief.logged
        return place.x - pose.x, place.y - pose.y

    @property
    def heading_deg(self) -> float:
        """The true heading."""
        return math.degrees(self.body.place.heading)
