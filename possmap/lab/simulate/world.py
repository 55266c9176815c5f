"""The true building: axis-parallel walls and drops of the floor, and what lies ahead of a robot."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.truth.plans import Segments

Floats = NDArray[np.float64]


_TOUCH = 0.01
"""Ends so near to each other meet [m]."""
_STEP = 0.1
"""Of a robot that tries how far it can get [m]."""


class Ahead(NamedTuple):
    """The first wall in a robot's way: how far off along its heading [m], and where it lies.

    horizontal : whether it is parallel to the x axis.
    across : where its nearest part lies to the side, left positive [m].
    wall : x, y, x2, y2 [m].
    """

    distance: float
    horizontal: bool
    across: float
    wall: tuple[float, ...]


@dataclass(frozen=True)
class World:
    """A building.

    Attributes
    ----------
    name
        For people.
    walls
        Shape (n, 4): x, y, x2, y2 [m], parallel to the axes, each with x <= x2 and y <= y2.
    drops
        Shape (m, 4): rectangles x0, y0, x1, y1 [m] where the floor ends.
    home
        Where robots set out [m].

    Raises
    ------
    ValueError
        If a wall is not parallel to an axis.
    """

    name: str
    walls: Segments
    drops: Segments
    home: tuple[float, float]

    def __post_init__(self) -> None:
        oblique = (self.walls[:, 0] != self.walls[:, 2]) & (self.walls[:, 1] != self.walls[:, 3])
        if oblique.any():
            raise ValueError(f"wall {int(np.argmax(oblique))} is not parallel to an axis")

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The smallest rectangle that holds all walls: x0, y0, x1, y1 [m]."""
        low, high = self.walls[:, :2].min(axis=0), self.walls[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def ahead(
        self, x: float, y: float, heading: float, half_width: float, reach: float
    ) -> Ahead | None:
        """Return the first wall that a strip ahead of a place runs into.

        Parameters
        ----------
        x, y, heading
            Where the strip begins [m], and its direction [rad].
        half_width, reach
            Of the strip [m]; a half width of 0 makes it a ray.
        """
        far = reach + half_width
        near = self._within(x - far, y - far, x + far, y + far)
        return _first(near, x, y, heading, half_width, reach)

    def drop_ahead(self, x: float, y: float, heading: float, reach: float) -> float | None:
        """Return how far ahead the floor ends [m]; None if it does not within reach."""
        if not len(self.drops):
            return None
        found = _first(_edges(self.drops), x, y, heading, 0.0, reach)
        return None if found is None else found.distance

    def side_distances(self, x: Floats, y: Floats, direction: float, reach: float) -> Floats:
        """Return the distance to the nearest wall from each place in one direction [m].

        x, y : places [m], shape (n,); direction [rad]; beyond ``reach`` the answer is infinite.
        """
        cos, sin = math.cos(direction), math.sin(direction)
        near = self._within(x.min() - reach, y.min() - reach, x.max() + reach, y.max() + reach)
        if not len(near):
            return np.full(x.shape, math.inf)
        from_x, from_y = near[:, 0] - x[:, None], near[:, 1] - y[:, None]
        to_x, to_y = near[:, 2] - x[:, None], near[:, 3] - y[:, None]
        across, across2 = from_y * cos - from_x * sin, to_y * cos - to_x * sin
        along, along2 = from_x * cos + from_y * sin, to_x * cos + to_y * sin
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = across / (across - across2)
            distance = along + share * (along2 - along)
        hit = (across * across2 <= 0) & (across != across2) & (distance >= 0) & (distance <= reach)
        found: Floats = np.where(hit, distance, math.inf).min(axis=1)
        return found

    def _within(self, x0: float, y0: float, x1: float, y1: float) -> Segments:
        """Return the walls that touch a rectangle."""
        walls = self.walls
        touching = (
            (walls[:, 0] <= x1) & (walls[:, 2] >= x0) & (walls[:, 1] <= y1) & (walls[:, 3] >= y0)
        )
        found: Segments = walls[touching]
        return found

    def corner_kind(self, x: float, y: float) -> Literal["convex", "end"]:
        """Return what the wall end nearest to a place is: a corner if another wall meets it."""
        ends = np.concatenate([self.walls[:, :2], self.walls[:, 2:]])
        at_x, at_y = ends[int(np.argmin(np.hypot(ends[:, 0] - x, ends[:, 1] - y)))]
        touching = self._within(at_x - _TOUCH, at_y - _TOUCH, at_x + _TOUCH, at_y + _TOUCH)
        return "convex" if len(touching) > 1 else "end"

    def sees(self, x: float, y: float, x2: float, y2: float) -> bool:
        """Whether no wall lies between two places."""
        reach = math.hypot(x2 - x, y2 - y)
        near = self._within(min(x, x2), min(y, y2), max(x, x2), max(y, y2))
        return _first(near, x, y, math.atan2(y2 - y, x2 - x), 0.0, reach) is None

    def clearance(self, x: float, y: float) -> float:
        """Return the distance to the nearest wall [m]."""
        walls = self.walls
        away_x = np.maximum(0.0, np.maximum(walls[:, 0] - x, x - walls[:, 2]))
        away_y = np.maximum(0.0, np.maximum(walls[:, 1] - y, y - walls[:, 3]))
        return float(np.hypot(away_x, away_y).min(initial=math.inf))

    def reachable(self, width: float, enough: float) -> float:
        """Return how much floor a robot can reach from home in steps along the axes [m2].

        width : of its body [m]; enough: where the count ends [m2].
        """
        cells = math.ceil(enough / _STEP**2)
        seen, waiting = {(0, 0)}, deque([(0, 0)])
        while waiting and len(seen) < cells:
            column, row = waiting.popleft()
            x, y = self.home[0] + column * _STEP, self.home[1] + row * _STEP
            for across, up in ((1, 0), (0, 1), (-1, 0), (0, -1)):
                cell, heading = (column + across, row + up), math.atan2(up, across)
                if (
                    cell not in seen
                    and self.ahead(x, y, heading, width / 2, _STEP + width / 2) is None
                    and self.drop_ahead(x, y, heading, _STEP) is None
                ):
                    seen.add(cell)
                    waiting.append(cell)
        return len(seen) * _STEP**2


def _edges(rectangles: Segments) -> Segments:
    """Return the four sides of each rectangle as segments."""
    x0, y0, x1, y1 = rectangles.T
    sides = [(x0, y0, x1, y0), (x0, y1, x1, y1), (x0, y0, x0, y1), (x1, y0, x1, y1)]
    return np.concatenate([np.stack(side, axis=1) for side in sides])


def _first(
    walls: Segments, x: float, y: float, heading: float, half_width: float, reach: float
) -> Ahead | None:
    """Clip each segment to the strip in the robot's own frame, and take the nearest part ahead."""
    cos, sin = math.cos(heading), math.sin(heading)
    from_x, from_y = walls[:, 0] - x, walls[:, 1] - y
    to_x, to_y = walls[:, 2] - x, walls[:, 3] - y
    along, along2 = from_x * cos + from_y * sin, to_x * cos + to_y * sin
    across, across2 = from_y * cos - from_x * sin, to_y * cos - to_x * sin
    # Shares of the segment at which it enters and leaves |across| <= half_width.
    rise = across2 - across
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = (-half_width - across) / rise, (half_width - across) / rise
    level = rise == 0
    inside = np.abs(across) <= half_width
    enter = np.where(level, np.where(inside, 0.0, 2.0), np.minimum(one, other))
    leave = np.where(level, np.where(inside, 1.0, -1.0), np.maximum(one, other))
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    span = along2 - along
    at_enter, at_leave = along + enter * span, along + leave * span
    nearest = np.minimum(at_enter, at_leave)
    furthest = np.maximum(at_enter, at_leave)
    hit = (enter <= leave) & (furthest >= 0) & (nearest <= reach)
    if not hit.any():
        return None
    distance = np.where(hit, np.maximum(nearest, 0.0), math.inf)
    wall = int(np.argmin(distance))
    near = enter if at_enter[wall] <= at_leave[wall] else leave
    return Ahead(
        float(distance[wall]),
        bool(walls[wall, 1] == walls[wall, 3]),
        float(across[wall] + near[wall] * rise[wall]),
        tuple(walls[wall].tolist()),
    )
