"""Steps that no robot can make: bad rows left out, frames that change bridged or parted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from possmap.lab.convert.samples import Flags, Floats, Ints
from possmap.lab.convert.tally import Tally

Jump: TypeAlias = Literal["bridge", "drop", "split"]
"""What becomes of such a step: none, rows left out until one fits, a new excursion."""

BAD_ROWS = "rows far off the way, which goes on as before, dropped"
_WORDS: dict[Jump, str] = {
    "bridge": "steps that no robot can make, bridged",
    "drop": "rows behind steps that no robot can make, dropped until one fits",
    "split": "steps that no robot can make, excursions begun there",
}
JUMPS = frozenset(_WORDS.values())

LOOK_AHEAD = 3
"""After at most so many bad rows the way goes on."""

LEAST_STEP_M = 0.25
"""A shorter step is no jump, whatever the clock says [m]."""

LEAST_SPEED, MOVES = 2.0, 0.05
"""No robot is refused this speed; a slower one stands still [m/s]."""

TIMES = 10.0
"""So many times as fast as in the middle of its way no robot goes."""

LEAST_ROWS = 10
"""Of fewer rows nobody can say what is usual."""

_LEARNT = 4096
_Row: TypeAlias = tuple[float, Floats, float]
"""Time [s], place [m] and heading [rad] of one row."""

_SAME_M, _SAME_RAD = 0.01, math.radians(1)


@dataclass(slots=True)
class _Motion:
    """A rigid motion of the recording's frame: turned, then shifted."""

    turn: float
    shift: Floats

    def of(self, place: Floats) -> Floats:
        if not self.turn:
            return place + self.shift
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        x, y = place.T
        moved: Floats = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + self.shift
        return moved


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A way without such steps.

    keep : which rows are left, (n,). place : (k, 2) or what was given [m]. yaw : (k,) [rad].
    piece : which excursion each row is of, from 0, (k,).
    """

    keep: Flags
    place: Floats
    yaw: Floats | None
    piece: Floats


class Leaps:
    """Follows the places of one table, block by block.

    Parameters
    ----------
    name
        Of the table, for messages.
    how
        What becomes of a step that no robot can make.
    max_speed
        What is faster is one [m/s]; None: what is ten times as fast as the robot usually is, by its
        first rows, and faster than ``LEAST_SPEED``.
    """

    def __init__(self, name: str, how: Jump, max_speed: float | None, tally: Tally) -> None:
        self._name = name
        self._how = how
        self._max_speed = max_speed
        self._fastest = max_speed or math.inf
        self._least = LEAST_STEP_M if max_speed is None else 0.0
        self._tally = tally
        self._period = 0.0
        self._known_t, self._known = np.zeros(0), np.zeros(0)
        self._first: tuple[Floats, float] | None = None
        self._last: _Row | None = None
        self._motion: _Motion | None = None
        self._bad: _Row | None = None
        self._piece = 0

    def settle(
        self, t: Floats, place: Floats, yaw: Floats | None, lines: Floats, rolled: bool = False
    ) -> Settled:
        """Return what is left of the next rows, without jumps.

        Parameters
        ----------
        t, place, yaw
            (n,) [s]; (n, k) [m], coordinates or what wheels have rolled; (n,) [rad], which turns
            with the frame of x and y.
        lines
            Where each row stands, for messages, (n,).
        rolled
            Whether places are what wheels have rolled, which have no frame of their own.
        """
        n = len(t)
        if not n:
            return Settled(np.ones(0, dtype=np.bool_), place, yaw, np.zeros(0))
        heading = np.zeros(n) if yaw is None else yaw
        if self._last is None or self._motion is None or self._first is None:
            self._last = float(t[0]), place[0], float(heading[0])
            self._motion = _Motion(0.0, np.zeros(place.shape[1]))
            self._first = place[0], float(heading[0])
        self._learn(t, place)
        keep = np.ones(n, dtype=np.bool_)
        turns = yaw is not None and not rolled
        starts: list[tuple[int, _Motion, int]] = [(0, self._motion, self._piece)]
        then = 0
        if self._bad is not None:  # rows are being dropped
            found = self._goes_on(0, n, self._last, t, place)
            then = n if found is None else found
            keep[:then] = False
            self._tally.add(_WORDS["drop"], count=then)
            self._bad = (float(t[-1]), place[-1], 0.0) if found is None else None
        for index in self._suspects(t, place):
            if index < then:
                continue
            before = self._before(index, t, place, heading, keep)
            if self._can(before, t[index], place[index]):
                continue
            most = n if self._how == "drop" else LOOK_AHEAD
            found = self._goes_on(index + 1, most, before, t, place)
            if found is not None or self._how == "drop":
                then = n if found is None else found
                keep[index:then] = False
                what = BAD_ROWS if then - index <= LOOK_AHEAD else _WORDS["drop"]
                self._tally.add(what, self._place(lines, t, index), then - index)
                self._bad = (float(t[-1]), place[-1], 0.0) if found is None else None
                continue
            self._tally.add(_WORDS[self._how], self._place(lines, t, index))
            motion = _Motion(0.0, np.zeros(place.shape[1]))
            if self._how == "bridge" or rolled:
                motion = self._bridged(before, place[index], float(heading[index]), turns)
            if self._how == "split":
                self._piece += 1
            self._motion = motion
            starts.append((index, motion, self._piece))
        self._last = self._before(n, t, place, heading, keep)
        return self._laid(starts, keep, place, yaw)

    def _place(self, lines: Floats, t: Floats, index: int) -> str:
        return f"{self._name}:{int(lines[index])}, t = {t[index]:.2f} s"

    def _learn(self, t: Floats, place: Floats) -> None:
        """Take from the first rows how far apart they are, and how fast the robot goes."""
        if len(self._known_t) >= _LEARNT:
            return
        t = self._known_t = np.concatenate([self._known_t, t])
        place = self._known = np.concatenate([self._known.reshape(-1, place.shape[1]), place])
        seconds = np.diff(t)
        passed = seconds[seconds > 0]
        self._period = float(np.median(passed)) if len(passed) else 0.0
        if self._max_speed is None and len(t) >= LEAST_ROWS:
            # Where two frames are mixed, the row after the next is of the same frame again.
            speed = np.min([self._speeds(t, place, lag) for lag in range(1, LOOK_AHEAD)], axis=0)
            moving = speed[speed > MOVES]
            usual = float(np.median(moving)) if len(moving) else 0.0
            self._fastest = max(TIMES * usual, LEAST_SPEED)

    def _speeds(self, t: Floats, place: Floats, lag: int) -> Floats:
        """Return how fast the robot went from each row to one behind it [m/s]."""
        step = place[lag:] - place[:-lag]
        seconds = np.maximum(t[lag:] - t[:-lag], lag * self._period or 1.0)
        found: Floats = np.sqrt((step * step).sum(axis=1)) / seconds
        return found[: len(t) - LOOK_AHEAD + 1]

    def _suspects(self, t: Floats, place: Floats) -> list[int]:
        assert self._last is not None
        step = np.diff(place, axis=0, prepend=self._last[1][None])
        far = np.sqrt((step * step).sum(axis=1))
        found: Ints = np.flatnonzero(far > self._limit(np.diff(t, prepend=self._last[0])))
        return [int(index) for index in found]

    def _limit(self, seconds: Floats) -> Floats:
        limit: Floats = np.maximum(self._fastest * np.maximum(seconds, self._period), self._least)
        return limit

    def _before(self, index: int, t: Floats, place: Floats, yaw: Floats, keep: Flags) -> _Row:
        """Return the last row that was kept before one."""
        assert self._last is not None
        kept = np.flatnonzero(keep[:index])
        if not len(kept):
            return self._last
        at = int(kept[-1])
        return float(t[at]), place[at], float(yaw[at])

    def _can(self, before: _Row, t: float, place: Floats) -> bool:
        far = float(np.sqrt(((place - before[1]) ** 2).sum()))
        return far <= float(self._limit(np.array([t - before[0]]))[0])

    def _goes_on(self, start: int, most: int, before: _Row, t: Floats, place: Floats) -> int | None:
        """Return at which of the next rows the way goes on as before; None if at none.

        The robot can have come there from before, and not from the bad row in between.
        """
        for then in range(start, min(start + most, len(t))):
            bad = (float(t[then - 1]), place[then - 1], 0.0) if then else self._bad
            if bad is None or self._can(bad, t[then], place[then]):
                continue
            if self._can(before, t[then], place[then]):
                return then
        return None

    def _bridged(self, before: _Row, place: Floats, yaw: float, turns: bool) -> _Motion:
        """Return the motion that lays a row where the one before it is."""
        assert self._motion is not None
        assert self._first is not None
        turn = self._motion.turn
        if turns:
            anew = bool(
                (np.abs(place - self._first[0]) <= _SAME_M).all()
                and abs(math.remainder(yaw - self._first[1], math.tau)) <= _SAME_RAD
            )
            step = math.remainder(before[2] - yaw, math.tau)
            turn += step if anew or abs(step) > math.pi / 6 else 0.0
        there = self._motion.of(before[1])
        moved = _Motion(turn, np.zeros_like(there)).of(place)
        return _Motion(turn, there - moved)

    def _laid(
        self, starts: list[tuple[int, _Motion, int]], keep: Flags, place: Floats,
        yaw: Floats | None,
    ) -> Settled:  # fmt: skip
        piece = np.zeros(len(place))
        if len(starts) > 1 or starts[0][1].turn or starts[0][1].shift.any() or starts[0][2]:
            place = place.copy()
            yaw = None if yaw is None else yaw.copy()
            ends = [start for start, _, _ in starts[1:]] + [len(place)]
            for (start, motion, number), end in zip(starts, ends, strict=True):
                place[start:end] = motion.of(place[start:end])
                piece[start:end] = number
                if yaw is not None and motion.turn:
                    yaw[start:end] += motion.turn
        if keep.all():
            return Settled(keep, place, yaw, piece)
        return Settled(keep, place[keep], None if yaw is None else yaw[keep], piece[keep])
