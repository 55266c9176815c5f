"""The km as a range finder would tell it, for tools that know neither runs nor wall segments."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from peer_tools.carmen import Floats, Scans

STEP = 0.05
"""Metres from pose to pose: a cell, so that no cell the robot passed is left out."""

FAN = math.pi
"""The angle over which many beams spread, to the left of the robot [rad]."""

MISS = 2.0
"""What a beam reads that hits nothing, as a multiple of its reach."""

Record = dict[str, Any]


class Run(NamedTuple):
    """A straight run, and where along its left side a wall stands.

    start : x and y [m]; heading [rad]; length [m]; beside : metres from track to wall, or None.
    """

    start: tuple[float, float]
    heading: float
    length: float
    beside: float | None

    @property
    def stations(self) -> Floats:
        """Metres from the start to each pose of the run; its end is the next run's start."""
        return np.arange(0.0, self.length, STEP)

    @property
    def places(self) -> Floats:
        """Places of the poses, x and y [m]; shape (s, 2)."""
        way = np.array((math.cos(self.heading), math.sin(self.heading)))
        return np.asarray(np.array(self.start) + self.stations[:, None] * way)

    @property
    def wall_places(self) -> Floats:
        """Places of the wall beside the poses, x and y [m]; shape (s, 2)."""
        return self.places + self.to_wall

    @property
    def to_wall(self) -> Floats:
        """What lies between the track and the wall at its left [m]; shape (2,)."""
        left = np.array((-math.sin(self.heading), math.cos(self.heading)))
        return left * (self.beside or 0.0)


def runs_of(log: Record) -> Iterator[Run]:
    """Yield the runs of a possmap log: what lies between poses at different places."""
    start, wall = log["records"][0], None
    for record in log["records"][1:]:
        if record["kind"] == "wall":
            wall = record
            continue
        x, y = start["x"], start["y"]
        dx, dy = record["x"] - x, record["y"] - y
        length = math.hypot(dx, dy)
        if length > 0:
            beside = wall and ((wall["y"] - y) * dx - (wall["x"] - x) * dy) / length
            yield Run((x, y), math.atan2(dy, dx), length, beside)
            wall = None
        start = record


def beam_step(beams: int) -> float:
    """Return the angle between beams [rad]; some angle if there is one only."""
    return FAN / max(beams - 1, 1)


def scans_of(log: Record, beams: int, reach: float) -> Scans:
    """Return a scan at each pose; the beam in the middle looks to the left.

    A run's beams see the wall beside it and no other, as its robot does in the log: the km's track
    goes through walls of earlier runs.
    """
    off = (np.arange(beams) - (beams - 1) / 2) * beam_step(beams)
    places, headings, readings = [], [], []
    for run in runs_of(log):
        at = run.stations
        seen = np.full((len(at), beams), MISS * reach)
        if run.beside is not None:
            far = run.beside / np.maximum(np.cos(off), 1e-9)
            along = at[:, None] - far * np.sin(off)
            hits = (far < reach) & (along >= 0) & (along <= run.length)
            seen = np.where(hits, far, seen)
        places.append(run.places)
        headings.append(np.full(len(at), run.heading))
        readings.append(seen)
    heading = np.concatenate(headings)
    angles = heading[:, None] + math.pi / 2 + off
    return Scans(np.concatenate(places), heading, angles, np.concatenate(readings))


def with_every_sighting(log: Record) -> Record:
    """Return the log as the peers are told it: a record at each pose, and one of each hit.

    A wall's pieces lie beside the pieces of its run, so the evidence is the same in kind.
    """
    runs = runs_of(log)
    start, *others = log["records"]
    records: list[Record] = [start]
    for record in others:
        if record["kind"] == "wall":
            continue
        end = record["x"], record["y"]
        if end != (start["x"], start["y"]):
            run = next(runs)
            heading = record["heading"]
            for one, other in pairwise(np.vstack((run.places, end)).round(4).tolist()):
                if run.beside is not None:
                    records.append(_piece(one, other, run))
                records.append({"kind": "pose", "x": other[0], "y": other[1], "heading": heading})
        else:
            records.append(record)
        start = record
    return {**log, "records": [{**record, "seq": seq} for seq, record in enumerate(records)]}


def _piece(one: list[float], other: list[float], run: Run) -> Record:
    """Return the record of the wall beside a piece of its run."""
    (x, y), (x2, y2) = (np.array((one, other)) + run.to_wall).round(4).tolist()
    return {"kind": "wall", "x": x, "y": y, "x2": x2, "y2": y2, "followed": False}
