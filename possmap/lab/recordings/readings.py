"""The rows of one table as arrays: units turned, ticks laid out, readings that are none marked."""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass

import numpy as np

from possmap.core.ranges import LARGEST
from possmap.errors import RecordingError
from possmap.lab.convert.samples import Flags, Floats, unwrapped
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.reckoning import Reckoner
from possmap.lab.recordings.sense import JumpGuard, readable, spikes

STUBBORN = 100
"""So many samples in a row behind the clock, and it has been set back for good."""

FASTEST = 1000.0
"""A faster robot has not been seen: such a velocity is not measured [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What some rows of a table say; n rows, in the order of time.

    t : [s]. place : (n, 2) [m]. yaw : (n,) [rad]. ranges : (n, k) [m].
    What the table does not say is None.
    """

    t: Floats
    place: Floats | None
    yaw: Floats | None
    ranges: Floats | None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def says_ranges(self) -> Flags:
        """Which rows hold a reading, (n,)."""
        ranges = np.empty((len(self), 0)) if self.ranges is None else self.ranges
        found: Flags = np.logical_or.reduce(~np.isnan(ranges), axis=1)
        return found

    def part(self, start: int, stop: int | None = None) -> Readings:
        """Return the rows from ``start`` up to ``stop``."""
        cut = slice(start, stop)
        return Readings(
            self.t[cut],
            *(
                None if column is None else column[cut]
                for column in (self.place, self.yaw, self.ranges)
            ),
        )

    def followed_by(self, later: Readings) -> Readings:
        """Return these rows with later ones behind them."""
        return Readings(
            np.concatenate([self.t, later.t]),
            *(
                None if one is None or other is None else np.concatenate([one, other])
                for one, other in (
                    (self.place, later.place),
                    (self.yaw, later.yaw),
                    (self.ranges, later.ranges),
                )
            ),
        )


