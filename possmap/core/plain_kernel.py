"""The kernel in NumPy, plain: serves where no compiled one was built, and is its proof.

The functions are those of ``kernel``, which says what they do.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np

from possmap.core.clip import Clips, spared
from possmap.core.lattice import Window
from possmap.core.pyramid import COLUMNS, Floats, Ints, Values, Weights, segment_of
from possmap.core.stamping import Piece, extent, pieces_of, stamp

_MAX_ERROR = COLUMNS.index("max_error")


def touch(segments: Floats, resolution: float) -> Ints:  # noqa: D103
    found = [
        (number, *key, piece.first, piece.last)
        for number, row in enumerate(segments)
        for key, piece in pieces_of(segment_of(row), resolution, float(row[_MAX_ERROR]))
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 5)


def raise_block(  # noqa: D103
    block: Values,
    window: Window,
    segments: Floats,
    pieces: Ints,
    resolution: float,
    clips: Clips = (),
) -> None:
    for number, first, last, *_, clip in pieces.tolist():
        row = segments[number]
        piece, max_error = Piece(segment_of(row), first, last), float(row[_MAX_ERROR])
        if clip < 0:
            stamp(block, window, piece, resolution, max_error)
            continue
        region = extent(piece, resolution).intersection(window)
        values: Values = np.zeros(region.shape, dtype=np.uint16)
        stamp(values, region, piece, resolution, max_error)
        values[spared(region, clips[clip], resolution)] = 0
        target = block[region.slices_in(window)]
        np.maximum(target, values, out=target)


def reinforce(  # noqa: D103
    weights: Weights,
    window: Window,
    segments: Floats,
    pieces: Ints,
    resolution: float,
    table: Weights,
    clips: Clips = (),
) -> None:
    for _, group in groupby(pieces.tolist(), key=lambda piece: piece[3]):
        some = np.array(list(group), dtype=np.int64)
        region = _extent(segments, some, window, resolution)
        values: Values = np.zeros(region.shape, dtype=np.uint16)
        known = some[:, 4] != 0
        raise_block(values, region, segments, some[known], resolution, clips)
        before = table[values]
        raise_block(values, region, segments, some[~known], resolution, clips)
        weights[region.slices_in(window)] += table[values] - before


def _extent(segments: Floats, pieces: Ints, window: Window, resolution: float) -> Window:
    """Return a window of all cells of ``window`` that pieces may touch."""
    whole: Window | None = None
    for number, first, last, *_ in pieces.tolist():
        one = extent(Piece(segment_of(segments[number]), first, last), resolution)
        whole = one if whole is None else whole.union(one)
    return (whole or Window(0, 0, 0, 0)).intersection(window)
