"""How far apart one corridor's walls lie, as seen on repeated passes: drift that no truth tells.

    python tests/benchmarks/repeated_passes.py FLIGHT.json...

A pass is a stretch of a log's track of at least 5 m along one of the building's two axes. Passes
of one direction that overlap by 3 m and lie within 3 m of each other are of one corridor. In each
pass the walls on either side have a place across the corridor (the median, by length); the range
of these places over the passes is what dead reckoning has lost in between.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from possmap.core.records import PartialMap, Pose, Wall
from possmap.logs import read_log
from possmap.settings.limits import Limits

LEAST_M, OVERLAP_M, NEAR_M, BREAK_M, SIGHT_M = 5.0, 3.0, 3.0, 1.0, 2.5
ASKEW = math.radians(25)


@dataclass(frozen=True)
class Pass:
    """One pass of a corridor; lengths in metres, in the frame of the building's axes.

    axis : 0 along the first, 1 along the second. low, high : from where to where along it.
    across : where the robot was. first, last : its poses. walls : by side, where the walls are.
    """

    axis: int
    low: float
    high: float
    across: float
    first: int
    last: int
    walls: dict[int, float]


def building_axis(walls: Sequence[Wall]) -> float:
    """Return the direction that most of the walls' length has, within a quarter turn [rad]."""
    angle = np.array([math.atan2(w.y2 - w.y, w.x2 - w.x) for w in walls])
    length = np.array([math.hypot(w.x2 - w.x, w.y2 - w.y) for w in walls])
    grid = np.radians(np.arange(0, 90, 0.5))
    off = np.abs((angle[None] - grid[:, None] + math.pi / 4) % (math.pi / 2) - math.pi / 4)
    return float(grid[int(np.argmax((length * np.exp(-((off / 0.07) ** 2))).sum(axis=1)))])


def passes(log: PartialMap) -> Iterator[Pass]:
    """Yield the passes of a log, in the order of time."""
    walls = [record for record in log.records if isinstance(record, Wall)]
    turn = -building_axis(walls)
    cos, sin = math.cos(turn), math.sin(turn)

    def laid(x: float, y: float) -> tuple[float, float]:
        return x * cos - y * sin, x * sin + y * cos

    poses = [(i, *laid(r.x, r.y)) for i, r in enumerate(log.records) if isinstance(r, Pose)]
    runs = [
        (i, j, x, y, x2, y2)
        for (i, x, y), (j, x2, y2) in itertools.pairwise(poses)
        if (x, y) != (x2, y2)
    ]
    for axis in (0, 1):
        group: list[tuple[int, int, float, float, float, float]] = []
        idle = 0.0
        for run in [*runs, (-1, -1, 0.0, 0.0, math.inf, math.inf)]:
            dx, dy = run[4] - run[2], run[5] - run[3]
            ahead, aside = (dx, dy) if axis == 0 else (dy, dx)
            length = math.hypot(dx, dy)
            sign = 0.0 if not group else math.copysign(1, group[-1][4 + axis] - group[-1][2 + axis])
            along = length < math.inf and abs(math.atan2(aside, abs(ahead))) < ASKEW
            if along and (not group or ahead * sign > 0):
                group.append(run)
                idle = 0.0
                continue
            idle += length
            if idle > BREAK_M:
                found = _pass(log, group, axis, laid)
                if found is not None:
                    yield found
                group, idle = ([run], 0.0) if along else ([], 0.0)


def _pass(log, group, axis, laid):  # type: ignore[no-untyped-def]
    ends = [value for run in group for value in (run[2 + axis], run[4 + axis])]
    if not ends or max(ends) - min(ends) < LEAST_M:
        return None
    across = float(np.median([value for run in group for value in (run[3 - axis], run[5 - axis])]))
    first, last = group[0][0], group[-1][1]
    sides: dict[int, list[tuple[float, float]]] = {-1: [], 1: []}
    for record in log.records[first : last + 1]:
        if not isinstance(record, Wall):
            continue
        start, end = laid(record.x, record.y), laid(record.x2, record.y2)
        along, aside = end[axis] - start[axis], end[1 - axis] - start[1 - axis]
        place = (start[1 - axis] + end[1 - axis]) / 2
        if abs(math.atan2(aside, abs(along))) < ASKEW and abs(place - across) < SIGHT_M:
            sides[1 if place > across else -1].append((place, abs(along)))
    walls = {side: _median(seen) for side, seen in sides.items() if sum(n for _, n in seen) > 1.5}
    return Pass(axis, min(ends), max(ends), across, first, last, walls)


def _median(seen: Sequence[tuple[float, float]]) -> float:
    ordered = np.array(sorted(seen))
    so_far = np.cumsum(ordered[:, 1])
    return float(ordered[int(np.searchsorted(so_far, so_far[-1] / 2)), 0])


def corridors(found: Sequence[Pass]) -> list[list[Pass]]:
    """Return passes that belong together, of which there are at least two."""
    groups: list[list[Pass]] = []
    for one in found:
        for group in groups:
            if any(_together(one, other) for other in group):
                group.append(one)
                break
        else:
            groups.append([one])
    return [group for group in groups if len(group) > 1]


def _together(one: Pass, other: Pass) -> bool:
    overlap = min(one.high, other.high) - max(one.low, other.low)
    near = abs(one.across - other.across) < NEAR_M
    return one.axis == other.axis and overlap >= OVERLAP_M and near


def ranges_of(log: PartialMap) -> Iterator[tuple[float, int]]:
    """Yield how far apart one wall lies [m], and on how many passes it was seen."""
    for group in corridors(list(passes(log))):
        for side in (-1, 1):
            places = [one.walls[side] for one in group if side in one.walls]
            if len(places) > 1:
                yield max(places) - min(places), len(places)


def main() -> None:
    """Print the ranges of each log's corridors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", nargs="+", type=Path)
    for path in parser.parse_args().logs:
        for delivery in read_log(path, Limits()).deliveries:
            ranges = list(ranges_of(delivery.version))
            width = [value for value, _ in ranges]
            sys.stdout.write(
                f"{path.name}: {len(ranges)} walls seen on {sum(n for _, n in ranges)} passes; "
                f"range {np.mean(width):.2f} m in the mean, {np.median(width):.2f} in the median, "
                f"{max(width):.2f} at worst: {', '.join(f'{v:.2f}' for v in width)}\n"
            )


if __name__ == "__main__":
    main()
