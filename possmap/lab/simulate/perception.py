"""Perception: what the infrared sensors, the drop sensor and the switches tell (paper §2).

The robot's own frame: x ahead, y to the left [m]. Sensors are short-sighted, and noisy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from possmap.core.records import CornerKind
from possmap.lab.simulate.body import Place
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world import Ahead, Floats, World

SAMPLE_M = 0.1
"""Between two readings to the side while running [m]."""
JUMP_M = 0.15
"""A reading that differs more from the last is of another wall [m]."""
SEEN_M = 0.02
"""What the front sensor sees so little behind a wall is the wall [m]."""
BEND_M = 0.02
"""So is one this far off the line of the last two [m]."""

Others = Callable[[Place, float, float], float | None]
"""How far ahead another robot's body is, given place, half width and reach of a strip [m]."""


def strip_of(settings: MissionSettings) -> float:
    """Return half the width that a robot needs to pass [m]."""
    return settings.width / 2 + 0.02


Stop: TypeAlias = Literal["free", "wall", "bump", "drop", "robot"]


class Way(NamedTuple):
    """How far the body can go, and what stops it.

    distance : [m].
    stop : ``free``: nothing within reach; ``bump``: a wall that no sensor sees.
    horizontal : whether that wall is parallel to the x axis.
    across : where a bump touches the front, left positive [m].
    """

    distance: float
    stop: Stop
    horizontal: bool = False
    across: float = 0.0


class SeenPiece(NamedTuple):
    """A piece of wall seen to one side during a run, in the frame of the run's start.

    side : +1 left, -1 right.
    x, y, x2, y2 : from where to where [m].
    ended : the true place and kind of its end, if it ended while the robot ran on.
    """

    side: int
    x: float
    y: float
    x2: float
    y2: float
    ended: tuple[float, float, CornerKind] | None


