"""What a recording says, sample by sample: where the robot believed it was, what its beams read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
Place: TypeAlias = Floats | float


@dataclass(frozen=True, slots=True)
class Mount:
    """How a range sensor sits on the robot.

    angle : of its beam against the robot's heading [rad], left positive.
    x, y : of the sensor in the robot's frame, x ahead [m].
    servo : in which column of the samples' ranges stands by how much a servo turns it [rad].
    contact : of a switch, how far off it touches [m]; None: at x and y.
    """

    angle: float
    x: float = 0.0
    y: float = 0.0
    servo: int | None = None
    contact: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A piece of a recording, in the order of time; n samples, b beams.

    Attributes
    ----------
    t
        When [s], shape (n,), never falling.
    x, y
        Where the robot believed it was [m], shape (n,).
    yaw
        Where its body looked [rad], shape (n,), without jumps of a full turn.
    ranges
        What the beams read [m], shape (n, b + s); NaN: no reading; below 0: nothing in sight up to
        there, minus infinity: as far as one looks; infinity: what a switch touches. Behind the
        beams the angles of their s servos.
    begins
        Whether what comes before is no part of the same way.
    """

    t: Floats
    x: Floats
    y: Floats
    yaw: Floats
    ranges: Floats
    begins: bool = False

    def __len__(self) -> int:
        return len(self.t)

    def part(self, start: int | None, stop: int | None = None) -> Samples:
        """Return the samples from ``start`` up to ``stop``."""
        cut = slice(start, stop)
        begins = self.begins and not start
        return Samples(
            self.t[cut], self.x[cut], self.y[cut], self.yaw[cut], self.ranges[cut], begins
        )

    def moved(self, x: Floats, y: Floats, yaw: Floats | None = None) -> Samples:
        """Return the same samples at other places."""
        return replace(self, x=x, y=y, yaw=self.yaw if yaw is None else yaw)


def joined(parts: Iterable[Samples]) -> Samples:
    """Return pieces of one recording, in order, as one."""
    given = list(parts)
    if len(given) == 1:
        return given[0]
    t, x, y, yaw, ranges = (
        np.concatenate([getattr(part, name) for part in given])
        for name in ("t", "x", "y", "yaw", "ranges")
    )
    return Samples(t, x, y, yaw, ranges, given[0].begins)


def blinded(samples: Samples) -> Samples:
    """Return samples whose first reads nothing: what it read was told before."""
    ranges = samples.ranges.copy()
    ranges[:1] = np.nan
    return replace(samples, ranges=ranges)


def unwrapped(yaw: Floats, before: float | None) -> Floats:
    """Return headings without jumps of a full turn, continuing ``before`` [rad]."""
    if not len(yaw):
        return yaw
    if before is None:
        return np.unwrap(yaw)
    return np.unwrap(np.concatenate([[before], yaw]))[1:]


def off_segment(x: Floats, y: Floats, x0: Place, y0: Place, x1: Place, y1: Place) -> Floats:
    """Return the distances of points from segments [m]."""
    dx, dy = x1 - x0, y1 - y0
    length2 = np.asarray(dx * dx + dy * dy)
    along = (x - x0) * dx + (y - y0) * dy
    share = np.divide(along, length2, out=np.zeros_like(along), where=length2 > 0)
    share = np.clip(share, 0.0, 1.0)
    found: Floats = np.hypot(x - x0 - share * dx, y - y0 - share * dy)
    return found
