"""How much work evidence is, bounded from above before any of it is done (docs/trust.md).

A cell that a segment touches is one cell of work. Touched again and again, by stamp after stamp, it
counts anew: in the sum of a file for each 32 times; within one record, which may say much at once,
for each 256 times. And a tile counts, since it is read, packed and written. So 10¹⁰ cells of a file
take up to a minute, and 10⁸ of a record some seconds (docs/trust.md has what was measured).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from possmap.core import kernel
from possmap.core.evidence import Findings, Segment
from possmap.core.lattice import TILE, TileKey
from possmap.core.model import ErrorModel
from possmap.core.pyramid import FARTHEST, MOST_LOGGED, count_of, relevant
from possmap.core.segment_table import table_of
from possmap.core.settings import EvidenceSettings

AGAIN_IN_FILE = 32
AGAIN_IN_RECORD = 256

MARGIN = 32
"""Rows, and columns, that a stamp counts beyond its own: one of a single cell takes time, too."""

TILE_WORK = 4 * TILE * TILE
"""Cells of work of a tile of a file, beside those touched in it: about a millisecond."""

_TILE_IN_RECORD = TILE * TILE // 16
"""The same, of a tile of a record, of which up to four times too many are counted."""

_FREE_TOUCHES, _FREE_TILES = 2**30, 2**10
"""What a record may take of both without counting: a second's work at most."""

_BY_LINE = 8
"""Touches that a line which clips a path is worth, in every cell looked at."""

_BY_BODY = 256
"""Touches that a swath is worth in every cell looked at."""

_LISTED_AT_ONCE = 4096
"""Segments whose tiles are looked up together: bounds memory."""


class Work(NamedTuple):
    """What it takes to stamp something, at most.

    cells : touched. touches : how often, in all. tiles : touched.
    """

    cells: float
    touches: float
    tiles: float

    @property
    def of_record(self) -> float:
        """Cells of work, as the limit of one record counts them: those touched, if it is small."""
        again = max(0.0, self.touches - _FREE_TOUCHES) / AGAIN_IN_RECORD
        return self.cells + again + _TILE_IN_RECORD * max(0.0, self.tiles - _FREE_TILES)

    @property
    def of_file(self) -> float:
        """Cells of work, as the limit of a file counts them, but for tiles, which many share."""
        return self.cells + self.touches / AGAIN_IN_FILE

    def plus(self, other: Work) -> Work:
        """Return what both take."""
        return Work(
            self.cells + other.cells, self.touches + other.touches, self.tiles + other.tiles
        )


NONE = Work(0, 0, 0)


class MostWork(NamedTuple):
    """What an excursion cannot exceed.

    of_record : cells of work of any of its records. of_excursion : of all, but for tiles.
    tiles : how many it touches.
    """

    of_record: float
    of_excursion: float
    tiles: float


def might_be_lost(span: float, count: int, model: ErrorModel, resolution: float) -> bool:
    """Return whether one of an excursion's records might lie farther than FARTHEST.

    Arguments are those of ``most_work``.
    """
    longest = span * max(1.0, model.scale)
    return (MOST_LOGGED + count * longest) / resolution >= FARTHEST


def most_work(span: float, count: int, model: ErrorModel, settings: EvidenceSettings) -> MostWork:
    """Return what an excursion cannot exceed, without laying it out.

    Infinity, if one of its ``count`` records might be lost, or if it takes a closer look. Nothing
    logged is longer than ``span`` [m], the diagonal of the box of all its places; the correction
    stretches it by ``scale`` at most. A record says one line, of a wall or a path, and perhaps one
    point, the hit of a beam, with the widest pyramid at most.
    """
    resolution = settings.resolution
    longest = span * max(1.0, model.scale)
    clipped = settings.free_along_walls and settings.clip_coobserved
    lost = might_be_lost(span, count, model, resolution)
    if lost or clipped or settings.path_width:
        return MostWork(math.inf, math.inf, math.inf)
    steps, wide = longest / resolution + 3, 2 * model.max_error / resolution + 3
    line, point = _stamped(steps, steps, steps, wide, wide), _stamped(0, 0, 0, wide, wide)
    work = line.plus(point)
    return MostWork(work.of_record, count * work.of_file, count * work.tiles)


