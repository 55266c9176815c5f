"""What a mission brought: distances, fates, and how much of the building the host has heard of."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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
    """What became of a mission, as ``summary.json`` holds it.

    home, lost : how many excursions were.
    records_known_of_lost : those that the host has from others.
    explored : share of the walls' length that the host has heard of.
    """

    excursions: tuple[Outing, ...]
    home: int
    lost: int
    meetings: int
    records_known_of_lost: int
    explored: float


def summarise(mission: Mission) -> Summary:
    """Look back at a mission that is over."""
    ended = in_order(mission)
    known = host_knows(ended)
    outings = tuple(_outing(one, mission.world, known) for one in ended)
    lost = [outing.known for outing in outings if outing.fate == "lost"]
    share = round(explored(mission.world, ended, known), 4)
    home = len(outings) - len(lost)
    return Summary(outings, home, len(lost), len(mission.meetings), sum(lost), share)


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
    places = np.array(one.track)[:, 1:3]
    return Outing(
        robot=one.robot,
        excursion=one.excursion,
        fate=one.fate,
        why=one.why,
        minutes=round((one.ended_at - one.track[0][0]) / 60, 2),
        distance=round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 2),
        farthest=round(float(np.hypot(*(places - world.home).T).max()), 2),
        records=len(one.book.own.records),
        known=known.get(one.excursion, 0),
    )


def explored(world: World, ended: Iterable[Excursion], known: dict[str, int]) -> float:
    """Return the share of the walls' length near which the host knows a track."""
    x0, y0, x1, y1 = world.bounds
    near = np.zeros([math.ceil(side / _CELL) + 1 for side in (x1 - x0, y1 - y0)], dtype=np.bool_)
    radius = SEEN_M / _CELL
    offsets = np.arange(-math.ceil(radius), math.ceil(radius) + 1)
    disc = np.argwhere(offsets[:, None] ** 2 + offsets**2 <= radius**2) + offsets[0]
    for one in ended:
        told = one.book.own.records[: known.get(one.excursion, 0)]
        poses = sum(record["kind"] == "pose" for record in told)
        on_track = np.unique(_cells(np.array(one.track)[:poses, 1:3], (x0, y0)), axis=0)
        cells = (on_track[:, None] + disc).reshape(-1, 2)
        inside = ((cells >= 0) & (cells < near.shape)).all(axis=1)
        near[tuple(cells[inside].T)] = True
    walls = [_cells(wall.reshape(2, 2), (x0, y0)) for wall in world.walls]
    return float(near[tuple(np.concatenate(walls).T)].mean())


def _cells(places: Floats, low: tuple[float, float]) -> NDArray[np.intp]:
    """Return the cells of points along a polyline, a cell apart, shape (n, 2)."""
    points = [np.empty((0, 2))]
    for start, end in pairwise(places):
        steps = max(1, math.ceil(float(np.hypot(*(end - start))) / _CELL))
        points.append(start + (np.arange(steps + 1) / steps)[:, None] * (end - start))
    return np.rint((np.concatenate(points) - low) / _CELL).astype(np.intp)
