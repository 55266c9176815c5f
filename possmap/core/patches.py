"""Pieces of a map as they are stored: each layer only where it says something."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray
from possmap.core.lattice import Window

JOINED_CELLS = 1 << 16
"""Neighbours are joined up to so many cells: enough for numpy, few enough for the processor."""


class Crop(NamedTuple):
    """Cells of one layer; outside the window nothing is known of it here."""

    window: Window
    cells: LayerArray


Patch: TypeAlias = Mapping[Layer, Crop]
"""One or more tiles beside each other, without what they do not know."""


def extent_of(patch: Patch) -> Window:
    """Return the smallest window that holds all layers of a patch, which has at least one."""
    first, *rest = (crop.window for crop in patch.values())
    for window in rest:
        first = first.union(window)
    return first


def spread(patch: Patch, layer: Layer, window: Window) -> LayerArray:
    """Return a layer over a window, shape (rows, columns); what is not known is 0."""
    crop = patch.get(layer)
    if crop is not None and crop.window == window:
        return crop.cells
    whole: LayerArray = np.zeros(window.shape, dtype=np.int64)
    if crop is not None:
        shared = crop.window.intersection(window)
        if shared.cells:
            whole[shared.slices_in(window)] = crop.cells[shared.slices_in(crop.window)]
    return whole


def cropped(patch: Patch, window: Window) -> Patch:
    """Return the part of a patch that lies within a window, perhaps nothing."""
    found = {}
    for layer, crop in patch.items():
        shared = crop.window.intersection(window)
        if shared == crop.window:
            found[layer] = crop
        elif shared.cells:
            found[layer] = Crop(shared, crop.cells[shared.slices_in(crop.window)])
    return found


def joined(tiles: Iterator[tuple[int, Patch]]) -> Iterator[Patch]:
    """Join neighbours in one row of tiles, as long as there are few cells.

    tiles : columns of tiles, ascending, each with its patch.
    """
    run: list[Patch] = []
    whole, last = Window(0, 0, 0, 0), 0
    for column, patch in tiles:
        window = extent_of(patch)
        grown = whole.union(window) if run else window
        if run and (column != last + 1 or grown.cells > JOINED_CELLS):
            yield _of_run(run)
            run, grown = [], window
        run.append(patch)
        whole, last = grown, column
    if run:
        yield _of_run(run)


def _of_run(run: list[Patch]) -> Patch:
    if len(run) == 1:
        return run[0]
    found: dict[Layer, Crop] = {}
    for layer in Layer:
        crops = [patch[layer] for patch in run if layer in patch]
        if len(crops) == 1:
            found[layer] = crops[0]
        elif crops:
            window = extent_of({layer: crops[0]})
            for crop in crops[1:]:
                window = window.union(crop.window)
            whole: LayerArray = np.zeros(window.shape, dtype=crops[0].cells.dtype)
            for crop in crops:
                whole[crop.window.slices_in(window)] = crop.cells
            found[layer] = Crop(window, whole)
    return found
