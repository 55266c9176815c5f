"""A recording's track laid anew: known errors taken out, cut into legs, each where it began."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.convert.samples import Floats, Samples, blinded, joined, unwrapped
from possmap.lab.convert.tally import Tally

Start: TypeAlias = tuple[float, float, float]
"""Where a leg begins: x, y [m] and heading [rad]."""


class KnownPlace(NamedTuple):
    """What is known of where a robot truly was.

    half : half-width [m]. place : x, y of the end [m]; None: each leg ends where the reference has
    it, or ``columns`` of the recording have x and y, in some of its rows.
    """

    half: float
    place: tuple[float, float] | None = None
    columns: tuple[str, str] | None = None


WITHOUT_FIX = "legs that end where the reference knows no pose, without a fix"
WITHOUT_SAMPLE = "rows that say where the robot truly was and are of no excursion, left out"
BEFORE_REFERENCE = "samples before the first reference pose of a leg, left out"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Poses known from elsewhere; n of them, in the order of time.

    t : [s]. x, y : [m]. yaw : without jumps of a full turn [rad].
    gap : between two poses no farther apart in time one may interpolate [s].
    """

    t: Floats
    x: Floats
    y: Floats
    yaw: Floats
    gap: float = 3.0

    def at(self, t: float) -> Start | None:
        """Return the pose at a time; None where none is near."""
        after = int(np.searchsorted(self.t, t))
        if after == len(self.t) or (after == 0 and self.t[0] != t):
            return None
        if self.t[after] != t and self.t[after] - self.t[after - 1] > self.gap:
            return None
        x, y, yaw = (float(np.interp(t, self.t, column)) for column in (self.x, self.y, self.yaw))
        return x, y, yaw


class LegPiece(NamedTuple):
    """A piece of a leg: its number from 0, its samples, and the way driven in the leg [m]."""

    leg: int
    samples: Samples
    way: Floats


def legs(
    track: Iterable[tuple[Samples, Floats]],
    length: float | None,
    start: Start | None,
    reference: Reference | None,
    tally: Tally,
) -> Iterator[LegPiece]:
    """Cut a track into legs, and lay each from where it begins.

    Parameters
    ----------
    track
        Samples and the way so far [m], piece by piece.
    length
        Of a leg [m]; None: the whole track is one, but for where samples begin anew.
    start
        Where the first leg begins; None: where the recording has it.
    reference
        Poses of which each leg begins at its own; samples before are left out.
    """
    leg, began, fresh = -1, 0.0, True
    laid: _Laid | None = None
    held: tuple[Samples, Floats] | None = None
    for samples, way in track:
        if samples.begins:
            held, fresh = None, True
        if held is not None:
            samples, way = joined([held[0], samples]), np.concatenate([held[1], way])
            held = None
        while len(samples):
            if fresh:
                first = _first(samples, reference)
                tally.add(BEFORE_REFERENCE, count=first)
                samples, way = samples.part(first), way[first:]
                if len(samples) < 2:  # a leg has at least two; the next piece may bring one
                    held = (samples, way) if len(samples) else None
                    break
                leg, began, fresh = leg + 1, float(way[0]), False
                if laid is None or reference is not None:
                    laid = _Laid.from_first(samples, start, reference)
            over = len(samples)
            if length is not None:
                over = int(np.searchsorted(way, began + length))
            assert laid is not None
            yield LegPiece(leg, laid.lay(samples.part(0, over + 1)), way[: over + 1] - began)
            if over == len(samples):
                break
            # The sample at the cut ends one leg and begins the next, which has not its readings.
            samples, way, fresh = blinded(samples.part(over)), way[over:], True


def _first(samples: Samples, reference: Reference | None) -> int:
    """Return the first sample at which a leg can begin."""
    if reference is None:
        return 0
    for index, t in enumerate(samples.t.tolist()):
        if reference.at(t) is not None:
            return index
    return len(samples)


@dataclass(frozen=True, slots=True)
class _Laid:
    """A rigid motion: turned about the origin, then shifted. turn [rad], x, y [m]."""

    turn: float
    x: float
    y: float

    @classmethod
    def from_first(
        cls, samples: Samples, start: Start | None, reference: Reference | None
    ) -> _Laid:
        """Return the motion that lays the first sample where the leg begins."""
        x0, y0, yaw0 = float(samples.x[0]), float(samples.y[0]), float(samples.yaw[0])
        if reference is not None:
            start = reference.at(float(samples.t[0]))
        if start is None:
            return cls(0.0, 0.0, 0.0)
        x, y, yaw = start
        turn = yaw - yaw0
        cos, sin = math.cos(turn), math.sin(turn)
        return cls(turn, x - (cos * x0 - sin * y0), y - (sin * x0 + cos * y0))

    def lay(self, samples: Samples) -> Samples:
        """Return the samples moved."""
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return samples.moved(
            self.x + cos * samples.x - sin * samples.y,
            self.y + sin * samples.x + cos * samples.y,
            samples.yaw + self.turn,
        )


class Laying:
    """Lays a stream of samples behind one another, as METHOD §1, Correction, lays runs.

    ``drift``, ``turn_gain`` and ``scale`` are applied to each step: *before* the track is
    simplified, so that curves are laid as the robot drove them.
    """

    def __init__(self, known: ErrorModel) -> None:
        self._drift = math.radians(known.drift)
        self._gain = known.turn_gain
        self._scale = known.scale
        self._before: Samples | None = None
        self._place = (0.0, 0.0)
        self._correction = 0.0
        self._way = 0.0

    def lay(self, samples: Samples) -> tuple[Samples, Floats]:
        """Return the samples where the robot is now believed to have been, and the way so far [m].

        Parameters
        ----------
        samples
            The next of the recording, as recorded; the first stay where they are.
        """
        first = self._before is None or samples.begins
        last = self._before
        if last is None or first:
            last, self._correction = samples.part(0, 1), 0.0
        dx, dy = np.diff(samples.x, prepend=last.x), np.diff(samples.y, prepend=last.y)
        yaw = unwrapped(samples.yaw, None if first else float(last.yaw[0]))
        turn = np.diff(yaw, prepend=yaw[0] if first else last.yaw[0])
        distance = np.hypot(dx, dy)
        bend = self._drift * distance
        # What is known before each step; the turn comes behind the run, as in METHOD.
        after = self._correction + np.cumsum(bend + self._gain * turn)
        angle = after - self._gain * turn - bend / 2
        stretch = self._scale * np.sinc(bend / (2 * math.pi))
        cos, sin = stretch * np.cos(angle), stretch * np.sin(angle)
        x0, y0 = (float(samples.x[0]), float(samples.y[0])) if first else self._place
        x, y = x0 + np.cumsum(dx * cos - dy * sin), y0 + np.cumsum(dx * sin + dy * cos)
        way = self._way + np.cumsum(self._scale * distance)
        self._before = samples.moved(samples.x, samples.y, yaw).part(-1)
        self._place = float(x[-1]), float(y[-1])
        self._correction, self._way = float(after[-1]), float(way[-1])
        return samples.moved(x, y, yaw + after), way
