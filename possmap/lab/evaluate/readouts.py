"""Bel, Pl, λ and the like of weights of evidence w and v (METHOD §4)."""

from __future__ import annotations

import numpy as np

from possmap.lab.evaluate.raster import Floats


def _parts(w: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
    least = np.minimum(w, v)
    a, b, c = np.exp(least - w), np.exp(least - v), np.exp(least - w - v)
    d = a + b - c
    return a / d, b / d, c / d


def belief(w: Floats, v: Floats) -> Floats:
    """Bel."""
    found: Floats = -np.expm1(-w) * _parts(w, v)[1]
    return found


def plausibility(w: Floats, v: Floats) -> Floats:
    """Pl."""
    return _parts(w, v)[1]


def contested(w: Floats, v: Floats) -> Floats:
    """Contested."""
    found: Floats = 2 * np.minimum(belief(w, v), -np.expm1(-v) * _parts(w, v)[0])
    return found


def pignistic_logit(w: Floats, v: Floats) -> Floats:
    """λ."""
    found: Floats = w + np.log1p(-np.exp(-w) / 2) - v - np.log1p(-np.exp(-v) / 2)
    return found
