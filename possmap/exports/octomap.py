"""The ``.bt`` and ``.ot`` exports: the map as one sheet of OctoMap voxels on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.core.views import EDGE
from possmap.errors import OutputError
from possmap.exports.job import A_PART, Job, library

REACH = 2**15
"""Voxels from the origin to either side: the tree has 16 levels."""
MOST_VOXELS = 2_000_000
"""More are not kept in memory: one takes 200 bytes."""


def write_occupied(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``.bt``: cells occupied or free by the thresholds; all others stay unknown.

    Raises
    ------
    OutputError
        If pyoctomap is not installed, the tree has no room for the window, or no cell is either.
    """
    tree, taken = _tree(job), 0
    for area in job.areas():
        occupied, free = job.occupied(area), job.free(area)
        taken = _counted(job, taken, occupied | free)
        for marked, is_occupied in ((occupied, True), (free, False)):
            tree.updateNodes(_centres(job, area, marked), is_occupied, True)
    if not taken:
        raise OutputError(f"{job.name}: no cell is occupied or free by the thresholds given")
    tree.updateInnerOccupancy()
    _write(job, tree.writeBinary(), streams[0], job.thresholds())


def write_probabilities(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``.ot``: the probability of a wall, as log-odds, of every cell that holds evidence.

    Raises
    ------
    OutputError
        If pyoctomap is not installed, or the tree has no room for the window.
    """
    base_rate, tree, taken = job.choices.base_rate, _tree(job), 0
    tree.setClampingThresMin(EDGE)
    tree.setClampingThresMax(1 - EDGE)
    for area in job.areas():
        some = job.known(area)
        taken = _counted(job, taken, some)
        places = _centres(job, area, some)
        likely = np.clip(job.grid.view("probability", area, base_rate)[some], EDGE, 1 - EDGE)
        odds, which = np.unique(np.log(likely / (1 - likely)), return_inverse=True)
        order = np.argsort(which, kind="stable")
        groups = np.split(order, np.searchsorted(which[order], np.arange(1, odds.size)))
        # The library takes many places at once, but one value.
        for value, group in zip(odds.tolist(), groups, strict=bool(odds.size)):
            tree.updateNodes([places[index] for index in group.tolist()], value, True)
    tree.updateInnerOccupancy()
    said = f"the probability of a wall at base rate {base_rate:g}, as log-odds"
    _write(job, tree.write(), streams[0], said)


def _tree(job: Job) -> Any:
    pyoctomap = library(job, "pyoctomap", "octomap")
    window = job.window
    far = max(-window.row0, window.row1, -window.column0, window.column1)
    if far > REACH:
        raise OutputError(
            f"{job.name}: {far} cells from (0, 0), expected at most {REACH} in an OctoMap; {A_PART}"
        )
    return pyoctomap.OcTree(job.grid.resolution)


def _counted(job: Job, taken: int, marked: NDArray[np.bool_]) -> int:
    taken += int(np.count_nonzero(marked))
    if taken > MOST_VOXELS:
        raise OutputError(f"{job.name}: more than {MOST_VOXELS:,} voxels, expected fewer; {A_PART}")
    return taken


def _centres(job: Job, area: Window, marked: NDArray[np.bool_]) -> list[tuple[float, ...]]:
    """Return x, y, z [m] of voxels: OctoMap's lattice is anchored at (0, 0) as ours is."""
    c = job.grid.resolution
    rows, columns = np.nonzero(marked)
    x, y = (columns + area.column0 + 0.5) * c, (rows + area.row0 + 0.5) * c
    return list(zip(x.tolist(), y.tolist(), [c / 2] * x.size, strict=True))


def _write(job: Job, data: bytes | bool, stream: BinaryIO, said: str) -> None:
    """Write a tree with the facts as comments behind its first line, which must stay the first."""
    if not isinstance(data, bytes):
        raise OutputError(f"{job.name}: pyoctomap could not write the tree")
    first, _, rest = data.partition(b"\n")
    stream.write(first + b"\n" + job.comments(said).encode() + rest)
