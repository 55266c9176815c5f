"""Views of a grid, computed from N and Π on demand and never stored (METHOD §4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

CellArray: TypeAlias = NDArray[np.float64]
"""One number per cell, shape (rows, columns), row 0 at the lowest y."""

EDGE = math.exp(-16)
"""How far masses and probabilities stay from certainty: one certain detection's weight."""


class Masses(NamedTuple):
    """Dempster's normalised masses; they add up to 1 in every cell."""

    wall: CellArray
    free: CellArray
    unknown: CellArray


def ignorance(necessity: CellArray, possibility: CellArray) -> CellArray:
    """Return max(0, Π - N): how much is not known."""
    return np.maximum(0.0, possibility - necessity)


def conflict(necessity: CellArray, possibility: CellArray) -> CellArray:
    """Return Dempster's K = N·(1 - Π): how much of the evidence contradicts itself."""
    return necessity * (1 - possibility)


def contradicted(necessity: CellArray, possibility: CellArray) -> NDArray[np.bool_]:
    """Return the cells with N > Π, which no probability satisfies."""
    return necessity > possibility


def masses(necessity: CellArray, possibility: CellArray) -> Masses:
    """Return m(wall), m(free) and m(Ω), with N and Π kept e⁻¹⁶ away from certainty."""
    n, p = _inside(necessity, possibility)
    rest = 1 - n * (1 - p)
    return Masses(n * p / rest, (1 - n) * (1 - p) / rest, (1 - n) * p / rest)


def probability(necessity: CellArray, possibility: CellArray, base_rate: float = 0.5) -> CellArray:
    """Return the normalised plausibility: logit = -ln(1 - N) + ln Π + logit(base rate).

    Raises
    ------
    ValueError
        Unless 0 < base_rate < 1.
    """
    if not 0 < base_rate < 1:
        raise ValueError(f"base_rate, found {base_rate}, expected a number between 0 and 1")
    n, p = _inside(necessity, possibility)
    logit = -np.log1p(-n) + np.log(p) + math.log(base_rate / (1 - base_rate))
    return 1 / (1 + np.exp(-logit))


def _inside(necessity: CellArray, possibility: CellArray) -> tuple[CellArray, CellArray]:
    return np.minimum(necessity, 1 - EDGE), np.maximum(possibility, EDGE)


View: TypeAlias = Callable[[CellArray, CellArray, float], CellArray]

VIEWS: Mapping[str, View] = MappingProxyType(
    {
        "necessity": lambda n, p, _: n,
        "possibility": lambda n, p, _: p,
        "ignorance": lambda n, p, _: ignorance(n, p),
        "conflict": lambda n, p, _: conflict(n, p),
        "mass_wall": lambda n, p, _: masses(n, p).wall,
        "mass_free": lambda n, p, _: masses(n, p).free,
        "mass_unknown": lambda n, p, _: masses(n, p).unknown,
        "probability": probability,
    }
)
"""Every view by name, as a function of N, Π and the base rate."""
