"""Dead reckoning: the way of a robot laid out from its wheel ticks or its speeds."""

from __future__ import annotations

import math

import numpy as np

from possmap.lab.convert.samples import Floats
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping, Ticks


class Reckoner:
    """Lays out what the rows of one table say of the way, one behind the other, from (0, 0)."""

    def __init__(self, mapping: Mapping, tally: Tally) -> None:
        self._mapping = mapping
        self._tally = tally
        self._pose: tuple[float, float, float] | None = None
        self._last_t: float | None = None
        self._last_ticks: tuple[float, float] | None = None

    def by_speeds(
        self, t: Floats, forward: Floats, turn: Floats | None, yaw: Floats | None
    ) -> tuple[Floats, Floats]:
        """Return the place (n, 2) [m] and the heading (n,) [rad] at each row.

        Each speed holds since the row before.

        Parameters
        ----------
        t
            Times, (n,) [s].
        forward, turn
            Speed ahead and rate of turn, as the file has them, (n,).
        yaw
            Heading that something else measured, which counts instead of the rate (n,) [rad].
        """
        if not len(t):
            return self._laid(forward, forward, yaw)
        seconds = np.diff(t, prepend=t[0] if self._last_t is None else self._last_t)
        self._last_t = float(t[-1])
        distance = forward * self._mapping.worth("speed") * seconds
        if turn is not None:
            turn = turn * self._mapping.worth("turn_rate") * seconds
        return self._laid(distance, turn, yaw)

    def by_ticks(self, left: Floats, right: Floats, yaw: Floats | None) -> tuple[Floats, Floats]:
        """Return the place (n, 2) [m] and the heading (n,) [rad] at each row.

        Parameters
        ----------
        left, right
            Counters, or what was counted since the row before, (n,) (docs/convert.md).
        yaw
            As above: a gyro or compass beside the wheels.
        """
        ticks = self._mapping.ticks
        if ticks is None:
            raise ValueError("ticks without what they are worth")
        if ticks.cumulative and len(left):
            left, right = self._counted(left, right, ticks)
        metres_left, metres_right = left * ticks.left, right * ticks.right
        turn = (metres_right - metres_left) / ticks.track
        return self._laid((metres_left + metres_right) / 2, turn, yaw)

    def _counted(self, left: Floats, right: Floats, ticks: Ticks) -> tuple[Floats, Floats]:
        """Return what counters went on by since the row before."""
        before = self._last_ticks or (float(left[0]), float(right[0]))
        self._last_ticks = float(left[-1]), float(right[-1])
        left, right = np.diff(left, prepend=before[0]), np.diff(right, prepend=before[1])
        if ticks.wrap is None:
            return left, right
        half = ticks.wrap / 2
        for column in (left, right):
            jumps = int((np.abs(column) > half).sum())
            self._tally.add("tick counters that began anew, continued", count=jumps)
        return (left + half) % ticks.wrap - half, (right + half) % ticks.wrap - half

    def _laid(
        self, distance: Floats, turn: Floats | None, measured: Floats | None
    ) -> tuple[Floats, Floats]:
        """Lay arcs one behind the other: way [m] and turn [rad] of each row, from the last pose."""
        x, y, yaw = self._pose or (0.0, 0.0, 0.0)
        if measured is not None:
            before = measured[:1] if self._pose is None else [yaw]
            turn = np.diff(measured, prepend=before)
            after = measured
        else:
            turn = np.zeros(len(distance)) if turn is None else turn
            after = yaw + np.cumsum(turn)
        middle = after - turn / 2
        chord = distance * np.sinc(turn / (2 * math.pi))
        place = np.column_stack(
            [x + np.cumsum(chord * np.cos(middle)), y + np.cumsum(chord * np.sin(middle))]
        )
        if len(after):
            self._pose = float(place[-1, 0]), float(place[-1, 1]), float(after[-1])
        return place, after
