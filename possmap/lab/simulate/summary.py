"""What a mission brought: distances, fates, and how much of the building the host has heard of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.robot import Excursion
from possmap.lab.simulate.world import Floats, World

SEEN_M = 0.6
"""A wall counts as explored if a track that the host knows comes so near to it [m]."""
_CELL = 0.1


@dataclass(frozen=True, slots=True)
class Outing:
    """One excursion, for people.

    distance : truly run [m]; farthest: from home [m]; known: records that the host has of it.
    """

    robot: str
    excursion: str
    fate: str
    why: str
    minutes: float
    distance: float
    farthest: float
    records: int
    known: int


@dataclass(frozen=True, slots=True)
class Summary:
    """What became of a mission.

    explored : share of the walls' length that the host has heard of.
    relayed : records that the host has only from others.
    """

    outings: tuple[Outing, ...]
    meetings: int
    relayed: int
    explored: float

    @property
    def home(self) -> int:
        """Excursions that came home."""
        return sum(outing.fate == "home" for outing in self.outings)


def summarise(mission: Mission) -> Summary:
    """Look back at a mission that is over."""
    ended = in_order(mission)
    known = host_knows(ended)
    outings = tuple(_outing(one, mission.world, known) for one in ended)
    relayed = sum(outing.known for outing in outings if outing.fate == "lost")
    return Summary(outings, len(mission.meetings), relayed, explored(mission.world, ended, known))


def in_order(mission: Mission) -> list[Excursion]:
    """Return all excursions in the order in which they ended."""
    every = [one for robot in mission.robots for one in robot.excursions]
    return sorted(every, key=lambda one: (one.ended_at, one.robot))


def host_knows(ended: Iterable[Excursion]) -> dict[str, int]:
    """Return how many records of each excursion reached the host, by the excursion's name."""
    known: dict[str, int] = {}
    for one in ended:
        if one.fate == "home":
            known[one.excursion] = len(one.book.own.records)
            for (_, name), held in one.book.relayed.items():
                known[name] = max(known.get(name, 0), len(held.records))
    return known


def _outing(one: Excursion, world: World, known: dict[str, int]) -> Outing:
    places = np.array([row[1:3] for row in one.track])
    steps = np.hypot(*np.diff(places, axis=0).T) if len(places) > 1 else np.zeros(0)
    away = np.hypot(places[:, 0] - world.home[0], places[:, 1] - world.home[1])
    return Outing(
        robot=one.robot,
        excursion=one.excursion,
        fate=one.fate,
        why=one.why,
        minutes=round((one.ended_at - one.track[0][0]) / 60, 2),
        distance=round(float(steps.sum()), 2),
        farthest=round(float(away.max()), 2),
        records=len(one.book.own.records),
        known=known.get(one.excursion, 0),
    )


def explored(world: World, ended: Iterable[Excursion], known: dict[str, int]) -> float:
    """Return the share of the walls' length near which the host knows a track."""
    x0, y0, x1, y1 = world.bounds
    rows, columns = (math.ceil((high - low) / _CELL) + 1 for low, high in ((y0, y1), (x0, x1)))
    near = np.zeros((rows, columns), dtype=np.bool_)
    radius = SEEN_M / _CELL
    reach = math.ceil(radius)
    offsets = np.arange(-reach, reach + 1)
    disc = np.argwhere(offsets[:, None] ** 2 + offsets**2 <= radius**2) - reach
    for one in ended:
        poses = sum(
            record["kind"] == "pose"
            for record in one.book.own.records[: known.get(one.excursion, 0)]
        )
        for place in _along(np.array([row[1:3] for row in one.track[:poses]])):
            cells = np.rint((place[::-1] - (y0, x0)) / _CELL).astype(int) + disc
            inside = ((cells >= 0) & (cells < (rows, columns))).all(axis=1)
            near[tuple(cells[inside].T)] = True
    seen = total = 0
    for wall in world.walls:
        for place in _along(wall.reshape(2, 2)):
            row, column = np.rint((place[::-1] - (y0, x0)) / _CELL).astype(int)
            seen += bool(near[row, column])
            total += 1
    return seen / total if total else 0.0


def _along(places: Floats) -> Iterator[Floats]:
    """Yield points along a polyline, a cell apart."""
    for start, end in pairwise(places):
        steps = max(1, math.ceil(float(np.hypot(*(end - start))) / _CELL))
        for k in range(steps + 1):
            yield start + k / steps * (end - start)
