"""What to stamp, tile by tile: each touched tile is read, changed and written once (METHOD §3).

Plans are tables of numbers, so that a batch of hundreds of logs stays small, is sorted in one go
and goes to another process, or another machine, as it is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core import kernel
from possmap.core.clip import Clips
from possmap.core.evidence import Evidence, Findings, Layer
from possmap.core.lattice import TileKey
from possmap.core.pyramid import Floats, Ints, table_of
from possmap.core.settings import EvidenceSettings

Touched: TypeAlias = list[tuple[int, int, int]]
"""Row and column of a tile, and the index of a record that touches it; sorted."""

_ROW, _COLUMN, _LAYER, _SEGMENT, _FIRST, _LAST, _GROUP, _KNOWN, _CLIP = range(9)
_PLACE = [_ROW, _COLUMN, _LAYER]


class TileWork(NamedTuple):
    """What to stamp into one tile.

    segments : rows of ``pyramid.table_of``.
    pieces : of each layer, ``kernel``'s rows, and in a last column which of ``clips`` ends the
        path, or -1; sorted by group, and in a group what the tile holds already comes first.
    clips : lines at which paths end.
    """

    key: TileKey
    segments: Floats
    pieces: dict[Layer, Ints]
    clips: Clips


@dataclass(frozen=True, eq=False)
class ExcursionPlan:
    """What one excursion newly says, cut at the borders of tiles.

    segments : rows of ``pyramid.table_of``.
    pieces : rows of tile's row and column, layer, segment, first and last stamp, group, whether
        the grid holds it already, and which of ``clips``, or -1. Groups count from 0.
    records : the record of each segment.
    """

    segments: Floats
    pieces: Ints
    records: Ints
    clips: Clips

    @property
    def groups(self) -> int:
        """Beyond any of its groups' numbers."""
        return 1 + int(self.pieces[:, _GROUP].max(initial=0))

    @property
    def tiles(self) -> set[TileKey]:
        """The tiles in which it says anything."""
        rows, columns = self.pieces[:, _ROW].tolist(), self.pieces[:, _COLUMN].tolist()
        return set(map(TileKey, rows, columns))

    def among(self, keys: Collection[TileKey], layer: Layer | None = None) -> ExcursionPlan:
        """Return what it says in some tiles; of one layer, or of all."""
        wanted = np.array([tuple(key) for key in keys], dtype=np.int64).reshape(-1, 2)
        here = _among(self.pieces[:, [_ROW, _COLUMN]], wanted)
        if layer is not None:
            here &= self.pieces[:, _LAYER] == layer
        return ExcursionPlan(self.segments, self.pieces[here], self.records, self.clips)

    def touched(self) -> Touched:
        """Return the tiles that each new record touches."""
        new = self.pieces[self.pieces[:, _KNOWN] == 0]
        records = self.records[new[:, _SEGMENT]].tolist()
        rows, columns = new[:, _ROW].tolist(), new[:, _COLUMN].tolist()
        return sorted(set(zip(rows, columns, records, strict=True)))


def plan_excursion(
    found: Findings, known_records: int, settings: EvidenceSettings
) -> ExcursionPlan:
    """Plan the stamping of what an excursion newly says.

    known_records : how many of its records, from the first, the grid already holds.
    """
    new = _pieces(found, settings, known_records, known=False)
    by_excursion = _layers_by_excursion(settings)
    if by_excursion and known_records:
        # What the excursion said before in these tiles, so that only the difference is added.
        before = _pieces(found, settings, known_records, known=True)
        reinforced = new.pieces[np.isin(new.pieces[:, _LAYER], by_excursion)]
        again = _among(before.pieces[:, _PLACE], reinforced[:, _PLACE])
        before = ExcursionPlan(before.segments, before.pieces[again], before.records, before.clips)
        return _joined([before, new], same_groups=True)
    return new


def _layers_by_excursion(settings: EvidenceSettings) -> list[Layer]:
    """Return the layers in which an excursion's largest value counts, once (METHOD §3)."""
    found = [Layer.WALLS, Layer.POINTS] if settings.independence == "excursion" else []
    return [*found, Layer.FREE] if settings.free_fusion == "dempster" else found


