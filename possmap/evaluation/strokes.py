"""What a log-odds grid is told: walls seen and floor driven over, record by record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.evidence import Findings, Geometry, Segment
from possmap.core.lattice import HAIR, Lattice, Window
from possmap.core.pyramid import relevant, stamps
from possmap.core.records import Beam, PartialMap, Pose, Wall
from possmap.evaluation.raster import Floats, Ints


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
        """Return the places in a window's flattened array, of those inside."""
        inside = (self.rows >= window.row0) & (self.rows < window.row1)
        inside &= (self.columns >= window.column0) & (self.columns < window.column1)
        row, column = self.rows[inside] - window.row0, self.columns[inside] - window.column0
        found: Ints = row * window.shape[1] + column
        return found


def line_cells(line: Segment, resolution: float, largest: float = math.inf) -> Cells:
    """Return the cells of a segment, by METHOD's rule.

    largest : half-width from which a place is left out [m].
    """
    span = relevant(line, resolution, largest)
    some = stamps(line, *(span or (0, -1)), resolution)
    new = np.ones(len(some.rows), dtype=np.bool_)
    new[1:] = (np.diff(some.rows) != 0) | (np.diff(some.columns) != 0)
    return Cells(some.rows[new], some.columns[new], some.half_x[new], some.half_y[new])


def way_cells(beam: Segment, hit: bool, resolution: float, largest: float = math.inf) -> Cells:
    """Return the cells through which a beam was seen to pass."""
    cells = line_cells(beam, resolution, largest)
    if not hit:
        return cells
    end_row, end_column = Lattice(resolution).cell_of(beam.x1, beam.y1)
    kept = (cells.rows != end_row) | (cells.columns != end_column)
    return Cells(cells.rows[kept], cells.columns[kept], cells.half_x[kept], cells.half_y[kept])


def swept_cells(run: Segment, width: float, resolution: float, largest: float = math.inf) -> Cells:
    """Return the cells that a body of a width sweeps along a run.

    Those whose centre lies within half of the width of the path, and those of the path itself.

    largest : half-width from which a place is left out [m].
    """
    path = line_cells(run, resolution, largest)
    dx, dy = run.x1 - run.x0, run.y1 - run.y0
    reach = math.ceil(width / 2 / resolution) + 1
    if not len(path):
        return path
    low_row, low_column = int(path.rows.min()) - reach, int(path.columns.min()) - reach
    rows, columns = np.meshgrid(
        np.arange(low_row, int(path.rows.max()) + reach + 1),
        np.arange(low_column, int(path.columns.max()) + reach + 1),
        indexing="ij",
    )
    x, y = (columns + 0.5) * resolution - run.x0, (rows + 0.5) * resolution - run.y0
    share = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0, 1)
    away = np.hypot(x - share * dx, y - share * dy)
    half_x = run.rect0.half_x + share * (run.rect1.half_x - run.rect0.half_x)
    half_y = run.rect0.half_y + share * (run.rect1.half_y - run.rect0.half_y)
    swept = away <= width / 2 + HAIR * resolution
    swept[path.rows - low_row, path.columns - low_column] = True
    swept &= (half_x < largest) & (half_y < largest)
    return Cells(rows[swept], columns[swept], half_x[swept], half_y[swept])
