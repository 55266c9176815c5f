"""Which sightings are of one wall: by direction, side, coordinate and extent (METHOD §8)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from possmap.refining.runs import Floats, Ints

GATE = 3.0
"""Standard deviations that a sighting may lie off its wall."""
WIDEST_GATE_M = 3.0
"""A sighting that might be of anything so far away says nothing yet."""
CLEARLY = 4.0
"""So much larger must the χ² of the second best wall be, or neither is taken."""
ON_LINE = 2.0
"""Standard deviations that pieces of one wall may lie off each other, if a third overlaps both."""
LEAST_OVERLAP_M = 0.1
"""Two pieces of one wall share so much of it, or half of the shorter one."""

_BUCKET_M = 0.25

NONE, AMBIGUOUS, VAGUE = -1, -2, -3
"""In place of a wall: it is seen only once; two fit; its place is not known well enough."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedSightings:
    """Where sightings lie now; arrays of one length, in canonical order.

    excursion : number. kind : 2·normal + (side > 0). coordinate, low, high : [m].
    variance : of the coordinate, without the sensor's. noise : variance of the sensor's.
    """

    excursion: Ints
    kind: Ints
    coordinate: Floats
    low: Floats
    high: Floats
    variance: Floats
    noise: Floats


@dataclass(slots=True, eq=False)
class _Wall:
    """A wall as far as its sightings are gathered; one without any went into another."""

    weight: float
    coordinate: float
    variance: float
    low: float
    high: float
    members: list[int]

    @property
    def bucket(self) -> int:
        """Where it is looked for."""
        return math.floor(self.coordinate / _BUCKET_M)

    def take(self, other: _Wall) -> None:
        """Take over the sightings of another piece of the same wall."""
        self.weight += other.weight
        self.coordinate += other.weight / self.weight * (other.coordinate - self.coordinate)
        self.variance = min(self.variance, other.variance)
        self.low, self.high = min(self.low, other.low), max(self.high, other.high)
        if len(other.members) > len(self.members):
            self.members, other.members = other.members, self.members
        self.members += other.members
        other.members = []


def associate(placed: PlacedSightings) -> Ints:
    """Return the number of each sighting's wall, or why it has none.

    The surest sightings come first, those as sure in canonical order. Walls are numbered from 0.
    """
    found = np.full(len(placed.kind), NONE, dtype=np.int64)
    count = 0
    for kind in range(4):
        mine = np.flatnonzero(placed.kind == kind)
        order = mine[np.argsort(placed.variance[mine], kind="stable")]
        walls = _gathered(order, placed, found)
        for wall in walls:
            if len(wall.members) > 1:
                found[wall.members] = count
                count += 1
    return found


def _gathered(order: NDArray[np.int64], placed: PlacedSightings, found: Ints) -> list[_Wall]:
    """Gather sightings of one kind into walls; note those that get none."""
    near: dict[int, list[_Wall]] = {}  # by where they are, that not all need be asked
    walls: list[_Wall] = []
    columns = (placed.coordinate, placed.low, placed.high, placed.variance, placed.noise)
    rows = zip(order.tolist(), *(column[order].tolist() for column in columns), strict=True)
    for number, at, low, high, variance, noise in rows:
        reach = GATE * math.sqrt(2 * (variance + noise))
        if reach > WIDEST_GATE_M:
            found[number] = VAGUE
            continue
        one = _Wall(1 / (variance + noise), at, variance, low, high, [number])
        fitting: list[tuple[float, _Wall]] = []
        buckets = range(
            math.floor((at - reach) / _BUCKET_M), math.floor((at + reach) / _BUCKET_M) + 1
        )
        for bucket in buckets:
            for wall in near.get(bucket, ()):
                squared = (at - wall.coordinate) ** 2 / (variance + wall.variance + 2 * noise)
                if squared <= GATE**2 and _do_overlap(one, wall):
                    fitting.append((squared, wall))
        fitting.sort(key=lambda one: one[0])
        best = [wall for squared, wall in fitting if squared - fitting[0][0] < CLEARLY]
        if not all(_are_pieces(best[0], other, noise) for other in best[1:]):
            found[number] = AMBIGUOUS
            continue
        for wall in best:
            near[wall.bucket].remove(wall)
            one.take(wall)
        walls.append(one)
        near.setdefault(one.bucket, []).append(one)
    return walls


def _do_overlap(one: _Wall, other: _Wall) -> bool:
    shared = min(one.high, other.high) - max(one.low, other.low)
    return shared >= min(LEAST_OVERLAP_M, (one.high - one.low) / 2, (other.high - other.low) / 2)


def _are_pieces(one: _Wall, other: _Wall, noise: float) -> bool:
    """Whether two may be pieces of one wall: side by side, and on one line as far as is known."""
    apart = (one.coordinate - other.coordinate) ** 2
    shared = min(one.high, other.high) - max(one.low, other.low)
    return shared < LEAST_OVERLAP_M and apart <= ON_LINE**2 * (
        one.variance + other.variance + 2 * noise
    )
