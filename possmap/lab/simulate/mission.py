"""The mission: time goes on, robots act, meet, talk, and give way to each other (METHOD §5)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from possmap.lab.simulate.body import Place
from possmap.lab.simulate.logbook import RECORD_BYTES, exchange
from possmap.lab.simulate.perception import strip_of
from possmap.lab.simulate.robot import Robot
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.steering import Done, Motion, Steps
from possmap.lab.simulate.world import World

TICK_S = 0.1
"""Between two looks at who is near whom [s]."""
BODY_M = 0.14
"""Radius of a body for the others [m]."""
GIVE_WAY_M = 0.6
"""Robots nearer than this mind each other's way [m]."""
PATIENCE_S = 1.5
"""Before the same two look again [s]."""


@dataclass(frozen=True, slots=True)
class Meeting:
    """When two robots met, and how many records the first gave and took."""

    time: float
    robot: str
    peer: str
    given: int
    taken: int


@dataclass
class _Acting:
    """A robot in the middle of a motion."""

    robot: Robot
    steps: Steps
    motion: Motion
    started: float
    ends: float
    heard: dict[str, float] = field(default_factory=dict)
    silent_until: float = 0.0

    def place(self, time: float) -> Place:
        """Return where it truly is."""
        length = self.motion.seconds
        share = (time - self.started) / length if length > 0 else 1.0
        return self.motion.at(min(1.0, max(0.0, share)))


