"""Which of a sensor's readings stand for the beams that a cheap robot has."""

from __future__ import annotations

import math
from collections.abc import Sequence

from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.mapping import Scan

APART = math.radians(5)
"""A reading stands for a beam if it is no further off than this, or than half a scan's step."""


def chosen(angles: Sequence[float], wanted: Sequence[float], step: float = 0.0) -> list[int]:
    """Return which angles stand for the wanted ones: the nearest of each, once, in their order.

    Parameters
    ----------
    angles
        Of the readings against the heading [rad].
    step
        From one reading of a scan to the next [rad].
    """
    found: list[int] = []
    for angle in wanted:
        off = [abs(math.remainder(one - angle, 2 * math.pi)) for one in angles]
        nearest = min(range(len(off)), key=off.__getitem__, default=None)
        if (
            nearest is not None
            and off[nearest] <= max(APART, abs(step)) + 1e-9
            and nearest not in found
        ):
            found.append(nearest)
    return found


def of_scan(scan: Scan, count: int, wanted: Sequence[float]) -> tuple[list[int], list[Mount]]:
    """Return which readings of a scan are used, and how their beams lie."""
    angles = [scan.first + index * scan.step for index in range(count)]
    used = chosen(angles, wanted, scan.step)
    return used, [Mount(angles[index], scan.x, scan.y) for index in used]
