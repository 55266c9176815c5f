"""``possmap query``: what is known of one point, and which records say so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from possmap.core import kernel, views
from possmap.core.clip import spared
from possmap.core.evidence import Evidence, Layer
from possmap.core.fusion import necessity_of
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.pyramid import FULL, relevant
from possmap.core.records import KIND_OF
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import Piece
from possmap.grid.grid import Grid
from possmap.grid.replay import replay

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
    """Lay out again what touches the tile, and stamp its records into the one cell."""
    key = TileKey(window.row0 // TILE, window.column0 // TILE)
    settings = grid.settings
    for identity in grid.ledger.known_in(key):
        entry = grid.ledger.entry_of(identity)
        if entry is None:
            continue
        numbers = grid.ledger.numbers_in(key, entry)
        version, found, _ = replay(grid, entry, settings)
        for one in found.evidence:
            for number, value in _said(one, numbers, window, found.model.max_error, settings):
                record = version.records[number]
                yield Witness(
                    entry.robot,
                    entry.excursion,
                    record.seq,
                    KIND_OF[type(record)],
                    LAYER_WORDS[one.layer],
                    value / FULL,
                )


def _said(
    evidence: Evidence,
    numbers: set[int],
    window: Window,
    max_error: float,
    settings: EvidenceSettings,
) -> Iterator[tuple[int, int]]:
    """Yield number and 16-bit value of each record that says something of the cell."""
    if evidence.clip and spared(window, evidence.clip, settings.resolution).all():
        return
    for segment in evidence.segments:
        if segment.record not in numbers:
            continue
        span = relevant(segment, settings.resolution, max_error)
        if span is None:
            continue
        block = np.zeros((1, 1), dtype=np.uint16)
        kernel.stamp(block, window, Piece(segment, *span), settings.resolution, max_error)
        if block[0, 0]:
            yield segment.record, int(block[0, 0])
