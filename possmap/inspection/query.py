"""``possmap query``: what is known of one point, and which records say so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from possmap.core import kernel, views
from possmap.core.clip import spared
from possmap.core.evidence import Evidence, Layer, Segment
from possmap.core.fusion import necessity_of
from possmap.core.lattice import TILE, Lattice, TileKey, Window
from possmap.core.pyramid import FULL, relevant
from possmap.core.records import KIND_OF
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import Piece
from possmap.grid.grid import Grid
from possmap.grid.replay import laid_out

LAYER_WORDS = {Layer.WALLS: "wall", Layer.FREE: "free", Layer.POINTS: "point"}


@dataclass(frozen=True, slots=True)
class Witness:
    """A record that says something of a cell.

    says : ``wall`` (value is its N), ``free`` (value is what it takes from Π) or ``point``.
    """

    robot: str
    excursion: str
    seq: int
    kind: str
    says: str
    value: float


@dataclass(frozen=True, slots=True)
class PointReport:
    """All that is known of the cell that holds a point.

    row, column : of the cell; x, y : its centre [m].
    views : every view of METHOD §4, by name.
    """

    row: int
    column: int
    x: float
    y: float
    views: dict[str, float]
    contradicted: bool
    witnesses: tuple[Witness, ...]


def query(path: Path, x: float, y: float, base_rate: float = 0.5) -> PointReport:
    """Report on the cell that holds the point (x, y) [m].

    Raises
    ------
    GridError
        If the file is no grid.
    """
    with Grid(path) as grid, grid.snapshot():
        row, column = grid.lattice.cell_of(x, y)
        window = Window(row, row + 1, column, column + 1)
        walls, free, points = (grid.tiles.read_window(layer, window) for layer in Layer)
        cell = views.Readout.of(walls, free, grid.tiles.free_fusion)
        values = {name: float(view(cell, base_rate)[0, 0]) for name, view in views.VIEWS.items()}
        values["points"] = float(necessity_of(points)[0, 0])
        centre_x, centre_y = grid.lattice.centre_of(row, column)
        strongest = sorted(_witnesses(grid, window), key=lambda witness: -witness.value)
        return PointReport(
            row=row,
            column=column,
            x=centre_x,
            y=centre_y,
            views=values,
            contradicted=values["necessity"] > values["possibility"],
            witnesses=tuple(strongest),
        )


def _witnesses(grid: Grid, window: Window) -> Iterator[Witness]:
    """Lay out again what touches the tile, and stamp what may reach it into the one cell."""
    key = TileKey(window.row0 // TILE, window.column0 // TILE)
    settings = grid.settings
    for identity, numbers in grid.ledger.touching(key).items():
        entry = grid.ledger.entry_of(identity)
        if entry is None:
            continue
        version, found = laid_out(grid, entry, settings)
        for one in found.evidence:
            for segment in one.segments:
                if segment.record in numbers:
                    value = _said(one, segment, window, entry.model.max_error, settings)
                    if value:
                        record = version.records[segment.record]
                        kind, says = KIND_OF[type(record)], LAYER_WORDS[one.layer]
                        name = entry.robot, entry.excursion, record.seq
                        yield Witness(*name, kind, says, value / FULL)


def _said(
    one: Evidence, segment: Segment, window: Window, max_error: float, settings: EvidenceSettings
) -> int:
    """Return the 16-bit value that a segment gives to the cell."""
    c = settings.resolution
    span = None
    if _is_near(segment, *Lattice(c).centre_of(window.row0, window.column0), c):
        span = relevant(segment, c, max_error)
    if span is None:
        return 0
    if one.clip and spared(window, one.clip, c).all():
        return 0
    block = np.zeros((1, 1), dtype=np.uint16)
    kernel.stamp(block, window, Piece(segment, *span), c, max_error)
    return int(block[0, 0])


def _is_near(segment: Segment, x: float, y: float, resolution: float) -> bool:
    """Whether a segment may reach a point: within its rectangles, or its swath in any direction."""
    (half_x, half_y), (half_x1, half_y1) = segment.rect0, segment.rect1
    half_x, half_y = max(half_x, half_x1), max(half_y, half_y1)
    if segment.swath is not None:
        half_x = half_y = 2 * (half_x + half_y) + segment.swath.width
    reach_x, reach_y = half_x + 2 * resolution, half_y + 2 * resolution
    return (
        min(segment.x0, segment.x1) - reach_x <= x <= max(segment.x0, segment.x1) + reach_x
        and min(segment.y0, segment.y1) - reach_y <= y <= max(segment.y0, segment.y1) + reach_y
    )
