"""Whether a tool's map is one of the km: its extent, the robot's way, the walls beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from peer_tools.carmen import Floats
from peer_tools.sightings import Record, runs_of
from PIL import Image

from possmap.grid.grid import Grid

RESOLUTION = 0.05
CANVAS = 1200
"""Rows and columns from (0, 0) m on: the km's building."""

MARGIN = 2.0
"""How much farther than the track a map may reach to a side: errors, beams, tiles [m]."""

LEAST_WAY, LEAST_WALLS = 0.9, 0.5
"""Shares that must be found; the track goes through walls, which denies some again."""

Flags = NDArray[np.bool_]


class Verdict(NamedTuple):
    """What a map says of the building; both of shape (CANVAS, CANVAS), row 0 at y = 0."""

    occupied: Flags
    free: Flags


def _on_canvas(cells: NDArray[Any], row: int, column: int) -> Floats:
    """Return cells whose first is (row, column) as a canvas of them, 0 elsewhere."""
    rows, columns = np.arange(cells.shape[0]) + row, np.arange(cells.shape[1]) + column
    up, across = ((at >= 0) & (at < CANVAS) for at in (rows, columns))
    canvas = np.zeros((CANVAS, CANVAS))
    canvas[np.ix_(rows[up], columns[across])] = cells[np.ix_(up, across)]
    return canvas


def read_possmap(path: Path) -> Verdict:
    """Read a grid file: occupied where N > 0, free where Π < 1; a cell may be both."""
    with Grid(path) as grid:
        window = grid.window
        assert window is not None, "a grid without evidence"
        place = window.row0, window.column0
        n, denied = grid.necessity(), 1 - grid.possibility()
    return Verdict(_on_canvas(n, *place) > 0, _on_canvas(denied, *place) > 0)


def read_octomap(path: Path) -> Verdict:
    """Read a binary tree whose leaves are one sheet of voxels."""
    import pyoctomap  # type: ignore[import-untyped]

    tree = pyoctomap.OcTree(RESOLUTION)
    assert tree.readBinary(str(path)), "not a tree"
    verdict = Verdict(*np.zeros((2, CANVAS, CANVAS), dtype=bool))
    for leaf in tree.begin_leafs():
        x, y, _ = leaf.getCoordinate()
        flags = verdict.occupied if tree.isNodeOccupied(leaf.current_node) else verdict.free
        flags[int(y / RESOLUTION), int(x / RESOLUTION)] = True
    return verdict


def read_log_odds(path: Path) -> Verdict:
    """Read the array of the numpy grid."""
    with np.load(path) as stored:
        log_odds = _on_canvas(stored["log_odds"], *stored["origin"])
    return Verdict(log_odds > 0, log_odds < 0)


def read_mrpt(path: Path) -> Verdict:
    """Read the picture beside MRPT's map, 127 where nothing is known, and its limits."""
    picture = np.asarray(Image.open(next(path.parent.glob("*.png"))), dtype=np.float64)
    limits = next(path.parent.glob("*_limits.txt")).read_text().splitlines()[-1]
    x, _, y, _ = (round(float(limit) / RESOLUTION) for limit in limits.split())
    paler = _on_canvas(picture[::-1] - 127, y, x)
    return Verdict(paler < 0, paler > 0)


class Score(NamedTuple):
    """How a map fits the km: sides of what it knows [m], shares of way and walls it found."""

    width: float
    height: float
    way: float
    walls: float


def _cells(places: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    column, row = np.floor(places / RESOLUTION).astype(np.int64).T
    return row, column


def judge(verdict: Verdict, log: Record) -> Score:
    """Score a map of the log.

    Raises
    ------
    ValueError
        If this is no map of the log: a comparison with it would mean nothing.
    """
    runs = list(runs_of(log))
    way = np.concatenate([run.places for run in runs])
    walls = np.concatenate([run.wall_places for run in runs if run.beside is not None])
    rows, columns = np.nonzero(verdict.occupied | verdict.free)
    if not rows.size:
        raise ValueError("the map is empty")
    # Walls lie on borders of cells, and every tool rounds in its own way.
    near = np.pad(verdict.occupied, 1)
    near = near[:-2] | near[1:-1] | near[2:]
    near = near[:, :-2] | near[:, 1:-1] | near[:, 2:]
    score = Score(
        float(np.ptp(columns) + 1) * RESOLUTION,
        float(np.ptp(rows) + 1) * RESOLUTION,
        float(verdict.free[_cells(way)].mean()),
        float(near[_cells(walls)].mean()),
    )
    for side, extent in zip(score[:2], np.ptp(way, axis=0), strict=True):
        if not extent <= side <= extent + 2 * MARGIN:
            raise ValueError(f"the map is {side:.1f} m wide or high, the track {extent:.1f} m")
    if score.way < LEAST_WAY or score.walls < LEAST_WALLS:
        raise ValueError(f"only {score.way:.0%} of the way and {score.walls:.0%} of the walls")
    return score
