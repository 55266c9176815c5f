"""The recorded track laid anew, the known errors of the robot taken out."""

from __future__ import annotations

import math

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.convert.samples import Floats, Samples, unwrapped


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
        first = self._before is None
        last = samples.part(0, 1) if self._before is None else self._before
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
