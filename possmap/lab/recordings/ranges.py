"""Which readings mean something: metres, nothing in sight, or no reading at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from possmap.lab.convert.samples import Floats
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import WORTH, Beam
from possmap.lab.recordings.mapping import Mapping

_NO_MEANING = "readings that mean nothing, dropped"


def readable(
    ranges: Floats,
    beams: Sequence[Beam],
    mapping: Mapping,
    longest: Floats | None,
    tally: Tally,
) -> Floats:
    """Return readings as samples have them, with the angles of servos behind them.

    Parameters
    ----------
    ranges
        As the file has them; the angles of servos behind them [deg], (n, k).
    longest
        How far each row's sensor sees, as it says itself (n, 1) [m].
    """
    count = len(beams)
    read, no_echo, none = ranges[:, :count], mapping.nothing, mapping.invalid
    worth = np.array([WORTH[one.unit or mapping.units.range] for one in beams])
    limit = np.array([min(one.max, no_echo.above) for one in beams])[None, :]
    if longest is not None:
        limit = np.minimum(limit, longest)
    metres = read * worth
    nothing = (metres >= limit) | np.isposinf(metres) | np.isin(read, no_echo.values)
    missing = np.isnan(metres)  # no reading is no fault: not every row has one of every beam
    invalid = (metres > none.above) | (metres <= none.below) | np.isin(read, none.values)
    touches = np.array([one.contact is not None for one in beams])
    invalid &= ~nothing & ~missing & ~touches
    tally.add(_NO_MEANING, count=int(invalid.sum()))
    for index, beam in enumerate(beams):  # of one that measures ranges, it would be a strange one
        if beam.contact is None and len(read) > 1 and set(np.unique(read[:, index])) == {0.0, 1.0}:
            tally.note(
                f"{beam.column} has nothing but 0 and 1: if something touches there, not ranges, "
                "say so with contact: in beams"
            )
    found = np.where(nothing, -np.minimum(limit, none.above), np.where(invalid, np.nan, metres))
    if touches.any():
        found[:, touches] = np.where(read[:, touches] != 0, read[:, touches], np.nan)
    servos = [index for index, one in enumerate(beams) if one.servo]
    if not servos:
        return found
    sign = np.array([-1.0 if beams[index].clockwise else 1.0 for index in servos])
    ahead = np.array([beams[index].ahead_deg for index in servos])
    turned_by = sign * (np.radians(ranges[:, count:]) - ahead)
    found[:, servos] = np.where(np.isfinite(turned_by), found[:, servos], np.nan)
    turned_by = np.where(np.isnan(found[:, servos]), np.nan, turned_by)
    return np.column_stack([found, turned_by])
