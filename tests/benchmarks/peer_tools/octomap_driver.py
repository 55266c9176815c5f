"""A process that is timed: scans into an OctoMap, ``python octomap_driver.py LOG MAP.bt REACH``.

Insertions are lazy, and the inner nodes brought up to date once, at the end. A fourth argument,
``eager``, does it after every scan, as pyoctomap does unless told otherwise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyoctomap  # type: ignore[import-untyped]
from carmen import read_scans

RESOLUTION = 0.05
FLOOR = RESOLUTION / 2
"""All beams lie in one sheet of voxels [m]."""


def main() -> None:
    """Insert each scan with OctoMap's own ray casting; beams beyond REACH are free to there."""
    log, target, reach, *eager = sys.argv[1:]
    scans = read_scans(Path(log))
    ends = scans.ends(scans.readings)
    points = np.concatenate((ends, np.full((*ends.shape[:2], 1), FLOOR)), axis=-1)
    origins = np.concatenate((scans.places, np.full((len(points), 1), FLOOR)), axis=-1)
    tree = pyoctomap.OcTree(RESOLUTION)
    for origin, scan in zip(origins, points, strict=True):
        tree.insertPointCloud(scan, origin, float(reach), not eager)
    tree.updateInnerOccupancy()
    tree.writeBinary(target)


if __name__ == "__main__":
    main()