class Mission:
    """A team in a world. Iterate over it to let time pass; it yields the time reached [s]."""

    def __init__(self, world: World, settings: MissionSettings) -> None:
        self.world = world
        self.settings = settings
        self.time = 0.0
        self.steps = 0
        self.meetings: list[Meeting] = []
        self.robots: list[Robot] = []
        self._acting: list[_Acting] = []
        self._rng = np.random.default_rng([settings.seed, 1 << 20])
        for number in range(settings.robots):
            robot = Robot(number, world, settings, partial(self._ahead, number))
            steps = robot.live()
            motion = next(steps)
            self.robots.append(robot)
            self._acting.append(_Acting(robot, steps, motion, 0.0, motion.seconds))

    def __iter__(self) -> Iterator[float]:
        while self._acting:
            self.time += TICK_S
            self._act()
            out = [one for one in self._acting if one.robot.is_out]
            self.steps += len(out)
            if len(out) > 1:
                self._mind_each_other(out)
            elif self._acting:
                # Nobody to meet: nothing happens before the next motion ends.
                next_end = min(one.ends for one in self._acting)
                ticks = max(0, math.floor((next_end - self.time) / TICK_S))
                self.time += ticks * TICK_S
                self.steps += ticks * len(out)
            yield self.time

    def _act(self) -> None:
        """Let every robot whose motion has ended decide on its next one."""
        for one in list(self._acting):
            while one.ends <= self.time:
                self._go_on(one, Done(one.ends))

    def _go_on(self, one: _Acting, done: Done) -> None:
        """Tell a robot how its motion ended, and let it decide on the next, if any."""
        try:
            one.motion = one.steps.send(done)
        except StopIteration:
            self._acting.remove(one)
            one.ends = math.inf
        else:
            one.started, one.ends = done.time, done.time + one.motion.seconds

    def _stop(self, one: _Acting, hold: float) -> None:
        """Make a robot stand still from now on; a run is cut short, anything else takes longer."""
        if not one.motion.moves:
            one.ends += hold
            return
        share = (self.time - one.started) / one.motion.seconds
        self._go_on(one, Done(self.time, min(1.0, max(0.0, share)), hold))

    def _mind_each_other(self, out: list[_Acting]) -> None:
        """Find who is near whom, through cells of the size of the reach: never all pairs."""
        reach = max(GIVE_WAY_M, self.settings.radio_range)
        cells: dict[tuple[int, int], list[int]] = {}
        places = [one.place(self.time) for one in out]
        for index, place in enumerate(places):
            cell = (math.floor(place.x / reach), math.floor(place.y / reach))
            cells.setdefault(cell, []).append(index)
        for (column, row), here in sorted(cells.items()):
            for i in here:
                for dx, dy in ((0, 0), (1, -1), (1, 0), (1, 1), (0, 1)):
                    for j in cells.get((column + dx, row + dy), ()):
                        if (dx, dy) != (0, 0) or i < j:
                            # The same two in the same order, wherever they are.
                            a, b = sorted((i, j))
                            self._near(out[a], out[b], places[a], places[b])

    def _near(self, one: _Acting, other: _Acting, at: Place, to: Place) -> None:
        distance = math.hypot(to.x - at.x, to.y - at.y)
        if not (one.robot.is_out and other.robot.is_out):
            return
        name = other.robot.name
        rested = self.time >= max(one.silent_until, other.silent_until)
        talks = self.settings.exchange and rested and distance <= self.settings.radio_range
        if talks and self.time >= one.heard.get(name, -math.inf):
            if not self.world.sees(at.x, at.y, to.x, to.y):
                return
            one.heard[name] = self.time + self.settings.radio_pause
            if self._rng.random() >= self.settings.radio_loss:
                self._talk(one, other)
                return
        if distance > GIVE_WAY_M:
            return
        waits = f"way:{name}"
        is_due = self.time >= one.heard.get(waits, -math.inf)
        touching = [
            acting for acting, here, there in ((one, at, to), (other, to, at))
            if self._would_touch(acting, here, there)
        ]  # fmt: skip
        if not (is_due or touching) or not self.world.sees(at.x, at.y, to.x, to.y):
            return
        if is_due:
            one.heard[waits] = self.time + PATIENCE_S
            self._give_way(one, other, at, to)
        for acting in touching:
            if acting.motion.moves:
                self._stop(acting, float(self._rng.uniform(0.5, 3.0)))

    def _would_touch(self, one: _Acting, at: Place, to: Place) -> bool:
        """Whether a robot would run into another one, whoever has the right of way."""
        if not one.motion.moves:
            return False
        way = _ahead_of(at, to, strip_of(self.settings))
        return way is not None and way < self.settings.length / 2 + self.settings.gap

    def _talk(self, one: _Acting, other: _Acting) -> None:
        """Stop, write down the run so far, hand over, and stand still for as long as it takes."""
        settings = self.settings
        budget = int(settings.radio_rate * settings.radio_stop)
        # Both first write down where they are: only finished records are handed over.
        for acting in (one, other):
            self._stop(acting, 0.0)
        books = one.robot.steering.book, other.robot.steering.book
        given, taken = exchange(*books, budget, settings.memory_bytes)
        for book, peer in (books, books[::-1]):
            book.meeting(self.time, peer)
        hold = (given + taken) * RECORD_BYTES / settings.radio_rate
        for acting in (one, other):
            acting.silent_until = self.time + hold + settings.radio_rest
            if acting in self._acting:
                self._stop(acting, hold)
        self.meetings.append(
            Meeting(round(self.time, 2), one.robot.name, other.robot.name, given, taken)
        )

    def _give_way(self, one: _Acting, other: _Acting, at: Place, to: Place) -> None:
        """Right before left: who receives the other's emitter, 0 to 90° to its left, yields."""
        one_yields = 0 <= _bearing(to, at) <= math.pi / 2 and _is_ahead(at, to)
        other_yields = 0 <= _bearing(at, to) <= math.pi / 2 and _is_ahead(to, at)
        if not (one_yields or other_yields):
            one_yields, other_yields = _is_ahead(at, to), _is_ahead(to, at)
        for yields, acting in ((one_yields, one), (other_yields, other)):
            if yields and acting.motion.moves:
                # Head-on both yield, for times of their own, so that one goes first.
                self._stop(acting, float(self._rng.uniform(0.5, 3.0)))

    def _ahead(self, number: int, place: Place, half_width: float, reach: float) -> float | None:
        """Return how far ahead of a robot another one's body is [m]."""
        found = (
            _ahead_of(place, acting.place(self.time), half_width)
            for acting in self._acting
            if acting.robot.number != number and acting.robot.is_out
        )
        return min((one for one in found if one is not None and one < reach), default=None)


def _ahead_of(at: Place, to: Place, half_width: float) -> float | None:
    """Return how far ahead another body is [m]; None if it is not in the strip ahead."""
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    dx, dy = to.x - at.x, to.y - at.y
    along, across = dx * cos + dy * sin, dy * cos - dx * sin
    if along <= 0 or abs(across) >= half_width + BODY_M:
        return None
    return max(0.0, along - BODY_M)


def _bearing(at: Place, to: Place) -> float:
    """Return where ``to`` lies, seen from ``at``, left positive [rad]."""
    return math.remainder(math.atan2(to.y - at.y, to.x - at.x) - at.heading, 2 * math.pi)


def _is_ahead(at: Place, to: Place) -> bool:
    return abs(_bearing(at, to)) < math.radians(75)
