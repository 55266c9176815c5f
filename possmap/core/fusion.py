"""Fusion: evidence added to tiles, in integers, so that order cannot matter (METHOD §3).

S(x, y) = x + y - xy is addition of weights w = -ln(1 - N), Shafer's weight of evidence; free space
is a maximum of denials 1 - Π. Both are commutative and associative on integers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.clip import ClipLine, spared
from possmap.core.evidence import Findings, Layer
from possmap.core.lattice import TILE, TileKey, Window, tile_window
from possmap.core.pyramid import FULL, Values
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import Piece, extent, pieces, stamp

UNIT = 2**18
"""Weight of evidence 1 as an integer."""

CERTAIN = 16 * UNIT
"""The weight of a value of 65535, which has no finite logarithm."""

Weights: TypeAlias = NDArray[np.int64]
LayerArray: TypeAlias = Weights | Values
TileLayers: TypeAlias = dict[Layer, LayerArray]
"""The layers of one tile that are not pure ignorance, each of shape (TILE, TILE)."""


def _weight_table() -> Weights:
    with np.errstate(divide="ignore"):
        weights = -np.log(1 - np.arange(FULL + 1) / FULL) * UNIT
    weights[FULL] = CERTAIN
    table: Weights = np.rint(weights).astype(np.int64)
    table.flags.writeable = False
    return table


WEIGHT = _weight_table()
"""Weight of each 16-bit value: round(-ln(1 - q/65535)·2¹⁸), and 16·2¹⁸ at 65535 (METHOD §3)."""


class Job(NamedTuple):
    """A piece to stamp into a tile.

    excursion, evidence : numbers that tell whose it is; pieces of one evidence share them.
    known : whether the tile already holds it (``independence: excursion`` stamps it again).
    """

    excursion: int
    evidence: int
    layer: Layer
    known: bool
    piece: Piece
    clip: tuple[ClipLine, ...]
    max_error: float


Plan: TypeAlias = dict[TileKey, list[Job]]
"""What to stamp, tile by tile: each touched tile is read, changed and written once."""

Touched: TypeAlias = set[tuple[TileKey, int]]
"""Tiles, each with the index of a record that touches it."""


def add_to_plan(
    plan: Plan,
    found: Findings,
    excursion: int,
    known_records: int,
    settings: EvidenceSettings,
) -> Touched:
    """Plan the stamping of what an excursion newly says; return the tiles that each record touches.

    Parameters
    ----------
    excursion
        A number that no other excursion of the plan has.
    known_records
        How many of its records, from the first, the grid already holds.
    """
    touched: Touched = set()
    resolution, max_error = settings.resolution, found.model.max_error

    def jobs(known: bool) -> Iterator[tuple[TileKey, Job]]:
        for number, one in enumerate(found.evidence):
            if (one.closed_by < known_records) == known:
                for segment in one.segments:
                    for key, piece in pieces(segment, resolution, max_error):
                        yield (
                            key,
                            Job(excursion, number, one.layer, known, piece, one.clip, max_error),
                        )

    reinforced: set[tuple[TileKey, Layer]] = set()
    for key, job in jobs(known=False):
        plan.setdefault(key, []).append(job)
        touched.add((key, job.piece.segment.record))
        if job.layer is not Layer.FREE:
            reinforced.add((key, job.layer))
    if settings.independence == "excursion" and known_records and reinforced:
        # What the excursion said before in these tiles, so that only the difference is added.
        for key, job in jobs(known=True):
            if (key, job.layer) in reinforced:
                plan[key].append(job)
    return touched


def fuse_tile(
    key: TileKey, jobs: Iterable[Job], layers: TileLayers, settings: EvidenceSettings
) -> TileLayers:
    """Return the layers of a tile that the jobs change, as new arrays.

    Parameters
    ----------
    layers
        The tile's layers so far; left as they are.
    """
    changed: TileLayers = {}
    window = tile_window(key)
    by_layer = sorted(jobs, key=lambda job: (job.layer, job.excursion, job.known, job.evidence))
    for layer, of_layer in groupby(by_layer, key=lambda job: job.layer):
        array = layers[layer].copy() if layer in layers else blank(layer)
        if layer is Layer.FREE:
            for job in of_layer:
                _deny(array, window, job, settings.resolution)
        elif settings.independence == "detection":
            for _, detection in groupby(of_layer, key=lambda job: (job.excursion, job.evidence)):
                _reinforce(array, window, list(detection), settings.resolution)
        else:
            for _, excursion in groupby(of_layer, key=lambda job: job.excursion):
                _reinforce(array, window, list(excursion), settings.resolution)
        if array.any():
            changed[layer] = array
    return changed


def blank(layer: Layer) -> LayerArray:
    """Return a tile of pure ignorance: nothing denied, no weight."""
    if layer is Layer.FREE:
        return np.zeros((TILE, TILE), dtype=np.uint16)
    return np.zeros((TILE, TILE), dtype=np.int64)


def _reinforce(array: LayerArray, window: Window, jobs: list[Job], resolution: float) -> None:
    """Add the weight of one detection's maximum, or by how much it grows, to those of a tile."""
    known = [job for job in jobs if job.known]
    region = _extent(jobs, window, resolution)
    values = np.zeros(region.shape, dtype=np.uint16)
    for job in known:
        stamp(values, region, job.piece, resolution, job.max_error)
    before = WEIGHT[values] if known else 0
    for job in jobs:
        if not job.known:
            stamp(values, region, job.piece, resolution, job.max_error)
    array[region.slices_in(window)] += WEIGHT[values] - before


def _deny(array: LayerArray, window: Window, job: Job, resolution: float) -> None:
    """Raise a tile's denials to those of a free path, which ends at the lines that clip it."""
    region = _extent([job], window, resolution)
    values = np.zeros(region.shape, dtype=np.uint16)
    stamp(values, region, job.piece, resolution, job.max_error)
    if job.clip:
        values[spared(region, job.clip, resolution)] = 0
    target = array[region.slices_in(window)]
    np.maximum(target, values, out=target)


def _extent(jobs: list[Job], window: Window, resolution: float) -> Window:
    whole = extent(jobs[0].piece, resolution)
    for job in jobs[1:]:
        whole = whole.union(extent(job.piece, resolution))
    return whole.intersection(window)


def necessity_of(weights: Weights) -> NDArray[np.float64]:
    """Return N = 1 - exp(-w / 2¹⁸) of integer weights (METHOD §3)."""
    # Most cells of a map hold no wall, and the exponential is what takes the time.
    necessity = np.zeros(weights.shape)
    some = weights != 0
    if some.any():
        necessity[some] = -np.expm1(weights[some] / -UNIT)
    return necessity


def possibility_of(denials: Values) -> NDArray[np.float64]:
    """Return Π = 1 - q/65535 of 16-bit denials (METHOD §3)."""
    possibility: NDArray[np.float64] = 1 - denials / FULL
    return possibility
