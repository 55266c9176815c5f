"""Where beams end: chosen readings in the frame of the track, the robot's own echoes left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from possmap.lab.convert.samples import Flags, Floats, Ints, Mount, Samples, off_segment
from possmap.lab.convert.tally import Tally

ECHOES = "readings on the robot's own track, dropped as its echo"

FRONT = np.radians(45)
"""A beam that looks ahead by less sees walls that the robot then drives up to [rad]."""

THIN_M = 0.02
"""Places of the track nearer than this need not all be compared with [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What one beam saw; m readings, in the order of time.

    index : of each reading's sample, (m,).
    start, end : of the beam, (m, 2) [m].
    seen : whether it ended at something, (m,); otherwise nothing was in sight up to its end.
    turned : where each looked, against the robot's heading [rad], (m,).
    touched : whether it is what a switch touched, (m,).
    """

    index: Ints
    start: Floats
    end: Floats
    seen: Flags
    turned: Floats
    touched: Flags

    def part(self, kept: Flags) -> Hits:
        """Return some of them, by a flag each."""
        return Hits(
            self.index[kept], self.start[kept], self.end[kept],
            self.seen[kept], self.turned[kept], self.touched[kept],
        )  # fmt: skip


def hits(samples: Samples, mounts: Sequence[Mount], reach: float) -> list[Hits]:
    """Return what each beam saw.

    Parameters
    ----------
    reach
        What is farther off is out of sight [m].
    """
    found = []
    cos, sin = np.cos(samples.yaw), np.sin(samples.yaw)
    for column, mount in enumerate(mounts):
        read = samples.ranges[:, column]
        index = np.flatnonzero(~np.isnan(read))
        start = np.column_stack(
            [
                samples.x[index] + cos[index] * mount.x - sin[index] * mount.y,
                samples.y[index] + sin[index] * mount.x + cos[index] * mount.y,
            ]
        )
        turned = np.full(len(index), mount.angle)
        if mount.servo is not None:
            turned += samples.ranges[index, mount.servo]
        length = read[index]
        touched = np.isposinf(length)
        length = np.where(touched, mount.contact or 0.0, length)
        seen = (length >= 0) & (length <= reach)
        length = np.where(seen, length, np.where(length < 0, np.minimum(-length, reach), reach))
        angle = samples.yaw[index] + turned
        end = start + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        found.append(Hits(index, start, end, seen, turned, touched))
    return found


def without_echoes(
    given: Hits, t: Floats, track: Samples, near: float, within: float, tally: Tally
) -> Hits:
    """Leave out readings that ended where the robot itself was about that time.

    Of what a front sensor saw, only where the robot has passed, or been beyond: it may drive up to
    a wall as near as it likes.

    Parameters
    ----------
    t
        When each reading was taken [s], (m,).
    track
        Where the robot was, from before the readings until after them.
    near, within
        How near to the track [m], within how many seconds of the reading.
    """
    if not near or not len(given.index):
        return given
    way = np.cumsum(
        np.hypot(np.diff(track.x, prepend=track.x[0]), np.diff(track.y, prepend=track.y[0]))
    )
    # A place for each two centimetres stands for all between: a robot may stand for hours.
    kept = np.flatnonzero(np.diff(np.floor(way / THIN_M), prepend=-1.0))
    kept = np.union1d(kept, [len(way) - 1])
    x, y, when = track.x[kept], track.y[kept], track.t[kept]
    first = np.maximum(np.searchsorted(when, t - within) - 1, 0)
    last = np.searchsorted(when, t + within, side="right")
    echo = np.zeros(len(t), dtype=np.bool_)
    open_ones = np.flatnonzero(given.seen)
    front = np.abs(np.arctan2(np.sin(given.turned), np.cos(given.turned))) < FRONT
    ray = given.end - given.start

    def beyond(x: Floats, y: Floats) -> Floats:
        """Return how far beyond the ends places lie, along the beams; of any scale."""
        (end_x, end_y), (ray_x, ray_y) = given.end[open_ones].T, ray[open_ones].T
        found: Floats = (x - end_x) * ray_x + (y - end_y) * ray_y
        return found

    for step in range(int((last - first).max())):
        at = first[open_ones] + step
        open_ones, at = open_ones[at < last[open_ones]], at[at < last[open_ones]]
        then = np.minimum(at + 1, len(x) - 1)
        end_x, end_y = given.end[open_ones].T
        found = off_segment(end_x, end_y, x[at], y[at], x[then], y[then]) < near
        found &= ~front[open_ones] | (beyond(x[then], y[then]) > 0) | (beyond(x[at], y[at]) > 0)
        echo[open_ones[found]] = True
        open_ones = open_ones[~found]
    tally.add(ECHOES, count=int(echo.sum()))
    return given.part(~echo)
