"""An excursion as least squares need it: straight runs between nodes, and walls seen from them.

A *node* is where one run ends and the next begins; a *run* is straight, however many pieces it was
logged in. All is laid out as the estimator ``walls`` believes it, which is where refining starts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.model import ErrorModel
from possmap.core.observations import Observations
from possmap.core.records import PartialMap
from possmap.core.settings import EvidenceSettings
from possmap.core.walls import MOST_OUTLIERS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Place: TypeAlias = tuple[float, float]
"""x and y [m]."""


class Sighting(NamedTuple):
    """A piece of wall seen during a run; its middle is start + a·Δ + b·Δ⊥, Δ the run's chord.

    record : its number; run : which run of the excursion.
    normal : 0: its coordinate is that along the axes' direction; 1: across.
    side : +1 if the robot was where coordinates are larger, else -1.
    low, high : from where to where along the wall, seen from its middle [m].
    half_width : of its place as seen from the robot [m].
    """

    record: int
    run: int
    normal: int
    side: int
    a: float
    b: float
    low: float
    high: float
    half_width: float


class Frame:
    """The building's axes."""

    def __init__(self, settings: EvidenceSettings) -> None:
        self.axes = math.radians(settings.axes)
        self._cos, self._sin = math.cos(self.axes), math.sin(self.axes)

    def turned(self, place: Place) -> Place:
        """Return a place or vector of the site frame along and across the axes."""
        x, y = place
        return self._cos * x + self._sin * y, self._cos * y - self._sin * x

    def back(self, places: Floats) -> Floats:
        """Return places along and across the axes in the site frame; shape (n, 2)."""
        x, y = places.T
        return np.stack([self._cos * x - self._sin * y, self._sin * x + self._cos * y], axis=1)

    def half_back(self, halves: Floats) -> Floats:
        """Return half-widths along and across the axes in the site frame; shape (n, 2).

        What both have in common is left out.
        """
        turn = np.array([[self._cos**2, self._sin**2], [self._sin**2, self._cos**2]])
        found: Floats = np.sqrt(halves**2 @ turn)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class CutExcursion:
    """What one excursion brings to the problem; places in the frame of the building's axes.

    Attributes
    ----------
    version, model
        Its records, and the model in force.
    observations
        What walls told of its heading.
    start, start_half
        The first pose [m] and its half-widths.
    chord
        Each run as the filter lays it [m]; shape (runs, 2).
    heading_step
        How much more its direction was corrected than the turns before it told [rad].
    parts, distance
        45° turned, and metres to drift on, since the middle of the run before.
    turned_half, along_half, aligned_half
        Half-widths of ``heading_step`` [rad], of its length [m] and, of a followed run, of its
        direction [rad]; infinite: nothing is known of it.
    seen
        Directions of walls: run, how far off the axes [rad], half-width [rad]; shape (n, 3).
    sightings
        Walls seen.
    fixed
        Where somebody knew it to be: number of the pose, place and half-widths [m]; by how much
        more its heading was off than the filter corrected, with its half-width [rad], infinite if
        nobody knew; shape (n, 7).
    poses
        Of each pose the run, the shares a and b of its chord and the filter's heading error [rad];
        then, in the site's frame, place and half-widths of the filter [m]; shape (poses, 8).
    """

    version: PartialMap
    model: ErrorModel
    observations: Observations
    start: Floats
    start_half: Floats
    chord: Floats
    heading_step: Floats
    parts: Floats
    distance: Floats
    turned_half: Floats
    along_half: Floats
    aligned_half: Floats
    seen: Floats
    sightings: tuple[Sighting, ...]
    fixed: Floats
    poses: Floats
    frame: Frame

    def laid(self, nodes: Floats, variances: Floats) -> tuple[Floats, Floats]:
        """Return the places and half-widths of its poses in the site's frame [m], for its nodes.

        nodes : shape (runs + 1, 2); variances : of their x and y, shape (runs + 1, 2 or more).
        """
        run, (a, b) = self.poses[:, 0].astype(np.int64), self.poses[:, 1:3].T[..., None]
        step = nodes[run + 1] - nodes[run]
        across = np.stack([-step[:, 1], step[:, 0]], axis=1)
        places = self.frame.back(nodes[run] + a * step + b * across)
        halves = self.model.factor * np.sqrt(variances[:, :2])
        share = np.clip(a, 0.0, 1.0)
        return places, self.frame.half_back((1 - share) * halves[run] + share * halves[run + 1])

    @property
    def is_orthogonal(self) -> bool:
        """Whether the walls it saw stand along the axes."""
        return self.observations.outliers <= self.observations.seen + MOST_OUTLIERS
