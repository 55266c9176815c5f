"""Steps that the velocity belies, replaced by what it says: some estimators jump."""

from __future__ import annotations

import numpy as np

from possmap.lab.convert.samples import Floats
from possmap.lab.convert.tally import Tally

LONGEST_S = 1.0
"""A velocity says nothing of a step that took longer [s]: the robot was not heard meanwhile."""

REPLACED = "steps that disagree with the velocity, replaced"


class JumpGuard:
    """Replaces steps that the velocity belies by what it says: some estimators jump.

    Parameters
    ----------
    limit
        How far a step may differ from velocity times time [m]; 0: as far as it likes.
    """

    def __init__(self, limit: float, tally: Tally) -> None:
        self._limit = limit
        self._tally = tally
        self._before: tuple[float, Floats, Floats] | None = None
        self._shift = np.zeros(2)

    def mended(self, t: Floats, place: Floats, velocity: Floats) -> Floats:
        """Return the places of a track without its jumps.

        Parameters
        ----------
        t, place, velocity
            The next of the track: (n,) [s], (n, 2) [m], (n, 2) [m/s]; NaN where not measured.
        """
        if not self._limit or not len(t):
            return place
        last_t, last_place, last_velocity = self._before or (float(t[0]), place[0], velocity[0])
        self._before = float(t[-1]), place[-1], velocity[-1]
        steps = np.diff(place, axis=0, prepend=last_place[None])
        mean = np.concatenate([last_velocity[None], velocity])
        told = (mean[1:] + mean[:-1]) / 2 * np.diff(t, prepend=last_t)[:, None]
        with np.errstate(invalid="ignore"):
            jumped = np.hypot(*(steps - told).T) > self._limit
        jumped &= np.diff(t, prepend=last_t) <= LONGEST_S
        self._tally.add(REPLACED, count=int(jumped.sum()))
        shifts = self._shift + np.cumsum(np.where(jumped[:, None], told - steps, 0.0), axis=0)
        self._shift = shifts[-1]
        mended: Floats = place + shifts
        return mended