class Perception:
    """Reads the true world; tells the robot only what its sensors would."""

    def __init__(
        self, world: World, settings: MissionSettings, rng: np.random.Generator, others: Others
    ) -> None:
        self._world = world
        self._settings = settings
        self._rng = rng
        self._others = others

    def _noise(self, shape: tuple[int, ...] = ()) -> Floats:
        return np.asarray(self._settings.ir_noise * self._rng.standard_normal(shape))

    def way_ahead(self, place: Place, reach: float) -> Way:
        """Return how far the body can go, at most ``reach`` [m], and what stops it.

        It stops a gap short of a wall that its sensors see, so that it can turn and follow it. What
        they miss, such as the end of a wall that points at it beside its middle, it touches.
        """
        settings = self._settings
        nose = settings.length / 2
        stop = nose + settings.gap
        strip = strip_of(settings)
        way = Way(reach, "free")
        ahead = self._world.ahead(*place, strip, reach + stop)
        if ahead is not None:
            short = max(0.0, ahead.distance - stop)
            if self._is_seen(ahead, place.moved(short), strip):
                if short < way.distance:
                    way = Way(short, "wall", ahead.horizontal)
            elif (contact := max(0.0, ahead.distance - nose)) < way.distance:
                way = Way(contact, "bump", ahead.horizontal, ahead.across)
        drop = self._world.drop_ahead(*place, reach + nose)
        if drop is not None and drop - nose - 0.05 < way.distance:
            way = Way(max(0.0, drop - nose - 0.05), "drop")
        other = self._others(place, strip, reach + stop)
        if other is not None and other - stop < way.distance:
            way = Way(max(0.0, other - stop), "robot")
        return way

    def _is_seen(self, ahead: Ahead, stop: Place, strip: float) -> bool:
        """Whether the sensors ahead see a wall from where the robot should stop before it."""
        near = self._settings.length / 2 + self._settings.gap + strip + SEEN_M
        if self._world.ahead(*stop, 0.0, near) is not None:
            return True
        aside = (
            self._world.ahead(*stop.turned(side * math.pi / 4), 0.0, near * math.sqrt(2))
            for side in (1, -1)
        )
        return any(found is not None and found.wall == ahead.wall for found in aside)

    def front(self, place: Place) -> float | None:
        """Return the reading of the front sensor from the nose [m]; None beyond its range."""
        nose = self._settings.length / 2
        ahead = self._world.ahead(*place, 0.0, self._settings.ir_range + nose)
        if ahead is None:
            return None
        return max(0.0, ahead.distance - nose + float(self._noise()))

    @property
    def _side_reach(self) -> float:
        return self._settings.width / 2 + self._settings.ir_range

    def side(self, place: Place, side: int) -> float | None:
        """Return how far a wall is to one side, from the middle of the robot [m]; None beyond."""
        distance = self._ray(place.turned(side * math.pi / 2), self._side_reach)
        return distance + float(self._noise()) if math.isfinite(distance) else None

    def five(self, place: Place) -> list[float]:
        """Return all five readings [m]: front, front left, front right, left and right."""
        reach = self._settings.ir_range + self._settings.length / 2
        rays = (place.turned(math.radians(degrees)) for degrees in (0, 45, -45, 90, -90))
        return [round(min(self._ray(ray, reach), reach) + float(self._noise()), 4) for ray in rays]

    def _ray(self, ray: Place, reach: float) -> float:
        """Return the distance from the middle of the robot to the first wall in a direction [m]."""
        at = np.array([ray.x]), np.array([ray.y])
        return float(self._world.side_distances(*at, ray.heading, reach)[0])

    def _distances(self, start: Place, along: Floats, side: int) -> Floats:
        """Return the distance to the walls at one side, from places along a run [m]."""
        x, y = start.at(along, 0.0)
        return self._world.side_distances(
            x, y, start.heading + side * math.pi / 2, self._side_reach
        )

    def wall_lasts(self, place: Place, side: int, distance: float) -> float:
        """Return how far ahead the wall at one side goes on, at most ``distance`` [m]."""
        along = np.linspace(0.0, distance, max(2, math.ceil(distance / 0.05) + 1))
        found = self._distances(place, along, side)
        gone = np.flatnonzero(~(found <= found[0] + JUMP_M))
        return float(along[gone[0]]) if gone.size else distance

    def beside(self, start: Place, distance: float) -> Iterator[SeenPiece]:
        """Yield the pieces of wall that pass by on both sides of a straight run.

        start : the true place and direction of the run; distance [m].
        """
        count = max(2, math.ceil(distance / SAMPLE_M) + 1)
        along = np.linspace(0.0, distance, count)
        for side in (1, -1):
            true = self._distances(start, along, side)
            seen = true + self._noise((count,))
            for first, last in _pieces(true):
                yield self._sighting(start, side, along, true, seen, first, last)

    def _sighting(
        self,
        start: Place,
        side: int,
        along: Floats,
        true: Floats,
        seen: Floats,
        first: int,
        last: int,
    ) -> SeenPiece:
        """Fit a straight piece to consecutive readings."""
        at, to = along[first : last + 1], seen[first : last + 1]
        slope, offset = np.polyfit(at, to, 1) if len(at) > 1 else (0.0, to[0])
        near, far = float(at[0]), float(at[-1])
        ended: tuple[float, float, CornerKind] | None = None
        on = _expected(true, first, last + 1)
        goes_on = last == first or last + 1 == len(along) or float(true[last + 1]) <= on + BEND_M
        # One that only leads out of the sensor's range has not ended either.
        if not goes_on and on <= self._side_reach:
            kind = self._world.corner_kind(*start.at(far, side * float(true[last])))
            ended = (far, side * float(to[-1]), kind)
        y, y2 = (side * float(offset + slope * x) for x in (near, far))
        return SeenPiece(side, near, y, far, y2, ended)


def _expected(distances: Floats, first: int, k: int) -> float:
    """Return reading k if the wall seen since reading ``first`` goes straight on [m]."""
    step = distances[k - 1] - distances[k - 2] if k - 2 >= first else 0.0
    return float(distances[k - 1] + step)


def _pieces(distances: Floats) -> Iterator[tuple[int, int]]:
    """Yield first and last index of readings of one wall; infinite ones belong nowhere."""
    first: int | None = None
    for k, distance in enumerate(distances.tolist()):
        if first is not None:
            off = abs(distance - _expected(distances, first, k))
            if math.isinf(distance) or off > (BEND_M if k - 2 >= first else JUMP_M):
                yield first, k - 1
                first = None
        if first is None and math.isfinite(distance):
            first = k
    if first is not None:
        yield first, len(distances) - 1
