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
MOST_FURNISHED = 40_000_000
"""The same of one with furniture, panel by panel: there a pixel takes 12 bytes."""

_BAND_BLOCKS = 1 << 22
"""Blocks that are drawn together."""

N = TypeVar("N", bound=np.generic)
M = TypeVar("M", float, NDArray[np.float64])


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

    def to_pixel(self, x: M, y: M, resolution: float) -> tuple[M, M]:
        """Return the place of a point, or of many, [m] in the picture [pixels], y down."""
        per_metre = self.pixels_per_metre(resolution)
        x0, y1 = self.window.column0 * resolution, self.window.row1 * resolution
        return (x - x0) * per_metre, (y1 - y) * per_metre

    def around(self, cells: Window) -> tuple[Raster, tuple[slice, slice]]:
        """Return the blocks that some cells touch, and their place, the first row the highest y."""
        cells = cells.intersection(self.window)
        rows, _ = _cut(cells.row0, cells.row1, self.window.row0, self.shrink)
        columns, _ = _cut(cells.column0, cells.column1, self.window.column0, self.shrink)
        window = Window(
            self.window.row0 + rows.start * self.shrink, self.window.row0 + rows.stop * self.shrink,
            self.window.column0 + columns.start * self.shrink,
            self.window.column0 + columns.stop * self.shrink,
        )  # fmt: skip
        high = self.blocks[0]
        return replace(self, window=window), (slice(high - rows.stop, high - rows.start), columns)

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

    def raise_to(self, found: NDArray[N], part: Window, values: NDArray[N]) -> None:
        """Raise blocks to the largest value of their cells: never a mean, which thins walls away.

        found : of all blocks, the first row the lowest y; changed in place.
        part, values : some of the window's cells, shape (rows, columns).
        """
        rows, row_starts = _cut(part.row0, part.row1, self.window.row0, self.shrink)
        columns, column_starts = _cut(part.column0, part.column1, self.window.column0, self.shrink)
        if self.shrink > 1:  # one axis after the other, the first along memory
            values = np.maximum.reduceat(
                np.maximum.reduceat(values, row_starts, axis=0), column_starts, axis=1
            )
        target = found[rows, columns]
        np.maximum(target, values, out=target)


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


LONGEST = 960
"""The longer side of a map with furniture, if nothing else is asked for [pixels]."""
LARGEST = 1600
_LEAST = (240, 160)


def furnished_raster(
    evidence: Window, exact: bool, scale: int | None, max_size: int | None, panels: int = 1
) -> Raster:
    """Choose how a map with furniture is drawn.

    exact : the window was asked for; otherwise it gets a margin, and at least room for its labels.
    panels : how many share the picture.

    Raises
    ------
    OutputError
        If the picture would have too many pixels.
    """
    share = min(panels, 3)
    longest = LONGEST // share
    largest = max_size or (LARGEST // share if scale is None else None)
    if exact:
        return _fitting(plan(evidence, scale, largest, longest), panels)
    margin = max(2, max(evidence.shape) // 40)
    window = _grown(evidence, margin, margin)
    small = scale is None and max(window.shape) * 24 <= longest
    chosen = plan(window, 24 if small else scale, largest, longest)
    width, height = chosen.size
    cells = chosen.shrink / chosen.scale
    least = [side if max_size is None else min(side, max_size - 3) for side in _LEAST]
    more_columns = max(0, round((least[0] - width) * cells / 2 + 0.5))
    more_rows = max(0, round((least[1] - height) * cells / 2 + 0.5))
    if more_columns or more_rows:
        chosen = plan(_grown(window, more_rows, more_columns), chosen.scale, largest, longest)
    return _fitting(chosen, panels)


def _fitting(chosen: Raster, panels: int) -> Raster:
    width, height = chosen.size
    if width * height * panels > MOST_FURNISHED:
        raise OutputError(
            f"{panels} × {width} × {height} pixels with axes and keys, expected at most "
            f"{MOST_FURNISHED:,}; --max-size PIXELS shrinks it, --window X0,Y0,X1,Y1 takes a part, "
            "--bare leaves all but the cells"
        )
    return chosen


def _grown(window: Window, rows: int, columns: int) -> Window:
    return Window(
        window.row0 - rows, window.row1 + rows, window.column0 - columns, window.column1 + columns
    )
