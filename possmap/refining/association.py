"""Which sightings are of one wall: by direction, side, coordinate and extent (METHOD §8)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from possmap.refining.runs import Floats, Ints

GATE = 3.0
"""Standard deviations that a sighting may lie off its wall."""
WIDEST_GATE_M = 0.6
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
class Placed:
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


@dataclass(slots=True)
class _Wall:
    """A wall as far as its sightings are gathered."""

    weight: float
    coordinate: float
    variance: float
    low: float
    high: float
    members: list[int] = field(default_factory=list)


def associate(placed: Placed) -> Ints:
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


def _gathered(order: NDArray[np.int64], placed: Placed, found: Ints) -> list[_Wall]:
    """Gather sightings of one kind into walls; note those that get none."""
    buckets: dict[int, list[_Wall]] = {}
    walls: list[_Wall] = []
    columns = (placed.coordinate, placed.low, placed.high, placed.variance, placed.noise)
    rows = zip(order.tolist(), *(column[order].tolist() for column in columns), strict=True)
    for number, at, low, high, variance, noise in rows:
        reach = GATE * math.sqrt(2 * (variance + noise))
        if reach > WIDEST_GATE_M:
            found[number] = VAGUE
            continue
        fitting: list[tuple[float, _Wall]] = []
        for bucket in range(
            math.floor((at - reach) / _BUCKET_M), math.floor((at + reach) / _BUCKET_M) + 1
        ):
            for wall in buckets.get(bucket, ()):
                total = variance + wall.variance + 2 * noise
                squared = (at - wall.coordinate) ** 2 / total
                shared = min(high, wall.high) - max(low, wall.low)
                least = min(LEAST_OVERLAP_M, (high - low) / 2, (wall.high - wall.low) / 2)
                if squared <= GATE**2 and shared >= least:
                    fitting.append((squared, wall))
        fitting.sort(key=lambda one: one[0])
        weight = 1 / (variance + noise)
        best = fitting[0][1] if fitting else None
        for squared, other in fitting[1:]:
            if squared - fitting[0][0] >= CLEARLY:
                break
            if not _are_pieces(best, other, noise):
                found[number] = AMBIGUOUS
                break
        if found[number] == AMBIGUOUS:
            continue
        if best is None:
            wall = _Wall(weight, at, variance, low, high, [number])
            walls.append(wall)
            buckets.setdefault(math.floor(at / _BUCKET_M), []).append(wall)
            continue
        joined = _Wall(weight, at, variance, low, high, [number])
        for squared, wall in fitting:
            if squared - fitting[0][0] < CLEARLY:
                buckets[math.floor(wall.coordinate / _BUCKET_M)].remove(wall)
                walls.remove(wall)
                joined = _joined(wall, joined)
        walls.append(joined)
        buckets.setdefault(math.floor(joined.coordinate / _BUCKET_M), []).append(joined)
    return walls


def _are_pieces(one: _Wall, other: _Wall, noise: float) -> bool:
    """Whether two may be pieces of one wall: side by side, and on one line as far as is known."""
    apart = (one.coordinate - other.coordinate) ** 2
    shared = min(one.high, other.high) - max(one.low, other.low)
    return shared < LEAST_OVERLAP_M and apart <= ON_LINE**2 * (
        one.variance + other.variance + 2 * noise
    )


def _joined(one: _Wall, other: _Wall) -> _Wall:
    weight = one.weight + other.weight
    return _Wall(
        weight,
        one.coordinate + other.weight / weight * (other.coordinate - one.coordinate),
        min(one.variance, other.variance),
        min(one.low, other.low),
        max(one.high, other.high),
        one.members + other.members,
    )
