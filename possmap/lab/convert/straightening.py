"""The track laid anew with the heading that walls tell."""

from __future__ import annotations

import numpy as np

from possmap.lab.convert.orthogonal import Alignment
from possmap.lab.convert.samples import Floats, Samples


class Straightening:
    """Turns each step of a leg back by the heading's error there."""

    def __init__(self, alignment: Alignment, leg: int) -> None:
        self._alignment = alignment
        self._leg = leg
        self._before: tuple[float, float, float, float, float] | None = None

    def lay(self, samples: Samples, way: Floats) -> Samples:
        """Return the next samples, straightened.

        Parameters
        ----------
        way
            Driven in the leg up to each [m].
        """
        if self._before is None:
            first = float(samples.x[0]), float(samples.y[0])
            self._before = *first, *first, float(way[0])
        x0, y0, laid_x, laid_y, way0 = self._before
        dx, dy = np.diff(samples.x, prepend=x0), np.diff(samples.y, prepend=y0)
        middle = way - np.diff(way, prepend=way0) / 2
        turn = -self._alignment.error(self._leg, middle)
        cos, sin = np.cos(turn), np.sin(turn)
        x, y = laid_x + np.cumsum(dx * cos - dy * sin), laid_y + np.cumsum(dx * sin + dy * cos)
        self._before = (
            float(samples.x[-1]), float(samples.y[-1]), float(x[-1]), float(y[-1]), float(way[-1]),
        )  # fmt: skip
        return samples.moved(x, y, samples.yaw - self._alignment.error(self._leg, way))
