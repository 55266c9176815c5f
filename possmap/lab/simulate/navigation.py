"""Navigation: where to go; partly random, along walls if there are any, and home (paper §2.3)."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np

from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.steering import Done, Motion, Steering, Steps

LONGEST_RUN_M = 4.0
AROUND_A_CORNER = 0.6
"""Probability of following a wall round its end."""
SHORTCUT_M = 0.3
"""Places of its track so near to each other are one, when it goes back; on the two sides of a thin
wall it never was so near."""
ARRIVED_M = 0.2
ASIDE_M = 0.4
TRIES = 8
"""To reach one place of the way back."""


class Lost(Exception):
    """The robot will not come home; the message says why."""


class Navigation:
    """Decides; steering executes. Turns are ±45° or ±90°, but for the way home.

    behaviour : temper and side: how often it turns at random, and where to at an obstacle.
    set_out_at : when the excursion began [s].
    """

    def __init__(
        self,
        settings: MissionSettings,
        behaviour: str,
        steering: Steering,
        rng: np.random.Generator,
    ) -> None:
        temper, _, side = behaviour.partition("-")
        self._rate: float = getattr(settings, temper)
        self._left: float = getattr(settings, side)
        self._settings = settings
        self._steering = steering
        self._perception = steering.perception
        self._rng = rng
        self.set_out_at = 0.0

    def explore(self) -> Steps:
        """Roam, and follow walls, until something asks to turn home."""
        wall_side = 0
        moved, last = 0, self._steering.body.place
        while not self._must_return():
            act = self._follow(wall_side) if wall_side else self._roam()
            wall_side = yield from act
            self._check_battery()
            place = self._steering.body.place
            moved = 0 if math.hypot(place.x - last.x, place.y - last.y) > 0.05 else moved + 1
            last = place
            if moved > 60:
                raise Lost("stuck")
            if moved and moved % 8 == 0:
                wall_side = 0
                yield from self._steering.turn(float(self._rng.choice([-90, 90])))

    def _must_return(self) -> bool:
        settings, steering = self._settings, self._steering
        return (
            steering.book.belief.worst >= settings.max_error
            or self._battery_left() < 30 * settings.battery_minutes
            or steering.book.bytes > 0.9 * settings.memory_bytes
            or steering.time >= 60 * settings.minutes
        )

    def _battery_left(self) -> float:
        return 60 * self._settings.battery_minutes - (self._steering.time - self.set_out_at)

    def _check_battery(self) -> None:
        if self._battery_left() <= 0:
            raise Lost("battery empty")

    def _until_random_turn(self) -> float:
        """Draw how far it is to the next random turn [m]."""
        return float(self._rng.exponential(1 / self._rate)) if self._rate > 0 else math.inf

    def _roam(self) -> Generator[Motion, Done, int]:
        """Run into the open; at a wall, turn along it. Return the side to follow it on, or 0."""
        steering = self._steering
        turn_at = self._until_random_turn()
        wanted = min(turn_at, LONGEST_RUN_M)
        way = self._perception.way_ahead(steering.body.place, wanted)
        if way.distance > 0.02 or way.stop == "bump":
            yield from steering.run(way.distance)
            if steering.was_stopped:
                return 0
        if steering.bumped or way.stop not in ("free", "wall"):
            yield from steering.turn(90.0 * self._side())
            return 0
        if way.stop == "free":
            if turn_at <= LONGEST_RUN_M:
                yield from steering.turn(float(self._rng.choice([-90, -45, 45, 90])))
            return 0
        self._note_ahead(None)
        return (yield from self._turn_along(way.horizontal, self._side()))

    def _note_ahead(self, beside: float | None) -> None:
        """Write down the wall ahead if the front sensor sees it."""
        reading = self._perception.front(self._steering.body.place)
        if reading is not None:
            self._steering.note_ahead(reading, beside)

    def _side(self) -> int:
        """Return which way to turn at an obstacle: +1 left with the probability P4, else -1."""
        return 1 if self._rng.random() < self._left else -1

    def _turn_along(self, horizontal: bool, turn_side: int) -> Generator[Motion, Done, int]:
        """Turn until parallel to the wall ahead, and line up; return the side of that wall."""
        heading = self._steering.body.place.heading
        first = 0.0 if horizontal else math.pi / 2
        ways = (first, first + math.pi)
        angle, way = min((((way - heading) * turn_side) % (2 * math.pi), way) for way in ways)
        eighths = round(math.degrees(angle) / 45)
        while eighths > 0:
            yield from self._steering.turn(45.0 * min(eighths, 2) * turn_side)
            eighths -= 2
        yield from self._steering.line_up(way)
        return -turn_side

    def _follow(self, side: int) -> Generator[Motion, Done, int]:
        """Run along the wall at one side; at its end, or at a corner, decide how to go on."""
        steering, perception = self._steering, self._perception
        place = steering.body.along_wall
        beside = perception.side(place, side)
        if beside is None:
            return 0
        turn_at = self._until_random_turn()
        wanted = min(turn_at, LONGEST_RUN_M)
        way = perception.way_ahead(place, wanted)
        free = way.distance
        lasts = perception.wall_lasts(place, side, free) if free > 0 else free
        if lasts < free:
            past = min(free, lasts + self._settings.length / 2 + self._settings.gap)
            yield from steering.run(past, lined_up=True, wall_side=side)
            if steering.was_stopped:
                return side
            return (yield from self._around(side))
        if free > 0.02 or way.stop == "bump":
            yield from steering.run(free, lined_up=True, wall_side=side)
            if steering.was_stopped:
                return side
        if way.stop == "wall":
            self._note_ahead(side * beside)
            return (yield from self._turn_along(way.horizontal, -side))
        if way.stop == "free" and turn_at > LONGEST_RUN_M:
            return side
        away = 90.0 if way.stop != "free" else float(self._rng.choice([45, 90]))
        yield from steering.turn(-side * away)
        return 0

    def _around(self, side: int) -> Generator[Motion, Done, int]:
        """Past a wall's end: go round it, or straight on."""
        steering, perception = self._steering, self._perception
        if self._rng.random() >= AROUND_A_CORNER:
            return 0
        yield from steering.turn(90.0 * side)
        ahead = self._settings.width / 2 + 2 * self._settings.gap + self._settings.length / 2
        way = perception.way_ahead(steering.body.place, ahead)
        if way.distance > 0.02 or way.stop == "bump":
            yield from steering.run(way.distance)
        if steering.bumped:
            yield from steering.turn(-90.0 * side)
            return 0
        if way.stop == "wall" and way.distance < ahead:
            return (yield from self._turn_along(way.horizontal, -side))
        if perception.side(steering.body.place, side) is None:
            return 0
        heading = steering.body.place.heading
        yield from steering.line_up(math.pi / 2 * round(heading / (math.pi / 2)))
        return side

    def go_home(self) -> Steps:
        """Go back along one's own track, by dead reckoning, loops cut, round what is in the way.

        Raises
        ------
        Lost
            If the battery is empty, or the believed home cannot be reached.
        """
        home = self._steering.trail[0]
        for place in way_back(self._steering.trail):
            yield from self._go_to(place)
        if not (yield from self._go_to(home)):
            raise Lost("stuck on the way home")

    def _go_to(self, target: tuple[float, float]) -> Generator[Motion, Done, bool]:
        """Go to a believed place; return whether it was reached."""
        steering, perception = self._steering, self._perception
        for _ in range(TRIES):
            self._check_battery()
            belief = steering.book.belief
            x, y = belief.corrected.place
            dx, dy = target[0] - x, target[1] - y
            distance = math.hypot(dx, dy)
            if distance < ARRIVED_M:
                return True
            away = math.degrees(math.remainder(math.atan2(dy, dx) - belief.heading, 2 * math.pi))
            yield from steering.turn(float(round(away)))
            way = perception.way_ahead(steering.body.place, distance)
            if way.distance > 0.05 or way.stop == "bump":
                yield from steering.run(way.distance)
            elif way.stop == "robot":
                yield from steering.wait(2.0)
            if steering.bumped:
                yield from self._aside(-steering.bumped)
            elif way.stop == "wall" and distance - way.distance > ARRIVED_M:
                yield from self._along_obstacle(way.horizontal, dx, dy)
        return False

    def _aside(self, side: int) -> Steps:
        """Step out of the way of what stands end-on before the robot, to one side."""
        steering = self._steering
        yield from steering.turn(90.0 * side)
        free = self._perception.way_ahead(steering.body.place, ASIDE_M).distance
        if free > 0.02:
            yield from steering.run(free)

    def _along_obstacle(self, horizontal: bool, dx: float, dy: float) -> Steps:
        """Follow what is in the way for a while, to the side where the target lies."""
        steering, perception = self._steering, self._perception
        way = math.atan2(0.0, dx) if horizontal else math.copysign(math.pi / 2, dy)
        turn = math.remainder(way - steering.body.place.heading, 2 * math.pi)
        side = -1 if turn > 0 else 1
        yield from self._turn_along(horizontal, -side)
        place = steering.body.along_wall
        free = perception.way_ahead(place, 1.2).distance
        lasts = perception.wall_lasts(place, side, free) if free > 0 else 0.0
        clear = self._settings.length / 2 + 2 * self._settings.gap
        if free > 0.05:
            yield from steering.run(min(free, lasts + clear), lined_up=True, wall_side=side)
        else:
            # In a corner there is nothing to follow: out of it, and try again.
            yield from self._aside(-side)


def way_back(trail: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the places of a track from its end to its start, loops cut out."""
    places: list[tuple[float, float]] = []
    index = len(trail) - 1
    while index > 0:
        x, y = trail[index]
        near = next(k for k, (a, b) in enumerate(trail) if math.hypot(a - x, b - y) < SHORTCUT_M)
        index = min(near, index - 1)
        places.append(trail[index])
    return places
