"""The ``.bt`` and ``.ot`` exports: the map as one sheet of OctoMap voxels on the floor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import Window
from possmap.core.views import EDGE, probability
from possmap.errors import OutputError
from possmap.exports.bands import occupancy
from possmap.exports.extras import extra
from possmap.exports.job import Job

REACH = 2**15
"""Voxels from the origin to either side: the tree has 16 levels."""

MOST_VOXELS = 20_000_000
"""More are not kept in memory."""
_OCCUPIED_BYTES, _PROBABILITY_BYTES = 80, 200
"""What a voxel takes; where many are alike, their branches are one."""


def write_occupied(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``.bt``: cells occupied or free by the thresholds; all others stay unknown.

    Raises
    ------
    OutputError
        If pyoctomap is not installed, or the tree has no room for the window.
    """
    choices = job.choices
    tree = _tree(job)
    room = _Room(job, _OCCUPIED_BYTES)
    for area in job.grid.tiles.areas(job.window):
        necessity, possibility = job.grid.necessity(area), job.grid.possibility(area)
        found = occupancy(necessity, possibility, choices.occupied, choices.free)
        for percent, occupied in ((100, True), (0, False)):
            places = _centres(job, area, found == percent)
            room.take(len(places))
            tree.updateNodes(places, occupied, True)
    if not room.taken:
        raise OutputError(f"{job.name}: no cell is occupied or free by the thresholds given")
    tree.updateInnerOccupancy()
    _write(job, tree.writeBinary(), streams[0], {"cells are": job.thresholds()})


def write_probabilities(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``.ot``: the probability of a wall, as log-odds, of every cell that says of walls.

    Raises
    ------
    OutputError
        If pyoctomap is not installed, or the tree has no room for the window.
    """
    base_rate = job.choices.base_rate
    tree = _tree(job)
    tree.setClampingThresMin(EDGE)
    tree.setClampingThresMax(1 - EDGE)
    room = _Room(job, _PROBABILITY_BYTES)
    for area in job.grid.tiles.areas(job.window):
        necessity, possibility = job.grid.necessity(area), job.grid.possibility(area)
        known = (necessity > 0) | (possibility < 1)
        likely = probability(necessity[known], possibility[known], base_rate)
        places = _centres(job, area, known)
        room.take(len(places))
        # The library takes many places at once, but one value.
        for value, some in _grouped(np.log(likely / (1 - likely))):
            tree.updateNodes([places[index] for index in some], value, True)
    if not room.taken:
        raise OutputError(f"{job.name}: no cell of the window says anything of walls")
    tree.updateInnerOccupancy()
    said = {"cells are": f"the probability of a wall at base rate {base_rate:g}, as log-odds"}
    _write(job, tree.write(), streams[0], said)


class _Room:
    """Counts the voxels, so that memory does not run out."""

    def __init__(self, job: Job, each: int) -> None:
        self.taken = 0
        self._name = job.name
        self._most, self._expected = MOST_VOXELS, "expected fewer; "
        if job.grid.budget is not None:
            self._most, self._expected = job.grid.budget.fewest(MOST_VOXELS, each)

    def take(self, voxels: int) -> None:
        self.taken += voxels
        if self.taken > self._most:
            raise OutputError(
                f"{self._name}: more than {self._most:,} voxels, {self._expected}"
                "take a part of it: --window X0,Y0,X1,Y1"
            )


def _tree(job: Job) -> Any:
    library = extra("pyoctomap", "octomap", job)
    window = job.window
    far = max(-window.row0, window.row1, -window.column0, window.column1)
    if far > REACH:
        raise OutputError(
            f"{job.name}: {far} cells from (0, 0), expected at most {REACH} in an OctoMap; "
            "take a part of it: --window X0,Y0,X1,Y1"
        )
    return library.OcTree(job.grid.resolution)


def _centres(job: Job, area: Window, marked: NDArray[np.bool_]) -> list[tuple[float, ...]]:
    """Return x, y, z [m] of voxels: OctoMap's lattice is anchored at (0, 0) as ours is."""
    c = job.grid.resolution
    rows, columns = np.nonzero(marked)
    x = ((columns + area.column0 + 0.5) * c).tolist()
    y = ((rows + area.row0 + 0.5) * c).tolist()
    return list(zip(x, y, [c / 2] * len(x), strict=True))


def _grouped(values: NDArray[np.float64]) -> Iterator[tuple[float, list[int]]]:
    """Yield each distinct value with the indices that have it."""
    order = np.argsort(values, kind="stable")
    distinct, first = np.unique(values[order], return_index=True)
    for value, some in zip(distinct.tolist(), np.split(order, first[1:]), strict=True):
        yield value, some.tolist()


def _write(job: Job, data: bytes | bool, stream: BinaryIO, more: dict[str, str]) -> None:
    """Write a tree with the facts as comments behind its first line, which must stay the first."""
    if not isinstance(data, bytes):
        raise OutputError(f"{job.name}: pyoctomap could not write the tree")
    first, _, rest = data.partition(b"\n")
    said = {**job.facts(), **more}
    comments = "".join(f"# {key}: {fact}\n" for key, fact in said.items())
    stream.write(first + b"\n" + comments.encode())
    stream.write(rest)
