"""Evidence taken out of a tile again: weights by subtraction, denials where nobody else is sure."""

from __future__ import annotations

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers
from possmap.core.settings import FreeFusion


def withdrawn(
    layers: TileLayers, gone: TileLayers, free_fusion: FreeFusion
) -> tuple[TileLayers, bool]:
    """Return a tile without some of its evidence, and whether its denials must be raised again.

    Weights add up, so what is left of them is a difference; under ``free_fusion: dempster`` those
    of free space, too. Under ``minimum`` a denial is a maximum: where what goes
    is as large as what the tile holds, it may have been alone, and the cell becomes 0 until the
    others have said again what they know of it. In all other cells they have said so already.

    Parameters
    ----------
    layers
        The tile, as new arrays may be made of it; left as it is.
    gone
        What goes, as a partial tile: what it alone makes of an empty one.

    Raises
    ------
    ValueError
        If the tile holds less than what goes.
    """
    left = dict(layers)
    for layer, array in gone.items():
        held = layers.get(layer)
        if held is None or (held < array).any():
            raise ValueError("less than the ledger's records make")
        if layer is not Layer.FREE or free_fusion == "dempster":
            left[layer] = held - array
    if Layer.FREE not in gone or free_fusion == "dempster":
        return left, False
    denials = layers[Layer.FREE]
    in_doubt = (denials == gone[Layer.FREE]) & (denials != 0)
    left[Layer.FREE] = np.where(in_doubt, np.zeros_like(denials), denials)
    return left, bool(in_doubt.any())
