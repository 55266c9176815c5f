"""Which readings mean something: metres, nothing in sight, or no reading at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from possmap.lab.convert.samples import Floats
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import WORTH, BeamColumn
from possmap.lab.recordings.mapping import Mapping

_LEAST_ROWS = 20
"""Of fewer rows nobody can say whether they are ranges."""


class Ranges:
    """Reads the ranges of one table; a beam that has nothing but 0 and 1 is taken for a switch.

    Parameters
    ----------
    beams
        Those that are read, in their order.
    """

    def __init__(self, beams: Sequence[BeamColumn], mapping: Mapping, tally: Tally) -> None:
        self._beams = beams
        self._nothing, self._invalid = mapping.nothing, mapping.invalid
        self._worth = np.array([WORTH[one.unit or mapping.units.range] for one in beams])
        self._limit = np.array([[min(one.max, mapping.nothing.above) for one in beams]])
        self._touches = np.array([one.contact is not None for one in beams], dtype=np.bool_)
        self._servos = [index for index, one in enumerate(beams) if one.servo]
        self._tally = tally

    def read(self, ranges: Floats, longest: Floats | None) -> Floats:
        """Return readings as samples have them, with the angles of servos behind them.

        Parameters
        ----------
        ranges
            As the file has them; the angles of servos behind them [deg], (n, k).
        longest
            How far each row's sensor sees, as it says itself (n, 1) [m].
        """
        read, none = ranges[:, : len(self._beams)], self._invalid
        self._guess_switches(read)
        limit = self._limit if longest is None else np.minimum(self._limit, longest)
        metres = read * self._worth
        nothing = (metres >= limit) | np.isposinf(metres) | np.isin(read, self._nothing.values)
        missing = np.isnan(metres)  # no reading is no fault: not every row has one of every beam
        invalid = (metres > none.above) | (metres <= none.below) | np.isin(read, none.values)
        invalid &= ~nothing & ~missing & ~self._touches
        self._tally.add("readings that mean nothing, dropped", count=int(invalid.sum()))
        found = np.where(nothing, -np.minimum(limit, none.above), metres)
        found = np.where(invalid, np.nan, found)
        pressed = (read != 0) & ~missing
        found = np.where(self._touches, np.where(pressed, np.inf, np.nan), found)
        return self._with_servos(found, ranges[:, len(self._beams) :])

    def _guess_switches(self, read: Floats) -> None:
        if len(read) < _LEAST_ROWS:
            return
        for index in np.flatnonzero(~self._touches).tolist():
            beam = self._beams[index]
            if set(np.unique(read[:, index])) == {0.0, 1.0}:
                self._touches[index] = bool(beam.x or beam.y)
                taken = f"taken for a switch that touches at {beam.x:g}, {beam.y:g}"
                taken = taken if self._touches[index] else "if it is a switch"
                self._tally.note(
                    f"{beam.column} has nothing but 0 and 1: {taken} (contact: in beams says so)"
                )

    def _with_servos(self, found: Floats, angles: Floats) -> Floats:
        if not self._servos:
            return found
        servos = [self._beams[index] for index in self._servos]
        sign = np.array([-1.0 if one.clockwise else 1.0 for one in servos])
        turned_by = sign * (np.radians(angles) - np.array([one.ahead_deg for one in servos]))
        read = found[:, self._servos]
        known = np.isfinite(turned_by) & ~np.isnan(read)
        found[:, self._servos] = np.where(known, read, np.nan)
        return np.column_stack([found, np.where(known, turned_by, np.nan)])
