"""How far samples lie from the simplified track, counted without keeping them."""

from __future__ import annotations

import numpy as np

from possmap.lab.convert.samples import Floats

BIN_M = 1e-4
_BINS = 100_000


class Strays:
    """Counts distances in bins of 0.1 mm; the worst is kept exactly."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.worst = 0.0

    def add(self, strays: Floats) -> None:
        """Count distances [m]."""
        if len(strays):
            bins = np.minimum((strays / BIN_M).astype(np.int64), _BINS - 1)
            self._counts += np.bincount(bins, minlength=_BINS)
            self.worst = max(self.worst, float(strays.max()))

    @property
    def median(self) -> float:
        """The median [m], to a tenth of a millimetre; 0 without any."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        middle = int(np.searchsorted(np.cumsum(self._counts), (total + 1) // 2))
        return (middle + 0.5) * BIN_M if middle else 0.0
