"""How much work evidence is, bounded from above before any of it is done (docs/trust.md).

The measure is a cell stamped once; what else takes time is told in the same measure: a stamp's
overhead, a tile that is read, packed and written, a cell held against a body or a clip line.
"""

from __future__ import annotations

from itertools import chain

import numpy as np

from possmap.core.evidence import Findings
from possmap.core.lattice import TILE
from possmap.core.pyramid import Floats
from possmap.core.segment_table import COLUMNS, table_of

MARGIN = 32
"""Rows, and columns, that a stamp counts beyond its own: one of a single cell takes time, too."""

TILE_WORK = 5e6
"""Cells that a tile is worth: about a millisecond."""

BY_BODY = 256
"""Cells that a cell held against a body's path is worth."""

BY_LINE = 8
"""Cells that a cell held against a line which clips a path is worth."""


def works_of(found: Findings, resolution: float) -> dict[int, float]:
    """Return the work of each record that says something, by its index: a bound, no estimate."""
    segments = list(chain.from_iterable(one.segments for one in found.evidence))
    if not segments:
        return {}
    lines = [len(one.clip) for one in found.evidence for _ in one.segments]
    table = table_of(segments, found.model.max_error)
    works = segment_works(table, np.array(lines, dtype=float), resolution)
    records = np.array([one.record for one in segments])
    sums = np.bincount(records, weights=works)
    some = np.flatnonzero(np.bincount(records))
    return dict(zip(some.tolist(), sums[some].tolist(), strict=True))


def segment_works(table: Floats, lines: Floats, resolution: float) -> Floats:
    """Return the work of each row of a ``segment_table``, of which so many lines clip each."""
    x0, y0, x1, y1, half_x0, half_y0, half_x1, half_y1, most, width, is_point, _ = table.T
    assert len(COLUMNS) == table.shape[1]
    # One whose rectangle is too wide from end to end has no stamp with a height.
    is_wide = (np.minimum(half_x0, half_x1) >= most) | (np.minimum(half_y0, half_y1) >= most)
    # Nor have those between ends of which one is too wide: half-widths are linear on the way.
    begins, ends = np.zeros(len(table)), np.ones(len(table))
    for half0, half1 in ((half_x0, half_x1), (half_y0, half_y1)):
        grows = half1 - half0
        with np.errstate(over="ignore"):  # beyond all numbers is beyond the end
            crossing = np.clip((most - half0) / np.where(grows == 0, 1, grows), 0, 1)
        begins = np.maximum(begins, np.where(grows < 0, crossing, 0))
        ends = np.minimum(ends, np.where(grows > 0, crossing, 1))
    share = np.maximum(0, ends - begins)
    steps_x, steps_y = (np.abs(run) / resolution * share + 1 for run in (x1 - x0, y1 - y0))
    stamps = np.where(is_point > 0, 0, np.maximum(steps_x, steps_y)) + 1
    half_x = np.minimum(most, np.maximum(half_x0, half_x1))
    half_y = np.minimum(most, np.maximum(half_y0, half_y1))
    # A body clears as far as swath.reach says: the farther, the faster half-widths grow.
    growth = np.abs(half_x1 - half_x0) + np.abs(half_y1 - half_y0)
    reach = 2 * (half_x + half_y + growth / stamps) + width
    columns = 2 * np.where(width > 0, reach, half_x) / resolution + 3
    rows = 2 * np.where(width > 0, reach, half_y) / resolution + 3
    along_x, along_y = (np.where(is_point > 0, 0, steps) / TILE for steps in (steps_x, steps_y))
    high, wide = rows / TILE, columns / TILE
    tiles = high * wide + along_x * (high + 1) + along_y * (wide + 1)
    boxes = (stamps / TILE + 1) * (TILE + columns) * (TILE + rows)
    stamped = np.where(width > 0, BY_BODY * boxes, stamps * (rows + MARGIN) * (columns + MARGIN))
    works: Floats = np.where(is_wide, 0.0, stamped + TILE_WORK * tiles + BY_LINE * lines * boxes)
    return works
