"""Range scans in CARMEN's text format: one line a scan, pose and readings (``FLASER``).

MRPT sees beam k of n at ``theta + (k - n/2) * step``, theta being the laser's; whoever reads these
logs here does the same. numpy is all it needs, for it is part of processes that are timed.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Scans(NamedTuple):
    """Scans of one range finder; s of them, n beams each.

    places : (s, 2), x and y of robot and laser [m].
    headings : (s,), of the robot [rad].
    angles : (s, n), of the beams [rad, anticlockwise from +x].
    readings : (s, n) [m]; a beam that hits nothing reads more than its reach.
    """

    places: Floats
    headings: Floats
    angles: Floats
    readings: Floats

    def ends(self, readings: Floats) -> Floats:
        """Return x and y where beams of these lengths end [m]; shape (s, n, 2)."""
        way = np.stack((np.cos(self.angles), np.sin(self.angles)), axis=-1)
        return np.asarray(self.places[:, None, :] + readings[..., None] * way)


def write_scans(path: Path, scans: Scans, step: float, most: float) -> None:
    """Write scans whose beams lie ``step`` radians apart and read less than ``most`` metres."""
    beams = scans.readings.shape[1]
    lines = [
        f"PARAM robot_front_laser_max {most}",
        f"PARAM laser_front_laser_resolution {np.degrees(step):.6f}",
    ]
    theta = scans.angles[:, 0] + beams / 2 * step
    for k, (x, y) in enumerate(scans.places):
        readings = " ".join(f"{reading:.3f}" for reading in scans.readings[k])
        place = f"{x:.4f} {y:.4f}"
        poses = f"{place} {theta[k]:.6f} {place} {scans.headings[k]:.6f}"
        lines.append(f"FLASER {beams} {readings} {poses} {k / 10:.1f} km {k / 10:.1f}")
    path.write_text("\n".join([*lines, ""]))


def read_scans(path: Path) -> Scans:
    """Return the scans of a file that :func:`write_scans` wrote."""
    with path.open() as file:
        file.readline()
        step = np.radians(float(file.readline().split()[2]))
        beams = int(file.readline().split()[1])
    table = np.loadtxt(path, skiprows=2, usecols=range(2, beams + 8), ndmin=2)
    readings, poses = table[:, :beams], table[:, beams:]
    angles = poses[:, 2, None] + (np.arange(beams) - beams / 2) * step
    return Scans(poses[:, :2], poses[:, 5], angles, readings)