def segment_work(segment: Segment, lines: int, resolution: float, max_error: float) -> Work:
    """Return an upper bound of the work of a segment, without looking at any of its cells.

    lines : how many clip it.
    """
    span = relevant(segment, resolution, max_error)
    if span is None:
        return NONE
    steps = span[1] - span[0]
    longest = max(abs(segment.x1 - segment.x0), abs(segment.y1 - segment.y0)) or 1.0
    across_x = math.ceil(steps * abs(segment.x1 - segment.x0) / longest)
    across_y = math.ceil(steps * abs(segment.y1 - segment.y0) / longest)
    one, other = segment.rect0, segment.rect1
    widest_x = min(max_error, max(one.half_x, other.half_x))
    widest_y = min(max_error, max(one.half_y, other.half_y))
    columns = 2 * math.ceil(widest_x / resolution + 0.5) - 1
    rows = 2 * math.ceil(widest_y / resolution + 0.5) - 1
    work = _stamped(steps, across_x, across_y, rows, columns)
    if segment.swath is not None:
        # As swath.reach has it: the farther, the faster half-widths grow from stamp to stamp.
        growth = abs(other.half_x - one.half_x) + abs(other.half_y - one.half_y)
        reach = 2 * (widest_x + widest_y + growth / count_of(segment, resolution))
        rows = columns = 2 * math.ceil((reach + segment.swath.width) / resolution + 2) + 1
        tiles = _stamped(steps, across_x, across_y, rows, columns).tiles
        seen = _looked_at(across_x, across_y, rows, columns)
        work = Work(work.cells, _BY_BODY * seen, tiles)
    if lines:
        seen = _looked_at(across_x, across_y, rows, columns)
        work = work.plus(Work(0, _BY_LINE * lines * seen, 0))
    return work


def _stamped(steps: float, across_x: float, across_y: float, rows: float, columns: float) -> Work:
    """Return the work of stamps of so many rows and columns each, from the first to the last."""
    high, wide = rows / TILE + 2, columns / TILE + 2
    return Work(
        min(rows * columns + across_x * rows + across_y * columns, (steps + 1) * rows * columns),
        (steps + 1) * (rows + MARGIN) * (columns + MARGIN),
        high * wide + across_x / TILE * high + across_y / TILE * wide,
    )


def _looked_at(across_x: int, across_y: int, rows: int, columns: int) -> int:
    """Return about how many cells lie in the boxes, tile by tile, around a segment's stamps."""
    parts = max(across_x, across_y) // TILE + 1
    return parts * (min(across_x, TILE) + columns) * (min(across_y, TILE) + rows)


def works_of(found: Findings, settings: EvidenceSettings) -> dict[int, Work]:
    """Return the work of each record that says something, by its index."""
    works: dict[int, Work] = {}
    resolution, max_error = settings.resolution, found.model.max_error
    for one in found.evidence:
        lines = len(one.clip)
        for segment in one.segments:
            work = segment_work(segment, lines, resolution, max_error)
            works[segment.record] = works.get(segment.record, NONE).plus(work)
    return works


def tiles_of(found: Findings, settings: EvidenceSettings) -> set[TileKey]:
    """Return the tiles that an excursion may touch: look at its work first."""
    keys: set[TileKey] = set()
    segments = [segment for one in found.evidence for segment in one.segments]
    for first in range(0, len(segments), _LISTED_AT_ONCE):
        table = table_of(segments[first : first + _LISTED_AT_ONCE], found.model.max_error)
        touched = kernel.touch(table, settings.resolution)[:, 1:3]
        keys.update(TileKey(*key) for key in np.unique(touched, axis=0).tolist())
    return keys
