"""What ``kernel.py`` stamps: the segments of *the km* and single runs, and their cells counted."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from tracks import METRES, the_km

from possmap.core import kernel
from possmap.core.evidence import Layer, Segment, findings
from possmap.core.lattice import TileKey, Window
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import COLUMNS, relevant, segment_of, table_of
from possmap.core.records import PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Values: TypeAlias = NDArray[np.uint16]

MAX_ERROR = COLUMNS.index("max_error")

MARGIN = 16
"""Columns to the right of all stamps: an array is hardly ever as narrow as a stamp."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Segments to stamp, and how many cells that is.

    window : holds every stamp whole.
    pieces : the kernel's rows, one for each segment.
    """

    table: Floats
    resolution: float
    spans: Ints
    pieces: Ints
    window: Window
    swept: int
    touches: int

    @classmethod
    def of(cls, table: Floats, resolution: float) -> Scene:
        """Count the cells of every stamp, one by one."""
        spans = np.array(
            [
                relevant(segment_of(row), resolution, float(row[MAX_ERROR])) or (0, -1)
                for row in table
            ]
        )
        some = spans[:, 0] <= spans[:, 1]
        table, spans = np.ascontiguousarray(table[some]), np.ascontiguousarray(spans[some])
        boxes = [_boxes(row, span, resolution) for row, span in zip(table, spans, strict=True)]
        every = np.concatenate(boxes)
        low, high = every.min(axis=0), every.max(axis=0)
        window = Window(int(low[0]), int(high[1]), int(low[2]), int(high[3]) + MARGIN)
        pieces = np.zeros((len(table), 6), dtype=np.int64)
        pieces[:, 0] = pieces[:, 3] = np.arange(len(table))
        pieces[:, 1:3], pieces[:, 5] = spans, -1
        touches = int(((every[:, 1] - every[:, 0]) * (every[:, 3] - every[:, 2])).sum())
        return cls(table, resolution, spans, pieces, window, sum(map(_union, boxes)), touches)

    def blank(self) -> Values:
        """Return an array of the window's cells."""
        return np.zeros(self.window.shape, dtype=np.uint16)

    def by_tile(self) -> list[tuple[TileKey, Ints]]:
        """Cut pieces at the borders of tiles, as ``possmap fuse`` does."""
        found: dict[TileKey, list[tuple[int, ...]]] = {}
        for segment, row, column, *span in kernel.touch(self.table, self.resolution).tolist():
            found.setdefault(TileKey(row, column), []).append((segment, *span, segment, 0, -1))
        return [(key, np.array(rows, dtype=np.int64)) for key, rows in sorted(found.items())]


def _boxes(row: Floats, span: Ints, c: float) -> Ints:
    """Return bottom, top, left and right of each stamp; top and right are just outside."""
    x0, y0, x1, y1, half_x0, half_y0, half_x1, half_y1 = row[:8]
    n = max(1, np.ceil(max(abs(x1 - x0), abs(y1 - y0)) / c - 1e-6))
    share = np.arange(span[0], span[1] + 1) / n
    sides = []
    for start, end, half0, half1 in ((y0, y1, half_y0, half_y1), (x0, x1, half_x0, half_x1)):
        centre = np.floor((start + share * (end - start)) / c + 1e-6)
        reach = np.ceil((half0 + share * (half1 - half0)) / c + 0.5) - 1
        sides += [centre - reach, centre + reach + 1]
    return np.stack(sides, axis=1).astype(np.int64)


def _union(boxes: Ints) -> int:
    """Return how many cells lie in any of the boxes."""
    low, high = boxes.min(axis=0), boxes.max(axis=0)
    cells = np.zeros((high[1] - low[0], high[3] - low[2]), dtype=bool)
    for bottom, top, left, right in (boxes - low[[0, 0, 2, 2]]).tolist():
        cells[bottom:top, left:right] = True
    return int(cells.sum())


def km_scenes(resolution: float, max_error: float, growth: float) -> tuple[Scene, Scene]:
    """Return the free paths and the walls of *the km*, whose half-widths end at ``growth`` [m]."""
    each = growth / METRES
    model = ErrorModel(along=each, across=each, turn_spread=0, max_error=max_error)
    records: list[Record] = []
    for log in the_km()["records"]:
        seq, x, y = log["seq"], log["x"], log["y"]
        if log["kind"] == "wall":
            records.append(Wall(seq, None, x, y, log["x2"], log["y2"], log["followed"]))
        else:
            records.append(Pose(seq, None, x, y, log["heading"]))
    settings = EvidenceSettings(resolution=resolution, model=model)
    found = findings(PartialMap("km", "1", (), tuple(records)), model, settings)

    def scene(layer: Layer) -> Scene:
        every = [one for some in found.evidence if some.layer is layer for one in some.segments]
        return Scene.of(table_of(every, max_error), resolution)

    return scene(Layer.FREE), scene(Layer.WALLS)


def run_scene(degrees: float, half0: float, half1: float, resolution: float = 0.05) -> Scene:
    """Return a run of 4 m in a direction, its half-widths going from one to the other [m]."""
    x, y = 4 * cos(radians(degrees)), 4 * sin(radians(degrees))
    first, last = ErrorRectangle(half0, half0), ErrorRectangle(half1, half1)
    return Scene.of(table_of([Segment(0, 0.01, 0.02, x, y, first, last)], 1.0), resolution)
