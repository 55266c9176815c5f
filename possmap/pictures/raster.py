"""Which cells become which pixels: windows, enlarging, and shrinking so that thin walls survive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.lattice import TILE, Window
from possmap.errors import OutputError

MOST_PIXELS = 100_000_000
"""A picture larger than this is refused."""

_COLUMNS_AT_ONCE = 4096

Reduction: TypeAlias = Literal["max", "min"]


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

    def parts(self) -> Iterator[tuple[Window, tuple[slice, slice]]]:
        """Cut the window into parts of whole blocks that fit into memory, each with its index.

        The index is for an array of blocks whose first row is the lowest y.
        """
        step = self.shrink
        rows = max(1, TILE // step) * step
        columns = max(1, _COLUMNS_AT_ONCE // step) * step
        w = self.window
        for row in range(w.row0, w.row1, rows):
            for column in range(w.column0, w.column1, columns):
                part = Window(
                    row, min(row + rows, w.row1), column, min(column + columns, w.column1)
                )
                yield (
                    part,
                    (
                        slice((part.row0 - w.row0) // step, (part.row1 - w.row0) // step),
                        slice(
                            (part.column0 - w.column0) // step, (part.column1 - w.column0) // step
                        ),
                    ),
                )


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
            f"a picture of {width} × {height} pixels, expected at most {MOST_PIXELS:.0e}; "
            "--max-size PIXELS shrinks it, --window X0,Y0,X1,Y1 takes a part"
        )
    return raster


def reduced(cells: NDArray[np.generic], shrink: int, by: Reduction) -> NDArray[np.generic]:
    """Return a block's largest or smallest value, never a mean, which would thin walls away.

    cells : shape (rows, columns), whole blocks.
    """
    if shrink == 1:
        return cells
    rows, columns = cells.shape
    blocks = cells.reshape(rows // shrink, shrink, columns // shrink, shrink)
    # One axis after the other: both at once takes eight times as long.
    found: NDArray[np.generic] = (
        blocks.max(axis=1).max(axis=2) if by == "max" else blocks.min(axis=1).min(axis=2)
    )
    return found
