"""What a log-odds grid is told: walls seen and floor driven over, record by record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.evidence import Findings, Geometry, Segment
from possmap.core.lattice import HAIR, Lattice, Window
from possmap.core.pyramid import count_of, relevant, stamps
from possmap.core.records import Beam, PartialMap, Pose, Wall
from possmap.lab.evaluate.raster import Flags, Floats, Ints, grown, within


@dataclass(frozen=True, slots=True)
class Outing:
    """An excursion of the ledger, with what its records yield."""

    version: PartialMap
    found: Findings


@dataclass(frozen=True, slots=True)
class Stroke:
    """What one record says, or the beams between two poses together: corrected, with rectangles.

    hits : walls, and ends of beams.
    driven : the run that ends here, over which the body swept.
    seen_through : beams, each with whether it hit; then its last cell is not seen through.
    """

    hits: tuple[Segment, ...] = ()
    driven: Segment | None = None
    seen_through: tuple[tuple[Segment, bool], ...] = ()


def strokes(outing: Outing) -> Iterator[Stroke]:
    """Yield an excursion's strokes in the order of its records; what waits says nothing."""
    last: Geometry | None = None
    beams: list[tuple[Segment, bool]] = []
    for index, record in enumerate(outing.version.records):
        at = outing.found.geometry.get(index)
        if at is None:
            continue
        line = Segment(index, at.x, at.y, at.x2, at.y2, at.rect, at.rect2)
        if isinstance(record, Wall):
            yield Stroke(hits=(line,))
        elif isinstance(record, Beam):
            beams.append((line, record.hit))
        elif isinstance(record, Pose):
            if beams:
                yield _of_beams(beams)
                beams = []
            if last is not None and (last.x, last.y) != (at.x, at.y):
                yield Stroke(driven=Segment(index, last.x, last.y, at.x, at.y, last.rect, at.rect))
            last = at


def _of_beams(beams: Sequence[tuple[Segment, bool]]) -> Stroke:
    hits = tuple(
        Segment(line.record, line.x1, line.y1, line.x1, line.y1, line.rect1, line.rect1)
        for line, hit in beams
        if hit
    )
    return Stroke(hits=hits, seen_through=tuple(beams))


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells of the lattice, each once, with the half-widths there [m]; arrays of one length."""

    rows: Ints
    columns: Ints
    half_x: Floats
    half_y: Floats

    def __len__(self) -> int:
        return len(self.rows)

    def flat(self, window: Window) -> Ints:
        """Return the places in the flattened array of a window that holds them all."""
        found: Ints = (self.rows - window.row0) * window.shape[1] + self.columns - window.column0
        return found

    def chosen(self, which: Flags) -> Cells:
        """Return some of the cells."""
        return Cells(self.rows[which], self.columns[which], self.half_x[which], self.half_y[which])


def line_cells(
    line: Segment, window: Window, resolution: float, largest: float = math.inf
) -> Cells:
    """Return the cells of a segment in a window, by METHOD's rule.

    largest : half-width from which a place is left out [m].
    """
    span = relevant(line, resolution, largest)
    n = count_of(line, resolution)
    ends = np.array([[line.x0, line.y0, line.x1, line.y1]])
    first, last = within(ends, np.array([n]), window, resolution)
    low, high = span or (0, -1)
    some = stamps(line, max(low, int(first[0])), min(high, int(last[0])), resolution)
    kept = np.ones(len(some.rows), dtype=np.bool_)
    kept[1:] = (np.diff(some.rows) != 0) | (np.diff(some.columns) != 0)
    kept &= (some.rows >= window.row0) & (some.rows < window.row1)
    kept &= (some.columns >= window.column0) & (some.columns < window.column1)
    return Cells(some.rows, some.columns, some.half_x, some.half_y).chosen(kept)


def way_cells(
    beam: Segment, hit: bool, window: Window, resolution: float, largest: float = math.inf
) -> Cells:
    """Return the cells of a window through which a beam was seen to pass."""
    cells = line_cells(beam, window, resolution, largest)
    if not hit:
        return cells
    end_row, end_column = Lattice(resolution).cell_of(beam.x1, beam.y1)
    return cells.chosen((cells.rows != end_row) | (cells.columns != end_column))


def floor_cells(
    run: Segment, width: float, window: Window, resolution: float, largest: float = math.inf
) -> Cells:
    """Return the cells of a window over which a body of a width goes on a run.

    Those whose centre lies within half of the width of the path, and those of the path itself.

    largest : half-width from which a place is left out [m].
    """
    # A cell's centre and that of its nearest stamp's cell are each a little off the path.
    reach = math.ceil(width / 2 / resolution + 1.5)
    path = line_cells(run, grown(window, reach), resolution)
    span = np.arange(-reach, reach + 1)
    rows = (path.rows[:, None, None] + span[:, None]) + 0 * span
    columns = (path.columns[:, None, None] + span) + 0 * span[:, None]
    inside = (rows >= window.row0) & (rows < window.row1)
    inside &= (columns >= window.column0) & (columns < window.column1)
    flat = np.unique(
        (rows[inside] - window.row0) * window.shape[1] + columns[inside] - window.column0
    )
    row, column = np.divmod(flat, max(1, window.shape[1]))
    row, column = row + window.row0, column + window.column0
    dx, dy = run.x1 - run.x0, run.y1 - run.y0
    length = math.hypot(dx, dy) or 1.0
    ahead_x, ahead_y = dx / length, dy / length
    x, y = (column + 0.5) * resolution - run.x0, (row + 0.5) * resolution - run.y0
    share = np.clip(x * ahead_x + y * ahead_y, 0, length) / length
    half_x = run.rect0.half_x + share * (run.rect1.half_x - run.rect0.half_x)
    half_y = run.rect0.half_y + share * (run.rect1.half_y - run.rect0.half_y)
    under = np.hypot(x - share * dx, y - share * dy) <= width / 2 + HAIR * resolution
    on_path = line_cells(run, window, resolution)
    under |= np.isin(flat, on_path.flat(window))
    under &= (half_x < largest) & (half_y < largest)
    return Cells(row, column, half_x, half_y).chosen(under)
