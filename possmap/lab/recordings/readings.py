"""The rows of one table as arrays: units turned, clocks ordered, readings that are none marked."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass

import numpy as np

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Flags, Floats, unwrapped
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import BeamColumn
from possmap.lab.recordings.clocks import Clock
from possmap.lab.recordings.guard import JumpGuard
from possmap.lab.recordings.leaps import Leaps
from possmap.lab.recordings.mapping import Mapping, Table, Ticks
from possmap.lab.recordings.ranges import Ranges
from possmap.lab.recordings.recording import Handling
from possmap.lab.recordings.roles import HEADINGS, said

FARTHEST = 1e9
"""No coordinate of a recording lies beyond this [m]; those of a log lie much nearer."""

FASTEST = 1000.0
"""A faster robot has not been seen: such a velocity is not measured [m/s]."""

_WITHOUT_NUMBER = "rows with NaN or infinity for a pose, skipped"


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What some rows of a table say; n rows, in the order of time.

    t : [s]. place : (n, 2), or the way so far, (n, 1) [m]. yaw : (n,) [rad].
    ranges : (n, k), as samples have them. piece : (n,), the number of the excursion, from 0.
    What the table does not say is None.
    """

    t: Floats
    place: Floats | None
    yaw: Floats | None
    ranges: Floats | None
    piece: Floats | None = None

    def __len__(self) -> int:
        return len(self.t)

    @property
    def says_ranges(self) -> Flags:
        """Which rows hold a reading, (n,)."""
        ranges = np.empty((len(self), 0)) if self.ranges is None else self.ranges
        found: Flags = np.logical_or.reduce(~np.isnan(ranges), axis=1)
        return found

    def _columns(self) -> tuple[Floats | None, ...]:
        return self.place, self.yaw, self.ranges, self.piece

    def part(self, start: int, stop: int | None = None) -> Readings:
        """Return the rows from ``start`` up to ``stop``."""
        cut = slice(start, stop)
        return Readings(self.t[cut], *(c if c is None else c[cut] for c in self._columns()))

    def followed_by(self, later: Readings) -> Readings:
        """Return these rows with later ones behind them."""
        both = zip(self._columns(), later._columns(), strict=True)
        return Readings(
            np.concatenate([self.t, later.t]),
            *(None if a is None or b is None else np.concatenate([a, b]) for a, b in both),
        )


