"""Recordings made up for tests: a track, walls around it, and what beams read of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from possmap.lab.convert.samples import Floats, Mount, Samples

Wall = tuple[float, float, float, float]

SIDES = (Mount(-math.pi / 2), Mount(0.0), Mount(math.pi / 2))


def samples(
    x: Sequence[float] | NDArray[np.floating[Any]],
    y: Sequence[float] | NDArray[np.floating[Any]],
    yaw_deg: Sequence[float] | NDArray[np.floating[Any]] | None = None,
    ranges: Floats | None = None,
    t: Sequence[float] | NDArray[np.floating[Any]] | None = None,
) -> Samples:
    """Return samples of places [m]; the body looks where it goes, ten times a second."""
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if yaw_deg is None:
        dx, dy = np.diff(xs, append=xs[-1]), np.diff(ys, append=ys[-1])
        yaw = np.unwrap(np.arctan2(dy, dx))
        yaw[-1:] = yaw[-2:-1] if len(yaw) > 1 else 0.0
    else:
        yaw = np.radians(np.asarray(yaw_deg, dtype=float))
    return Samples(
        np.arange(len(xs)) / 10 if t is None else np.asarray(t, dtype=float),
        xs,
        ys,
        yaw,
        np.full((len(xs), 0), np.nan) if ranges is None else ranges,
    )


def drive(
    corners: Sequence[tuple[float, float]], walls: Sequence[Wall], step: float = 0.05
) -> Samples:
    """Return a drive from corner to corner that turns on the spot, seeing walls to its sides."""
    x, y, yaw = [corners[0][0]], [corners[0][1]], []
    heading = 0.0
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        wanted = math.atan2(y1 - y0, x1 - x0)
        turn = math.remainder(wanted - heading, 2 * math.pi)
        for share in np.linspace(0, 1, 1 + int(abs(turn) / math.radians(10)))[1:]:
            yaw.append(heading + share * turn)
            x.append(x[-1])
            y.append(y[-1])
        heading += turn
        count = max(1, round(math.hypot(x1 - x0, y1 - y0) / step))
        for k in range(1, count + 1):
            yaw.append(heading)
            x.append(x0 + (x1 - x0) * k / count)
            y.append(y0 + (y1 - y0) * k / count)
    yaw.append(heading)
    ranges = [
        [seen(a, b, c + mount.angle, walls) for mount in SIDES]
        for a, b, c in zip(x, y, yaw, strict=True)
    ]
    return samples(x, y, np.degrees(yaw), np.array(ranges))


def seen(x: float, y: float, angle: float, walls: Sequence[Wall]) -> float:
    """Return how far it is to the nearest wall [m], minus infinity if there is none."""
    cos, sin = math.cos(angle), math.sin(angle)
    nearest = math.inf
    for x0, y0, x1, y1 in walls:
        dx, dy = x1 - x0, y1 - y0
        cross = cos * dy - sin * dx
        if abs(cross) > 1e-12:
            along = ((x0 - x) * dy - (y0 - y) * dx) / cross
            share = ((x0 - x) * sin - (y0 - y) * cos) / cross
            if along > 0 and 0 <= share <= 1:
                nearest = min(nearest, along)
    return nearest if nearest < math.inf else -math.inf
