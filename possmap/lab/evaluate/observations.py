"""What a log-odds grid is told: walls seen and floor driven over, record by record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.estimators import estimate
from possmap.core.evidence import Findings, Segment, findings
from possmap.core.lattice import HAIR, Lattice, Window
from possmap.core.model import ErrorModel
from possmap.core.placing import placed
from possmap.core.pyramid import count_of, relevant, stamps
from possmap.core.records import Beam, PartialMap, Pose, Wall
from possmap.core.refined import RefinedTrack
from possmap.core.settings import EvidenceSettings
from possmap.lab.evaluate.raster import Flags, Floats, Ints, grown, within


@dataclass(frozen=True, slots=True)
class JudgedExcursion:
    """An excursion of the ledger, with what its records yield.

    runs : what was driven, by the index of the pose that ends it. Under the estimator ``walls`` a
        stretch may start elsewhere than the one before it ended.
    """

    version: PartialMap
    found: Findings
    runs: Mapping[int, Segment]

    @classmethod
    def of(
        cls,
        version: PartialMap,
        model: ErrorModel,
        settings: EvidenceSettings,
        refined: RefinedTrack | None = None,
    ) -> JudgedExcursion:
        """Lay out an excursion as the grid does: by its estimator, or as it was refined."""
        found = findings(version, model, settings, refined)
        if not found.geometry:
            return cls(version, found, {})
        laid = estimate(placed(version, model).records, model, settings, refined)
        runs = {
            one.logged.end_index: Segment(
                one.logged.end_index, *one.start, *one.end, errors.start, errors.end
            )
            for one, errors in zip(laid.stretches, laid.errors, strict=True)
            if one.start != one.end
        }
        return cls(version, found, runs)


@dataclass(frozen=True, slots=True)
class Observation:
    """What one record says, or the beams between two poses together: corrected, with rectangles.

    hits : walls, and ends of beams.
    driven : the run that ends here, over which the body swept.
    seen_through : beams, each with whether it hit; then its last cell is not seen through.
    """

    hits: tuple[Segment, ...] = ()
    driven: Segment | None = None
    seen_through: tuple[tuple[Segment, bool], ...] = ()


def observations(excursion: JudgedExcursion) -> Iterator[Observation]:
    """Yield an excursion's observations in the order of its records; what waits says nothing."""
    beams: list[tuple[Segment, bool]] = []
    for index, record in enumerate(excursion.version.records):
        at = excursion.found.geometry.get(index)
        if at is None:
            continue
        line = Segment(index, at.x, at.y, at.x2, at.y2, at.rect, at.rect2)
        if isinstance(record, Wall):
            yield Observation(hits=(line,))
        elif isinstance(record, Beam):
            beams.append((line, record.hit))
        elif isinstance(record, Pose):
            if beams:
                yield _scan(beams)
                beams = []
            if index in excursion.runs:
                yield Observation(driven=excursion.runs[index])


def _scan(beams: Sequence[tuple[Segment, bool]]) -> Observation:
    hits = tuple(
        Segment(line.record, line.x1, line.y1, line.x1, line.y1, line.rect1, line.rect1)
        for line, hit in beams
        if hit
    )
    return Observation(hits=hits, seen_through=tuple(beams))


@dataclass(frozen=True, slots=True, eq=False)
class ErrorCells:
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

    def chosen(self, which: Flags) -> ErrorCells:
        """Return some of the cells."""
        rows, columns = self.rows[which], self.columns[which]
        return ErrorCells(rows, columns, self.half_x[which], self.half_y[which])


@dataclass(frozen=True, slots=True)
class Rasterizer:
    """Where observations lie on the lattice.

    window : only its cells.
    largest : half-width from which a place is left out [m].
    """

    window: Window
    resolution: float
    largest: float = math.inf

    def line(self, line: Segment) -> ErrorCells:
        """Return the cells of a segment, by METHOD's rule."""
        first, last = relevant(line, self.resolution, self.largest) or (0, -1)
        ends = np.array([[line.x0, line.y0, line.x1, line.y1]])
        count = np.array([count_of(line, self.resolution)])
        low, high = within(ends, count, self.window, self.resolution)
        some = stamps(line, max(first, int(low[0])), min(last, int(high[0])), self.resolution)
        cells = ErrorCells(some.rows, some.columns, some.half_x, some.half_y)
        kept = self._inside(cells.rows, cells.columns)
        kept[1:] &= (np.diff(cells.rows) != 0) | (np.diff(cells.columns) != 0)
        return cells.chosen(kept)

    def seen_through(self, beam: Segment, hit: bool) -> ErrorCells:
        """Return the cells through which a beam was seen to pass."""
        cells = self.line(beam)
        if not hit:
            return cells
        row, column = Lattice(self.resolution).cell_of(beam.x1, beam.y1)
        return cells.chosen((cells.rows != row) | (cells.columns != column))

    def floor(self, run: Segment, width: float) -> ErrorCells:
        """Return the cells over which a body of a width goes on a run.

        Those whose centre lies within half of the width of the path, and those of the path itself.
        """
        # A cell's centre and that of its nearest stamp's cell are each a little off the path.
        reach = math.ceil(width / 2 / self.resolution + 1.5)
        path = Rasterizer(grown(self.window, reach), self.resolution).line(run)
        up, across = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
        rows, columns = path.rows[:, None] + up, path.columns[:, None] + across
        inside = self._inside(rows, columns)
        wide = max(1, self.window.shape[1])
        inside_rows, inside_columns = rows[inside] - self.window.row0, columns[inside]
        flat = np.unique(inside_rows * wide + inside_columns - self.window.column0)
        row, column = np.divmod(flat, wide)
        row, column = row + self.window.row0, column + self.window.column0
        dx, dy = run.x1 - run.x0, run.y1 - run.y0
        length = math.hypot(dx, dy) or 1.0
        x = (column + 0.5) * self.resolution - run.x0
        y = (row + 0.5) * self.resolution - run.y0
        share = np.clip(x * (dx / length) + y * (dy / length), 0, length) / length
        half_x = run.rect0.half_x + share * (run.rect1.half_x - run.rect0.half_x)
        half_y = run.rect0.half_y + share * (run.rect1.half_y - run.rect0.half_y)
        cells = ErrorCells(row, column, half_x, half_y)
        under = np.hypot(x - share * dx, y - share * dy) <= width / 2 + HAIR * self.resolution
        on_path = Rasterizer(self.window, self.resolution).line(run)
        under |= np.isin(flat, on_path.flat(self.window))
        return cells.chosen(under & (half_x < self.largest) & (half_y < self.largest))

    def _inside(self, rows: Ints, columns: Ints) -> Flags:
        window = self.window
        inside: Flags = (rows >= window.row0) & (rows < window.row1)
        inside &= (columns >= window.column0) & (columns < window.column1)
        return inside