class Interpreter:
    """Turns the columns of one table into readings; remembers what the next rows build on.

    Parameters
    ----------
    beams
        Of the ranges that are read, in their order.
    """

    def __init__(
        self,
        name: str,
        table: Table,
        mapping: Mapping,
        beams: Sequence[BeamColumn],
        tally: Tally,
        handling: Handling,
    ) -> None:
        self._name = name
        self._mapping = mapping
        self._ranges = Ranges(beams, mapping, tally)
        self._heading = next(iter(said(HEADINGS, table.columns)), None)
        self._tally = tally
        self._clock = Clock(name, tally)
        self._guard = JumpGuard(mapping.guard, tally)
        self._sparse = handling.sparse
        self._leaps = Leaps(name, handling.jump, handling.max_speed, tally)
        self._yaw: float | None = None
        self._t: float | None = None
        self._rolled: Floats | None = None
        self._counted: tuple[float, float] | None = None
        self._laid: tuple[Floats, float] | None = None
        self._rows = 0
        self._lost = 0
        self._first_lost = 0
        self._why = ""
        if "turn" in table.columns and self._heading not in (None, "turn"):
            tally.note(f"role turn is not read, beside a heading from {self._heading}")

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

        Raises
        ------
        RecordingError
            If more than half of the rows were dropped.
        """
        if 2 * self._lost > self._rows and not self._sparse:
            raise RecordingError(
                f"{self._name}:{self._first_lost}",
                f"{self._lost} of {self._rows} rows cannot be used, the first here, expected at "
                f"most half{f' ({self._why})' if self._why else self._tally.explanation()}",
            )

    def read(
        self,
        columns: MappingABC[str, Floats],
        ranges: Floats | None,
        lines: Floats,
        longest: Floats | None = None,
    ) -> Readings:
        """Return what rows say.

        Parameters
        ----------
        columns
            By role, as the file has them, each of shape (n,); without ``t``, ``row`` holds the
            number of each row, from 0.
        ranges
            As the file has them, behind them the angles of servos, (n, k).
        lines
            Where each row stands in the file, for messages, (n,).
        longest
            How far each row says that its sensor sees, (n, 1) [m]; this long, it saw nothing.

        Raises
        ------
        RecordingError
            If the clock was set back for good, or the way leads beyond all bounds.
        """
        self._rows += len(lines)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is found below
            t = self._times(columns)
            keep = self._sound(t, columns, lines)
            keep &= self._clock.forward(t, keep, lines, self._count_lost)
            if not keep.all():
                columns = {role: column[keep] for role, column in columns.items()}
                t, lines = t[keep], lines[keep]
                ranges = None if ranges is None else ranges[keep]
                longest = None if longest is None else longest[keep]
            if ranges is not None:
                ranges = self._ranges.read(ranges, longest)
            t = self._clock.ordered(t, self._what(columns), ranges, lines)
            return self._settled(t, columns, ranges, lines)

    def _times(self, columns: MappingABC[str, Floats]) -> Floats:
        if "t" in columns:
            return columns["t"] * self._mapping.worth("time")
        return columns["row"] * (self._mapping.period or 1.0)

    def _what(self, columns: MappingABC[str, Floats]) -> Floats | None:
        """Return what rows say of the pose, (n, k): of one time they may say one thing."""
        told = [column for role, column in columns.items() if role not in ("t", "row")]
        return np.column_stack(told) if told else None

    def _sound(self, t: Floats, columns: MappingABC[str, Floats], lines: Floats) -> Flags:
        """Return which rows can be used: those with finite numbers, in bounds."""
        sound = np.isfinite(t)
        for role, column in columns.items():
            if role not in ("t", "vx", "vy"):
                sound &= np.isfinite(column)
        self._left_out(_WITHOUT_NUMBER, ~sound, lines)
        if "qw" in columns:
            parts = [np.abs(columns[role]) for role in ("qx", "qy", "qz", "qw") if role in columns]
            empty = sound & (np.sum(parts, axis=0) == 0)
            self._left_out("rows with a quaternion of zeros, skipped", empty, lines)
            sound &= ~empty
        far = np.zeros(len(t), dtype=np.bool_)
        for role in ("x", "y", "yaw", "compass"):
            if role in columns:
                far |= np.abs(columns[role]) * self._mapping.worth_of(role) > FARTHEST
        self._left_out("rows with a place or heading beyond ±1e9, skipped", sound & far, lines)
        return sound & ~far

    def _count_lost(self, count: int, first: int) -> None:
        self._first_lost = self._first_lost or first
        self._lost += count

    def _left_out(self, what: str, which: Flags, lines: Floats) -> None:
        if which.any():
            first = int(lines[int(np.argmax(which))])
            self._tally.add(what, f"{self._name}:{first}", int(which.sum()))
            self._count_lost(int(which.sum()), first)

    def _settled(
        self,
        t: Floats,
        columns: MappingABC[str, Floats],
        ranges: Floats | None,
        lines: Floats,
    ) -> Readings:
        """Return the readings of rows that are in order: their places without jumps."""
        yaw = self._measured(t, columns)
        place, ticks = self._place(t, columns, yaw)
        # What a gyro or a wheel tells of the heading turns with no frame.
        frame = yaw if place is not None and ticks is None and self._heading != "turn" else None
        self._t = float(t[-1]) if len(t) else self._t
        if place is None:
            self._check_bounds(place, yaw, lines)
            return Readings(t, None, yaw, ranges)
        found = self._leaps.settle(t, place, frame, lines, rolled="x" not in columns)
        if not found.keep.all():
            t, lines = t[found.keep], lines[found.keep]
            ranges = None if ranges is None else ranges[found.keep]
            yaw = None if yaw is None else yaw[found.keep]
            dropped = np.flatnonzero(~found.keep)
            self._count_lost(len(dropped), int(lines[0]) if len(lines) else 0)
        place, yaw = found.place, yaw if frame is None else found.yaw
        if ticks is not None and len(place):
            if yaw is None:
                yaw = (place[:, 1] - place[:, 0]) / ticks.track
            place = place.mean(axis=1, keepdims=True)
        self._check_bounds(place, yaw, lines)
        return Readings(t, place, yaw, ranges, found.piece)

    def _place(
        self, t: Floats, columns: MappingABC[str, Floats], yaw: Floats | None
    ) -> tuple[Floats | None, Ticks | None]:
        """Return x and y, the way so far, or what each wheel rolled, (n, k) [m]; then the ticks."""
        mapping = self._mapping
        if "x" in columns:
            place = np.column_stack([columns["x"], columns["y"]]) * mapping.worth("length")
            if "vx" in columns:
                velocity = np.column_stack([columns["vx"], columns["vy"]]) * mapping.worth("speed")
                velocity[~(np.abs(velocity) <= FASTEST).all(axis=1)] = np.nan
                if mapping.velocity_in_body and yaw is not None:
                    velocity = turned(velocity, yaw)
                place = self._guard.mended(t, place, velocity)
            return place, None
        if "forward" in columns:
            way = columns["forward"] * mapping.worth("speed") * self._seconds(t)
            return self._summed(way[:, None]), None
        if "left" not in columns or mapping.ticks is None:
            return None, None
        ticks = mapping.ticks
        counted = np.column_stack([columns["left"], columns["right"]])
        return self._summed(self._steps(counted, ticks) * ticks.worth), ticks

    def _seconds(self, t: Floats) -> Floats:
        """Return how long each row took."""
        first = t[:1] if self._t is None else [self._t]
        found: Floats = np.diff(t, prepend=first)
        return found

    def _steps(self, counted: Floats, ticks: Ticks) -> Floats:
        """Return by what wheels went on since the row before, (n, 2), in ticks."""
        if not ticks.cumulative or not len(counted):
            return counted
        before = self._counted or (float(counted[0, 0]), float(counted[0, 1]))
        self._counted = float(counted[-1, 0]), float(counted[-1, 1])
        steps = np.diff(counted, axis=0, prepend=[before])
        if ticks.wrap is None:
            return steps
        half = ticks.wrap / 2
        over = int((np.abs(steps) > half).sum())
        self._tally.add("tick counters that began anew, continued", count=over)
        continued: Floats = (steps + half) % ticks.wrap - half
        return continued

    def _summed(self, steps: Floats) -> Floats:
        before = np.zeros(steps.shape[1]) if self._rolled is None else self._rolled
        found: Floats = before + np.cumsum(steps, axis=0)
        if len(found):
            self._rolled = found[-1]
        return found

    def _measured(self, t: Floats, columns: MappingABC[str, Floats]) -> Floats | None:
        """Return the heading that something measured [rad]; None where the table has none."""
        sign = -1.0 if self._mapping.clockwise else 1.0
        yaw: Floats
        if self._heading == "yaw":
            yaw = sign * columns["yaw"] * self._mapping.worth("angle")
        elif self._heading == "compass":
            yaw = math.pi / 2 - columns["compass"] * self._mapping.worth("angle")
        elif self._heading == "a quaternion":
            none = np.zeros(len(t))
            parts = (columns.get(role, none) for role in ("qx", "qy", "qz", "qw"))
            yaw = of_quaternion(*parts)
        elif self._heading == "turn":
            rate = sign * columns["turn"] * self._mapping.worth("turn_rate")
            yaw = (self._yaw or 0.0) + np.cumsum(rate * self._seconds(t))
        else:
            return None
        if self._heading != "turn":
            yaw = unwrapped(yaw, self._yaw)
        if len(yaw):
            self._yaw = float(yaw[-1])
        return yaw

    def _check_bounds(self, place: Floats | None, yaw: Floats | None, lines: Floats) -> None:
        """Refuse a way that ticks, speeds or velocities lead beyond all bounds."""
        inside = np.ones(len(lines), dtype=np.bool_)
        if place is not None:
            inside &= (np.abs(place) <= FARTHEST).all(axis=1)
        if yaw is not None:
            inside &= np.abs(yaw) <= FARTHEST
        if not inside.all():
            line = int(lines[int(np.argmin(inside))])
            raise RecordingError(
                f"{self._name}:{line}",
                "the way computed up to here leads beyond ±1e9 m or rad, expected speeds or "
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
