"""What a grid says of each cell: views of METHOD §4, computed from the weights on demand.

Two sums of evidence tell all: w for a wall, v against it (METHOD §3). N = 1 - e^-w and Π = e^-v are
what each says alone; belief and plausibility are both together, by Dempster's rule. They come from
w and v themselves, never from N and Π, which saturate: e^-min(w, v) is taken out of every term.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.fusion import UNIT, LayerArray, denial_weights, possibility_of
from possmap.core.settings import FreeFusion

CellArray: TypeAlias = NDArray[np.float64]
"""One number per cell, shape (rows, columns), row 0 at the lowest y."""


EDGE = math.exp(-16)
"""How far masses and probabilities stay from certainty: one certain detection's weight."""


class Masses(NamedTuple):
    """Dempster's normalised masses; they add up to 1 in every cell."""

    wall: CellArray
    free: CellArray
    unknown: CellArray


@dataclass(frozen=True, slots=True)
class Readout:
    """All views of some cells, arrays of one shape.

    Attributes
    ----------
    w, v
        Weights of evidence for a wall and against it, >= 0.
    possibility
        Π, what the evidence against a wall says alone.
    """

    w: CellArray
    v: CellArray
    possibility: CellArray

    @classmethod
    def of(cls, weights: LayerArray, denials: LayerArray, free_fusion: FreeFusion) -> Readout:
        """Return what the integers of the layers WALLS and FREE say, as they are stored."""
        return cls(
            weights / UNIT,
            denial_weights(denials, free_fusion),
            possibility_of(denials, free_fusion),
        )

    @property
    def necessity(self) -> CellArray:
        """N, what the evidence for a wall says alone."""
        return -np.expm1(-self.w)

    @property
    def belief(self) -> CellArray:
        """Bel of a wall, m(wall)."""
        return self.masses.wall

    @property
    def plausibility(self) -> CellArray:
        """Pl of a wall, m(wall) + m(Ω)."""
        wall_side, _, total = self._shares()
        return wall_side / total

    @property
    def ignorance(self) -> CellArray:
        """m(Ω) = Pl - Bel: how much is not known."""
        return self.masses.unknown

    @property
    def conflict(self) -> CellArray:
        """Dempster's K = (1 - e^-w)·(1 - e^-v); it only ever grows."""
        return np.expm1(-self.w) * np.expm1(-self.v)

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """The cells with N > Π, which no probability satisfies."""
        found: NDArray[np.bool_] = self.necessity > self.possibility
        return found

    @property
    def contested(self) -> CellArray:
        """2·min(m(wall), m(free)): 1 where strong evidence balances, 0 where one side has won."""
        wall, free, _ = self.masses
        return 2 * np.minimum(wall, free)

    @property
    def masses(self) -> Masses:
        """m(wall), m(free) and m(Ω)."""
        wall_side, free_side, total = self._shares()
        return Masses(
            -np.expm1(-self.w) * wall_side / total,
            -np.expm1(-self.v) * free_side / total,
            free_side * np.exp(-self.v) / total,
        )

    def _shares(self) -> tuple[CellArray, CellArray, CellArray]:
        """Return e^-v, e^-w and D = e^-w + e^-v - e^(-w-v), each over e^-min(w, v)."""
        least = np.minimum(self.w, self.v)
        wall_side, free_side = np.exp(least - self.v), np.exp(least - self.w)
        return wall_side, free_side, wall_side - free_side * np.expm1(-self.v)

    def probability(self, base_rate: float = 0.5) -> CellArray:
        """Return the normalised plausibility: logit = w - v + logit(base rate).

        Raises
        ------
        ValueError
            Unless 0 < base_rate < 1.
        """
        if not 0 < base_rate < 1:
            raise ValueError(f"base_rate, found {base_rate}, expected a number between 0 and 1")
        return _logistic(self.w - self.v + math.log(base_rate / (1 - base_rate)))

    @property
    def pignistic_logit(self) -> CellArray:
        """λ, the logit of ``pignistic``, by which cells are ranked: it never saturates."""
        logit: CellArray = _half_open(self.w) - _half_open(self.v)
        return logit

    @property
    def pignistic(self) -> CellArray:
        """m(wall) + m(Ω)/2."""
        return _logistic(self.pignistic_logit)


def _half_open(weight: CellArray) -> CellArray:
    """Return w + ln(1 - e^-w / 2)."""
    found: CellArray = weight + np.log1p(-np.exp(-weight) / 2)
    return found


def _logistic(logit: CellArray) -> CellArray:
    small = np.exp(-np.abs(logit))
    found: CellArray = np.where(logit >= 0, 1.0, small) / (1 + small)
    return found


NOTHING = Readout(w=np.zeros(1), v=np.zeros(1), possibility=np.ones(1))
"""A cell of which nothing is known."""

View: TypeAlias = Callable[[Readout, float], CellArray]

VIEWS: Mapping[str, View] = MappingProxyType(
    {
        "necessity": lambda cells, _: cells.necessity,
        "possibility": lambda cells, _: cells.possibility,
        "belief": lambda cells, _: cells.belief,
        "plausibility": lambda cells, _: cells.plausibility,
        "ignorance": lambda cells, _: cells.ignorance,
        "contested": lambda cells, _: cells.contested,
        "conflict": lambda cells, _: cells.conflict,
        "mass_wall": lambda cells, _: cells.masses.wall,
        "mass_free": lambda cells, _: cells.masses.free,
        "mass_unknown": lambda cells, _: cells.masses.unknown,
        "probability": lambda cells, base_rate: cells.probability(base_rate),
        "pignistic": lambda cells, _: cells.pignistic,
        "pignistic_logit": lambda cells, _: cells.pignistic_logit,
    }
)
"""Every view by name, as a function of the cells and the base rate."""