def _pieces(
    found: Findings, settings: EvidenceSettings, known_records: int, known: bool
) -> ExcursionPlan:
    """Cut the evidence that the grid holds, or that which it does not, at the borders of tiles."""
    chosen = [one for one in found.evidence if (one.closed_by < known_records) == known]
    of_segment = np.array(
        [row for number, one in enumerate(chosen) for row in _facts(number, one)], dtype=np.int64
    ).reshape(-1, 4)
    every = [segment for one in chosen for segment in one.segments]
    segments = table_of(every, found.model.max_error)
    touch = kernel.touch(segments, settings.resolution)
    pieces = np.empty((len(touch), 9), dtype=np.int64)
    pieces[:, [_SEGMENT, _ROW, _COLUMN, _FIRST, _LAST]] = touch
    pieces[:, [_LAYER, _GROUP, _CLIP]] = of_segment[touch[:, 0], :3]
    pieces[:, _KNOWN] = known
    pieces[np.isin(pieces[:, _LAYER], _layers_by_excursion(settings)), _GROUP] = 0
    clips = tuple(one.clip for one in chosen)
    return ExcursionPlan(segments, pieces, of_segment[:, 3], clips)


def _facts(number: int, one: Evidence) -> Iterator[tuple[int, int, int, int]]:
    """Yield layer, group, clip and record of each segment of a piece of evidence."""
    clip = number if one.clip else -1
    for segment in one.segments:
        yield one.layer, number, clip, segment.record


def _among(rows: Ints, wanted: Ints) -> NDArray[np.bool_]:
    """Return which rows of numbers are among those wanted.

    By one number for each row, made of the ranks of its numbers: a tile's may be anything.
    """
    here = np.full(len(rows), len(wanted) > 0)
    code, wanted_code = np.zeros(len(rows), dtype=np.int64), np.zeros(len(wanted), dtype=np.int64)
    for column in range(rows.shape[1] if len(wanted) else 0):
        values, rank = np.unique(wanted[:, column], return_inverse=True)
        nearest = np.minimum(np.searchsorted(values, rows[:, column]), len(values) - 1)
        here &= values[nearest] == rows[:, column]
        code, wanted_code = code * len(values) + nearest, wanted_code * len(values) + rank
    here &= np.isin(code, wanted_code)
    return here


def _joined(plans: Sequence[ExcursionPlan], same_groups: bool = False) -> ExcursionPlan:
    """Put plans into one; their groups stay apart, unless they are of one excursion."""
    segments = clips = groups = 0
    pieces = []
    for plan in plans:
        moved = plan.pieces.copy()
        moved[:, _SEGMENT] += segments
        moved[moved[:, _CLIP] >= 0, _CLIP] += clips
        moved[:, _GROUP] += groups
        pieces.append(moved)
        segments += len(plan.segments)
        clips += len(plan.clips)
        if not same_groups:
            groups += plan.groups
    return ExcursionPlan(
        np.concatenate([plan.segments for plan in plans]),
        np.concatenate(pieces),
        np.concatenate([plan.records for plan in plans]),
        tuple(clip for plan in plans for clip in plan.clips),
    )


def by_tile(plans: Sequence[ExcursionPlan]) -> tuple[int, Iterator[TileWork]]:
    """Return how many tiles excursions touch, and the work in each, in the order of their keys."""
    if not plans:
        return 0, iter(())
    whole = _joined(plans)
    pieces = whole.pieces
    order = np.lexsort((-pieces[:, _KNOWN], pieces[:, _GROUP], pieces[:, _COLUMN], pieces[:, _ROW]))
    pieces = pieces[order]
    changes = np.flatnonzero((pieces[1:, :2] != pieces[:-1, :2]).any(axis=1)) + 1
    starts = [0, *changes.tolist(), len(pieces)] if len(pieces) else [0]
    bounds = list(pairwise(starts))
    works = (_work(whole, pieces[start:stop]) for start, stop in bounds)
    return len(bounds), works


def _work(whole: ExcursionPlan, pieces: Ints) -> TileWork:
    """Return the work of one tile, with only the segments that it needs."""
    needed, renumbered = np.unique(pieces[:, _SEGMENT], return_inverse=True)
    rows = pieces[:, [_SEGMENT, _FIRST, _LAST, _GROUP, _KNOWN, _CLIP]]
    rows[:, 0] = renumbered.reshape(-1)
    clips: Clips = ()
    clipped = rows[:, 5] >= 0
    if clipped.any():
        lines, renumbered = np.unique(rows[clipped, 5], return_inverse=True)
        rows[clipped, 5] = renumbered.reshape(-1)
        clips = tuple(whole.clips[line] for line in lines.tolist())
    layers = {
        layer: np.ascontiguousarray(rows[of_layer])
        for layer in Layer
        if (of_layer := pieces[:, _LAYER] == layer).any()
    }
    key = TileKey(int(pieces[0, _ROW]), int(pieces[0, _COLUMN]))
    return TileWork(key, whole.segments[needed], layers, clips)
