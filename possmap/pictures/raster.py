"""Which cells become which pixels: windows, enlarging, and shrinking so that thin walls survive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import TILE, Window
from possmap.errors import OutputError

MOST_PIXELS = 100_000_000
"""A picture larger than this is refused."""

_BAND_BLOCKS = 1 << 22
"""Blocks that are drawn together."""

N = TypeVar("N", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Raster:
    """The cells of a picture, and how large they are drawn.

    window : cells, whole blocks of them.
    shrink : cells along a side of a block, which becomes one pixel; 1: none.
    scale : pixels along a side of a cell; 1 where it shrinks.
    """

    window: Window
    shrink: int = 1
    scale: int = 1

    @property
    def blocks(self) -> tuple[int, int]:
        """Rows and columns of blocks."""
        rows, columns = self.window.shape
        return rows // self.shrink, columns // self.shrink

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        rows, columns = self.blocks
        return columns * self.scale, rows * self.scale

    def pixels_per_metre(self, resolution: float) -> float:
        """Return how many pixels a metre becomes."""
        return self.scale / (self.shrink * resolution)

    def to_pixel(self, x: float, y: float, resolution: float) -> tuple[float, float]:
        """Return the place of a point [m] in the picture [pixels], y down."""
        per_metre = self.pixels_per_metre(resolution)
        x0, y1 = self.window.column0 * resolution, self.window.row1 * resolution
        return (x - x0) * per_metre, (y1 - y) * per_metre

    def bands(self) -> Iterator[tuple[int, Raster]]:
        """Yield bands of rows from the lowest, each with its first row of blocks."""
        rows, columns = self.blocks
        height = max(1, _BAND_BLOCKS // max(1, columns))
        # As high as whole tiles where it can be, so that each tile is read once.
        height = max(TILE, height // TILE * TILE) if self.shrink == 1 else height
        for first in range(0, rows, height):
            end = min(rows, first + height)
            row0 = self.window.row0
            window = replace(
                self.window, row0=row0 + first * self.shrink, row1=row0 + end * self.shrink
            )
            yield first, replace(self, window=window)

    def blocks_of(self, part: Window) -> Blocks:
        """Return which blocks some cells of the window belong to."""
        rows, row_starts = _cut(part.row0, part.row1, self.window.row0, self.shrink)
        columns, column_starts = _cut(part.column0, part.column1, self.window.column0, self.shrink)
        return Blocks((rows, columns), row_starts, column_starts, self.shrink)


@dataclass(frozen=True, slots=True)
class Blocks:
    """Some cells' blocks; blocks at the edge may go on in other cells.

    where : index in an array of all blocks, whose first row is the lowest y.
    """

    where: tuple[slice, slice]
    row_starts: NDArray[np.intp]
    column_starts: NDArray[np.intp]
    shrink: int

    def largest(self, cells: NDArray[N]) -> NDArray[N]:
        """Return each block's largest value: never a mean, which would thin walls away.

        cells : shape (rows, columns), as the part.
        """
        if self.shrink == 1:
            return cells
        # One axis after the other, the first along memory.
        found: NDArray[N] = np.maximum.reduceat(
            np.maximum.reduceat(cells, self.row_starts, axis=0), self.column_starts, axis=1
        )
        return found


def _cut(first: int, end: int, origin: int, step: int) -> tuple[slice, NDArray[np.intp]]:
    """Return the blocks of cells first … end - 1 along an axis, and where each begins in them."""
    low, high = (first - origin) // step, -(-(end - origin) // step)
    starts = np.maximum(np.arange(low, high) * step + origin - first, 0)
    return slice(low, high), starts


def plan(
    window: Window, scale: int | None, max_size: int | None, enlarge_to: int | None = None
) -> Raster:
    """Choose how large a window is drawn.

    Parameters
    ----------
    scale
        Pixels per cell; None: 1, or as many as ``enlarge_to`` allows.
    max_size
        The longer side's most pixels; larger pictures shrink by whole blocks of cells.
    enlarge_to
        The longer side's least pixels where nothing else is asked for.

    Raises
    ------
    OutputError
        If the picture would have more than 10⁸ pixels.
    """
    longest = max(window.shape)
    shrink = 1
    if max_size is not None and longest > max_size:
        shrink = -(-longest // max_size)
        if len(range(window.row0 // shrink, -(-window.row1 // shrink))) > max_size or (
            len(range(window.column0 // shrink, -(-window.column1 // shrink))) > max_size
        ):
            # Blocks lie on the lattice: the window may cut one more than its length needs.
            shrink = -(-(longest - 1) // max(1, max_size - 1))
    if scale is None:
        scale = max(1, (enlarge_to or 0) // longest)
    if max_size is not None:
        scale = min(scale, max(1, max_size // longest))
    if shrink > 1:
        scale = 1
    whole = Window(
        window.row0 // shrink * shrink,
        -(-window.row1 // shrink) * shrink,
        window.column0 // shrink * shrink,
        -(-window.column1 // shrink) * shrink,
    )
    raster = Raster(whole, shrink, scale)
    width, height = raster.size
    if width * height > MOST_PIXELS:
        raise OutputError(
            f"a picture of {width} × {height} pixels, expected at most 10⁸; "
            "--max-size PIXELS shrinks it, --window X0,Y0,X1,Y1 takes a part"
        )
    return raster