class Interpreter:
    """Turns the columns of one table into readings; remembers what the next rows build on."""

    def __init__(self, name: str, table: Table, mapping: Mapping, tally: Tally) -> None:
        self._name = name
        self._table = table
        self._mapping = mapping
        self._tally = tally
        self._guard = JumpGuard(mapping.guard, tally)
        self._reckoner = Reckoner(mapping, tally)
        self._clock = -math.inf
        self._behind = 0
        self._yaw: float | None = None
        self._rows = 0
        self._lost = 0
        self._first_lost = 0
        self._why = ""

    def lose(self, what: str, line: int, why: Callable[[], str] = str) -> None:
        """Count a row that cannot be read, and so is not given to ``read``.

        Parameters
        ----------
        why
            Says what is wrong with it; asked of the first alone.
        """
        if not self._lost:
            self._why = why()
        self._tally.add(what, f"{self._name}:{line}")
        self._rows += 1
        self._count_lost(1, line)

    def finish(self) -> None:
        """Check, behind the last row, that most of the table was of use.

        A row that says NaN for a pose says something, and is not counted here.

        Raises
        ------
        RecordingError
            If more than half of the rows could not be read, or stood behind the clock.
        """
        if 2 * self._lost > self._rows:
            raise RecordingError(
                f"{self._name}:{self._first_lost}",
                f"{self._lost} of {self._rows} rows cannot be read or run backwards in time, "
                f"the first here, expected at most half{self._why and f' ({self._why})'}",
            )

    def read(
        self, columns: MappingABC[str, Floats], ranges: Floats | None, lines: Floats
    ) -> Readings:
        """Return what rows say.

        Parameters
        ----------
        columns
            By role, as the file has them, each of shape (n,); without ``t``, ``row`` holds the
            number of each row, from 0.
        ranges
            As the file has them, (n, k).
        lines
            Where each row stands in the file, for messages, (n,).

        Raises
        ------
        RecordingError
            If the clock was set back for good, or the way leads beyond all bounds.
        """
        self._rows += len(lines)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is found below
            t = self._times(columns)
            keep = self._sound(t, columns, lines)
            if not keep.all():
                columns = {role: column[keep] for role, column in columns.items()}
                t, lines = t[keep], lines[keep]
                ranges = None if ranges is None else ranges[keep]
            place, yaw = self._poses(t, columns)
            self._check_bounds(place, yaw, lines)
            if ranges is not None:
                ranges = readable(ranges, self._mapping, self._tally)
        return Readings(t, place, yaw, ranges)

    def _times(self, columns: MappingABC[str, Floats]) -> Floats:
        if "t" in columns:
            return columns["t"] * self._mapping.worth("time")
        return columns["row"] * (self._mapping.period or 1.0)

    def _sound(self, t: Floats, columns: MappingABC[str, Floats], lines: Floats) -> Flags:
        """Return which rows can be used: finite, in bounds, and not behind the clock."""
        sound = np.isfinite(t)
        for role, column in columns.items():
            if role not in ("t", "vx", "vy"):
                sound &= np.isfinite(column)
        self._left_out("rows with NaN or infinity for a pose, skipped", ~sound, lines)
        if "qw" in columns:
            empty = sound & (sum(np.abs(columns[role]) for role in ("qx", "qy", "qz", "qw")) == 0)
            self._left_out("rows with a quaternion of zeros, skipped", empty, lines)
            sound &= ~empty
        far = np.zeros(len(t), dtype=np.bool_)
        for role, quantity in (("x", "length"), ("y", "length"), ("yaw", "angle")):
            if role in columns:
                far |= np.abs(columns[role]) * self._mapping.worth(quantity) > LARGEST
        self._left_out("rows with a place or heading beyond ±1e6, skipped", sound & far, lines)
        sound &= ~far
        ahead = sound & spikes(np.where(sound, t, np.nan))
        self._left_out("rows whose clock jumped ahead and back, skipped", ahead, lines)
        sound &= ~ahead
        times = np.where(sound, t, -math.inf)
        latest = np.maximum.accumulate(np.concatenate([[self._clock], times]))
        behind = sound & (t < latest[:-1])
        self._left_out("rows whose clock ran backwards, skipped", behind, lines)
        self._check_clock(t, behind, sound, latest, lines)
        if behind.any():
            self._count_lost(int(behind.sum()), int(lines[int(np.argmax(behind))]))
        self._clock = float(latest[-1])
        kept: Flags = sound & ~behind
        return kept

    def _count_lost(self, count: int, first: int) -> None:
        self._first_lost = self._first_lost or first
        self._lost += count

    def _check_clock(
        self, t: Floats, behind: Flags, sound: Flags, latest: Floats, lines: Floats
    ) -> None:
        if not behind.any():
            self._behind = 0 if sound.any() else self._behind
            return
        for index in np.flatnonzero(sound).tolist():
            self._behind = self._behind + 1 if behind[index] else 0
            if self._behind == STUBBORN:
                raise RecordingError(
                    f"{self._name}:{int(lines[index])}",
                    f"the clock, found {t[index]:.3f} s after {latest[index]:.3f} s and "
                    f"{STUBBORN} rows without catching up, expected times that rise; "
                    "cut the recording where it was set back",
                )

    def _left_out(self, what: str, which: Flags, lines: Floats) -> None:
        if which.any():
            first = int(lines[int(np.argmax(which))])
            self._tally.add(what, f"{self._name}:{first}", int(which.sum()))

    def _poses(
        self, t: Floats, columns: MappingABC[str, Floats]
    ) -> tuple[Floats | None, Floats | None]:
        """Return the place and the heading at each row; None for what the table does not say."""
        yaw = self._yaw_of(columns)
        place = None
        if "x" in columns:
            place = np.column_stack([columns["x"], columns["y"]]) * self._mapping.worth("length")
        elif "forward" in columns:
            forward, turn = columns["forward"], columns.get("turn")
            place, yaw = self._reckoner.by_speeds(t, forward, turn, yaw)
        elif "left" in columns:
            place, yaw = self._reckoner.by_ticks(columns["left"], columns["right"], yaw)
        if "vx" in columns and place is not None:
            velocity = np.column_stack([columns["vx"], columns["vy"]])
            velocity = velocity * self._mapping.worth("speed")
            velocity[~(np.abs(velocity) <= FASTEST).all(axis=1)] = np.nan
            if self._mapping.velocity_in_body and yaw is not None:
                velocity = turned(velocity, yaw)
            place = self._guard.mended(t, place, velocity)
        return place, yaw

    def _yaw_of(self, columns: MappingABC[str, Floats]) -> Floats | None:
        yaw: Floats
        if "yaw" in columns:
            yaw = columns["yaw"] * self._mapping.worth("angle")
        elif "qw" in columns:
            yaw = of_quaternion(*(columns[role] for role in ("qx", "qy", "qz", "qw")))
        else:
            return None
        yaw = unwrapped(yaw, self._yaw)
        if len(yaw):
            self._yaw = float(yaw[-1])
        return yaw

    def _check_bounds(self, place: Floats | None, yaw: Floats | None, lines: Floats) -> None:
        """Refuse a way that ticks, speeds or velocities lead beyond what a log can hold."""
        inside = np.ones(len(lines), dtype=np.bool_)
        if place is not None:
            inside &= (np.abs(place) <= LARGEST).all(axis=1)
        if yaw is not None:
            inside &= np.abs(yaw) <= LARGEST
        if not inside.all():
            line = int(lines[int(np.argmin(inside))])
            raise RecordingError(
                f"{self._name}:{line}",
                "the way computed up to here leads beyond ±1e6 m or rad, expected speeds or "
                "ticks of a robot",
            )


def of_quaternion(qx: Floats, qy: Floats, qz: Floats, qw: Floats) -> Floats:
    """Return the heading of a body by its quaternion [rad], which need not be of length 1."""
    # Of a size near 1, or the squares of huge or tiny numbers would be lost.
    _, size = np.frexp(np.max(np.abs([qx, qy, qz, qw]), axis=0))
    qx, qy, qz, qw = (np.ldexp(part, -size) for part in (qx, qy, qz, qw))
    east, north = qw * qw + qx * qx - qy * qy - qz * qz, 2 * (qw * qz + qx * qy)
    yaw: Floats = np.arctan2(north, east)
    return yaw


def turned(vectors: Floats, yaw: Floats) -> Floats:
    """Return vectors of the robot's frame in that of its track, (n, 2)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = vectors.T
    found: Floats = np.column_stack([ahead * cos - left * sin, ahead * sin + left * cos])
    return found
