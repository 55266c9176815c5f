"""The kernel: what is computed cell by cell (METHOD §2), compiled where a compiler was at hand.

``_stamping.c`` is built with the package if it can be; else ``plain_kernel`` serves. Both give the
same integers. POSSMAP_KERNEL=numpy in the environment chooses the plain one.

Segments are rows of ``pyramid.table_of``. Pieces are rows of 64-bit integers:

segment, first, last : a segment's number, and the stamps k = first..last of it.
group : pieces of one group stand one after the other: inside it the maximum counts (METHOD §3).
known : 1 if the weights already hold the piece; else 0.
clip : which of the clips ends the path, or -1.

Clips are tuples of the lines at which paths end (``clip``).
"""

from __future__ import annotations

import os

import numpy as np

from possmap.core import plain_kernel, stamping
from possmap.core.clip import Clips, line_table
from possmap.core.lattice import Window
from possmap.core.pyramid import COLUMNS, Floats, Ints, Values, Weights, table_of
from possmap.core.stamping import Piece
from possmap.core.swath import normal_table

try:
    if os.environ.get("POSSMAP_KERNEL") == "numpy":
        raise ImportError
    from possmap.core import _stamping as compiled
except ImportError:
    COMPILED = False
else:
    COMPILED = True

_WIDTH = COLUMNS.index("width")


def description() -> str:
    """Return which kernel runs, for ``possmap --version -v``."""
    return "compiled (C, 16-bit integers)" if COMPILED else "plain (NumPy, 16-bit integers)"


def touch(segments: Floats, resolution: float) -> Ints:
    """Return the tiles that segments may touch, and the stamps that do.

    Returns
    -------
    Ints
        Rows of segment, tile's row and column, first and last stamp. A tile may come twice.
    """
    if not COMPILED:
        return plain_kernel.touch(segments, resolution)
    return np.frombuffer(compiled.touch(segments, resolution), dtype=np.int64).reshape(-1, 5)


def raise_block(
    block: Values,
    window: Window,
    segments: Floats,
    pieces: Ints,
    resolution: float,
    clips: Clips = (),
) -> None:
    """Raise a block to the maximum of itself and the stamps of pieces, in place.

    Parameters
    ----------
    block
        16-bit values of the cells of ``window``, shape (rows, columns).
    pieces
        Their groups do not matter.
    """
    if COMPILED and block.flags.c_contiguous:
        if block.size:
            compiled.raise_(
                block, window.row0, window.column0, *window.shape,
                segments, pieces, *line_table(clips, resolution), _knots(segments), resolution,
            )  # fmt: skip
    else:
        plain_kernel.raise_block(block, window, segments, pieces, resolution, clips)


def reinforce(
    weights: Weights,
    window: Window,
    segments: Floats,
    pieces: Ints,
    resolution: float,
    table: Weights,
    clips: Clips = (),
) -> None:
    """Add the weight of each group's maximum, or by how much it grows, in place (METHOD §3).

    Parameters
    ----------
    weights
        Of the cells of ``window``, shape (rows, columns).
    table
        The weight of each 16-bit value, shape (65536,).
    """
    if COMPILED and weights.flags.c_contiguous:
        compiled.reinforce(
            weights, window.row0, window.column0, *window.shape,
            segments, pieces, *line_table(clips, resolution), _knots(segments), table, resolution,
        )  # fmt: skip
    else:
        plain_kernel.reinforce(weights, window, segments, pieces, resolution, table, clips)


def _knots(segments: Floats) -> Floats:
    return normal_table() if segments[:, _WIDTH].any() else np.zeros((0, 3))


def stamp(block: Values, window: Window, piece: Piece, resolution: float, max_error: float) -> None:
    """Raise a block to the maximum of itself and one piece: ``stamping.stamp``, faster."""
    if not COMPILED:
        stamping.stamp(block, window, piece, resolution, max_error)
        return
    row = np.array([[0, piece.first, piece.last, 0, 0, -1]], dtype=np.int64)
    raise_block(block, window, table_of([piece.segment], max_error), row, resolution)
