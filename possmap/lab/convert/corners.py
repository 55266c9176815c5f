"""Singular points: where two fitted walls meet, and where one ends in the open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from possmap.core.records import CornerKind
from possmap.lab.convert.lines import FittedWall
from possmap.lab.convert.samples import Samples

MEET_M = 0.3
"""A corner is no farther than this from what was seen of both its walls [m]."""

SOON_S = 6.0
"""Walls seen within so many seconds of each other may meet: odometry drifts later."""

SHARPEST = math.radians(30)
"""Walls that differ less are one wall, bent."""


class FoundCorner(NamedTuple):
    """A corner: the sample at which it was known, its place [m] and its kind."""

    sample: int
    x: float
    y: float
    kind: CornerKind


def corners(walls: Sequence[FittedWall], samples: Samples) -> list[FoundCorner]:
    """Return the corners of walls seen soon after one another, each once, in the order of time."""
    ordered = sorted(walls, key=lambda wall: int(wall.index[0]))
    found: list[FoundCorner] = []
    met: set[int] = set()
    for number, wall in enumerate(ordered):
        over = float(samples.t[wall.index[-1]])
        for other in ordered[number + 1 :]:
            if samples.t[other.index[0]] > over + SOON_S:
                break
            corner = _meeting(wall, other, samples)
            if corner is None:
                continue
            met.add(id(wall))
            if not any(_same(corner, one) for one in found[-8:]):
                found.append(corner)
    for wall in ordered:
        if wall.stops and id(wall) not in met:
            found.append(FoundCorner(int(wall.index[-1]), *wall.end, "end"))
    return sorted(found)


def _same(one: FoundCorner, other: FoundCorner) -> bool:
    return math.hypot(one.x - other.x, one.y - other.y) < MEET_M


def _meeting(one: FittedWall, other: FittedWall, samples: Samples) -> FoundCorner | None:
    """Return the corner of two walls; None where they do not meet."""
    (ux, uy), (vx, vy) = one.direction, other.direction
    cross = ux * vy - uy * vx
    if abs(cross) < math.sin(SHARPEST):
        return None
    dx, dy = other.origin[0] - one.origin[0], other.origin[1] - one.origin[1]
    along_one, along_other = (dx * vy - dy * vx) / cross, (dx * uy - dy * ux) / cross
    sides = []
    for wall, along in ((one, along_one), (other, along_other)):
        low, high = float(wall.along.min()), float(wall.along.max())
        if not low - MEET_M <= along <= high + MEET_M:
            return None
        # Which way the wall lies from the corner; in its middle, walls cross and do not end.
        if low + MEET_M < along < high - MEET_M:
            return None
        sides.append(1.0 if along < (low + high) / 2 else -1.0)
    x, y = one.point(along_one)
    at = int(max(one.index[0], other.index[0]))
    # Concave if the robot stands between the walls, on the side of less than half a turn.
    rx, ry = float(samples.x[at]) - x, float(samples.y[at]) - y
    ax, ay, bx, by = sides[0] * ux, sides[0] * uy, sides[1] * vx, sides[1] * vy
    turn = ax * by - ay * bx
    share_a, share_b = (rx * by - ry * bx) / turn, (ax * ry - ay * rx) / turn
    kind: CornerKind = "concave" if share_a > 0 and share_b > 0 else "convex"
    return FoundCorner(at, x, y, kind)
