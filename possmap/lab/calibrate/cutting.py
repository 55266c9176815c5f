"""A track whose truth is known, cut into trials: each turn on the spot, each straight run.

A run is what the estimator ``heading`` calls one (METHOD §1): pieces that lie within 1° of the
first. So a trial's ``across`` is drawn as often as the host will draw it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from possmap.core.heading import SAME_RUN_DEG
from possmap.core.track import wrap_degrees
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import directions, fit_model
from possmap.lab.calibrate.trials import (
    LEAST_RUN_M,
    LEAST_TURN_DEG,
    Flags,
    Floats,
    Trial,
    TrialTable,
)

LEG_M = 20.0
"""So much of a long track counts as one outing, to tell what changes slowly."""

WHOLE_DEG = 20.0
"""A smaller turn made of several, or next to another, is no manoeuvre: a robot feels its way."""

CLEAR_DEG = 0.1
"""A smaller angle between the truth's heading and the way driven does not matter."""


@dataclass(frozen=True, eq=False)
class TrueTrack:
    """Poses of one track, as logged and as they truly were; k of them.

    Attributes
    ----------
    robot, name
        Whose, and what it is called.
    logged, true
        x, y [m] and heading [deg], not wrapped; shape (k, 3).
    followed
        Whether the robot ran lined up with a wall from each pose to the next, shape (k - 1,).
    exact
        Whether the truth is exact and the poses are the robot's own, as in a simulated log.
    day
        On which it was driven.
    """

    robot: str
    name: str
    logged: Floats
    true: Floats
    followed: Flags
    exact: bool = False
    day: str = ""

    @property
    def way(self) -> Floats:
        """How far it had run at each pose, as logged [m]; shape (k,)."""
        return np.concatenate([[0.0], np.hypot(*np.diff(self.logged[:, :2], axis=0).T).cumsum()])

    def part(self, start: int, stop: int) -> TrueTrack:
        """Return the poses from ``start`` up to ``stop``."""
        return replace(
            self, logged=self.logged[start:stop], true=self.true[start:stop],
            followed=self.followed[start : max(start, stop - 1)],
        )  # fmt: skip


def cut(outing: TrueTrack, leg: float = LEG_M) -> Iterator[Trial]:
    """Yield the trials of an outing; so much of its way [m] counts as one outing.

    Runs along walls are none, since a wall mends the heading; nor are turns just before one, when
    the robot lines up. In a log, small turns right after or before another one are none either:
    a robot that lines up, or runs against something before it got anywhere, does not write down
    what it did between them.
    """
    place, way = outing.logged[:, :2], outing.way
    stands = np.hypot(*np.diff(place, axis=0).T) == 0
    turn = np.diff(outing.logged[:, 2])
    start, last = 0, len(stands)
    while start < last:
        stop = start + 1
        if stands[start]:
            while stop < last and stands[stop] and turn[stop] * turn[start] >= 0:
                stop += 1
            ahead = np.flatnonzero(~stands[stop:])
            lines_up = len(ahead) > 0 and bool(outing.followed[stop + ahead[0]])
            found = None if lines_up or _feels(outing, stands, start, stop) else _turn
        elif outing.followed[start]:
            found = None
        else:
            first = _direction(outing.logged, start, stop)
            while (
                stop < last
                and not stands[stop]
                and not outing.followed[stop]
                and abs(wrap_degrees(_direction(outing.logged, stop, stop + 1) - first))
                <= SAME_RUN_DEG
            ):
                stop += 1
            found = _run
        trial = None if found is None else found(outing, start, stop)
        if trial is not None:
            yield replace(
                trial, outing=f"{outing.name}:{int(way[start] // leg)}", track=outing.name,
                place=f"{outing.name}, pose {start}", exact=outing.exact, day=outing.day,
            )  # fmt: skip
        start = stop


def _feels(outing: TrueTrack, stands: Flags, start: int, stop: int) -> bool:
    """Whether a turn of a log is a small one among others at the same place."""
    if not outing.exact or abs(outing.logged[stop, 2] - outing.logged[start, 2]) >= WHOLE_DEG:
        return False
    before, after = start > 0 and stands[start - 1], stop < len(stands) and stands[stop]
    return stop - start > 1 or bool(before or after)


def _direction(poses: Floats, start: int, stop: int) -> float:
    dx, dy = poses[stop, :2] - poses[start, :2]
    return math.degrees(math.atan2(dy, dx))


def _turn(outing: TrueTrack, start: int, stop: int) -> Trial | None:
    logged = outing.logged[stop, 2] - outing.logged[start, 2]
    if abs(logged) < LEAST_TURN_DEG:
        return None
    true = outing.true[stop, 2] - outing.true[start, 2]
    dx, dy = (outing.true[stop, :2] - outing.true[start, :2]).tolist()
    error = wrap_degrees(float(true - logged))
    return Trial(outing.robot, "", 0.0, float(logged), dx, dy, error, manoeuvre="turn")


def _run(outing: TrueTrack, start: int, stop: int) -> Trial | None:
    distance = math.hypot(*(outing.logged[stop, :2] - outing.logged[start, :2]))
    if distance < LEAST_RUN_M:
        return None
    bend = float(outing.logged[stop, 2] - outing.logged[start, 2])
    # The way asked for, seen from the true heading at the start.
    asked = _direction(outing.logged, start, stop) - outing.logged[start, 2] + outing.true[start, 2]
    dx, dy = outing.true[stop, :2] - outing.true[start, :2]
    cos, sin = math.cos(math.radians(asked)), math.sin(math.radians(asked))
    error = outing.true[stop, 2] - outing.true[start, 2] - bend
    return Trial(
        outing.robot, "", distance, 0.0, float(cos * dx + sin * dy - distance),
        float(cos * dy - sin * dx), wrap_degrees(float(error)), bend, manoeuvre="run",
    )  # fmt: skip


def without_mount(trials: list[Trial]) -> tuple[list[Trial], float]:
    """Return trials without the angle between the truth's heading and the way driven, and it.

    Whoever sees the robot from outside may not know exactly which way is ahead. Such an angle
    moves the ends of all runs alike, and no error of heading; 0 where none shows [deg].
    """
    table = TrialTable.of(trials)
    fit = fit_model(trials)
    if fit.heading.runs < LEAST or not fit.heading.told:
        return trials, 0.0
    off, _ = directions(table, fit.heading)
    mount = float(np.median(off))
    spread = 1.4826 * float(np.median(np.abs(off - mount)))
    if abs(mount) < max(CLEAR_DEG, 3 * 1.2533 * spread / math.sqrt(len(off))):
        return trials, 0.0
    return turned(trials, mount), mount


def turned(trials: list[Trial], mount: float) -> list[Trial]:
    """Return trials whose ends are seen with a known angle taken out [deg]."""
    cos, sin = math.cos(math.radians(mount)), math.sin(math.radians(mount))
    found = []
    for one in trials:
        if one.is_run:
            x, y = one.distance + one.along, one.across
            one = replace(one, along=cos * x + sin * y - one.distance, across=cos * y - sin * x)
        found.append(one)
    return found
