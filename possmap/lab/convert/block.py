"""A block of a track, converted as a whole: its poses, what was seen, and what it claims."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.lab.convert.corners import corners
from possmap.lab.convert.hits import Hits, hits, without_echoes
from possmap.lab.convert.lines import FittedWall, walls_of
from possmap.lab.convert.log import JsonRecord
from possmap.lab.convert.orthogonal import Alignment
from possmap.lab.convert.samples import Floats, Ints, Mount, Samples
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.convert.simplify import Outline, outline
from possmap.lab.convert.tally import Tally

REPEATED_M = 0.02
"""A beam whose ends both lie this near to those of the one before says nothing new."""

ENDLESS = (
    "readings of nothing in sight by sensors of which nothing says how far they see, taken to see "
    "as far as --reach"
)

MISS_WAY_M, MISS_TURN = 0.25, math.radians(15)
"""Of beams that saw nothing, one is kept for so much way or turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """What a piece of the track becomes.

    outline : its poses. seen : the sightings of each run, in order, one list less than poses.
    walls : as fitted, before they were cut into runs. strays : of each sample from the track [m].
    readings : how many ended at something within reach.
    """

    outline: Outline
    seen: list[list[JsonRecord]]
    walls: list[FittedWall]
    strays: Floats
    readings: int


def converted(
    samples: Samples,
    mounts: Sequence[Mount],
    around: Samples,
    settings: ConvertSettings,
    tally: Tally,
    claims: Claims | None = None,
    start: tuple[float, float] | None = None,
    stops: Ints | None = None,
) -> Block:
    """Convert a piece of the track.

    Parameters
    ----------
    around
        The track from before the samples until after them, for echoes.
    start
        Where the block before ended; None for the first.
    claims
        Given after the building's axes corrected the heading: which runs say so.
    stops
        Samples that get a pose in any case.
    """
    found = outline(samples, settings.tolerance, settings.turn_tolerance, start, stops)
    walls: list[FittedWall] = []
    sightings: list[tuple[int, JsonRecord]] = []
    readings = 0
    if settings.misses:
        endless = int(np.isneginf(samples.ranges[:, : len(mounts)]).sum())
        tally.add(ENDLESS, count=endless)
    for every in hits(samples, mounts, settings.reach):
        readings += int(every.seen.sum())
        if every.touched.any():
            sightings += _bumps(every.part(every.touched), samples)
            every = every.part(~every.touched)
        taken = samples.t[every.index]
        seen = without_echoes(every, taken, around, settings.echo, settings.echo_s, tally)
        passed, loose = walls_of(seen, samples, settings)
        walls += passed
        sightings += _beams(seen, loose.tolist(), samples, tally)
        if settings.misses:
            sightings += _misses(seen, samples)
    for wall in walls:
        sightings += _wall_records(wall, found, samples, claims)
    for corner in corners(walls, samples):
        at = {"x": round(corner.x, 4) + 0.0, "y": round(corner.y, 4) + 0.0}
        t = float(samples.t[corner.sample])
        sightings.append((corner.sample, {"kind": "corner", "t": t, **at, "corner": corner.kind}))
    seen_by_run = _by_run(sightings, found)
    if claims is not None:
        claims.settle(seen_by_run, found)
    return Block(found, seen_by_run, walls, found.strays(samples), readings)


def _by_run(sightings: list[tuple[int, JsonRecord]], found: Outline) -> list[list[JsonRecord]]:
    seen: list[list[JsonRecord]] = [[] for _ in range(max(1, len(found.index) - 1))]
    sightings.sort(key=lambda one: one[0])
    runs = found.run_of(np.array([index for index, _ in sightings], dtype=np.int64))
    for (_, record), run in zip(sightings, np.maximum(runs, 0).tolist(), strict=True):
        seen[run].append(record)
    return seen


def _line(kind: str, t: float, start: Sequence[float], end: Sequence[float]) -> JsonRecord:
    x, y, x2, y2 = (round(float(value), 4) + 0.0 for value in (*start, *end))
    return {"kind": kind, "t": float(t), "x": x, "y": y, "x2": x2, "y2": y2}


def _beams(
    seen: Hits, loose: Sequence[int], samples: Samples, tally: Tally
) -> Iterator[tuple[int, JsonRecord]]:
    """Yield the readings that are on no wall; repeated ones once."""
    last: Floats | None = None
    for number in loose:
        ends = np.concatenate([seen.start[number], seen.end[number]])
        if last is not None and float(np.abs(ends - last).max()) < REPEATED_M:
            tally.add("readings that repeat the one before, dropped")
            continue
        last = ends
        index = int(seen.index[number])
        yield index, _line("beam", samples.t[index], seen.start[number], seen.end[number])


def _bumps(seen: Hits, samples: Samples) -> Iterator[tuple[int, JsonRecord]]:
    """Yield what was touched, each as a wall of no length; once where it goes on."""
    last: Floats | None = None
    for index, end in zip(seen.index.tolist(), seen.end, strict=True):
        if last is None or float(np.abs(end - last).max()) >= REPEATED_M:
            yield index, {**_line("wall", samples.t[index], end, end), "followed": False}
        last = end


def _misses(seen: Hits, samples: Samples) -> Iterator[tuple[int, JsonRecord]]:
    last: tuple[float, float, float] | None = None
    for number in np.flatnonzero(~seen.seen).tolist():
        index = int(seen.index[number])
        x, y, yaw = float(samples.x[index]), float(samples.y[index]), float(samples.yaw[index])
        if (
            last is not None
            and math.hypot(x - last[0], y - last[1]) < MISS_WAY_M
            and abs(yaw - last[2]) < MISS_TURN
        ):
            continue
        last = x, y, yaw
        record = _line("beam", samples.t[index], seen.start[number], seen.end[number])
        yield index, {**record, "hit": False}


def _wall_records(
    wall: FittedWall, found: Outline, samples: Samples, claims: Claims | None
) -> Iterator[tuple[int, JsonRecord]]:
    """Yield the pieces of a wall, one for each run from which it was seen."""
    runs = found.run_of(wall.index)
    cuts = np.flatnonzero(np.diff(runs)) + 1
    for part in np.split(np.arange(len(runs)), cuts):
        first, last = int(part[0]), int(part[-1])
        # Pieces of neighbouring runs meet halfway between their readings.
        start = wall.along[first] if first == 0 else wall.along[first - 1 : first + 1].mean()
        last_one = last == len(runs) - 1
        end = wall.along[last] if last_one else wall.along[last : last + 2].mean()
        index = int(wall.index[last])
        record = _line("wall", samples.t[index], wall.point(start), wall.point(end))
        followed = claims is not None and claims.may(wall, found, int(runs[first]))
        yield index, {**record, "followed": followed}


EVERY_M = 3.0
"""A claim is worth so much way.

METHOD lets nothing move sideways on a followed run. That is true of a robot that rubs along a wall,
not of one whose heading was computed from walls: each of its runs may be some degrees off. So few
runs claim, and the heading's spread grows again behind each (docs/convert.md has the figures)."""

PARALLEL = math.radians(20)
"""A run follows a wall if their directions differ by less."""


class Claims:
    """Lets some of the runs along walls of the building's axes claim to have followed them."""

    def __init__(self, alignment: Alignment) -> None:
        self._alignment = alignment
        self._since = math.inf

    def may(self, wall: FittedWall, outline: Outline, run: int) -> bool:
        """Whether a wall tells the heading, and the run goes along it."""
        if not self._alignment.tells(wall.angle, wall.length):
            return False
        dx = float(outline.x[run + 1] - outline.x[run])
        dy = float(outline.y[run + 1] - outline.y[run])
        if not (dx or dy):
            return False
        return abs(math.remainder(math.atan2(dy, dx) - wall.angle, math.pi)) < PARALLEL

    def settle(self, seen: Sequence[Sequence[JsonRecord]], outline: Outline) -> None:
        """Take back the claims of runs that come too soon behind another's.

        Parameters
        ----------
        seen
            The sightings of each run, changed in place.
        """
        lengths = np.hypot(np.diff(outline.x), np.diff(outline.y)).tolist()
        for length, records in zip(lengths, seen, strict=False):
            self._since += length
            claims = [record for record in records if record.get("followed")]
            if claims and self._since >= EVERY_M:
                self._since = 0.0
                continue
            for record in claims:
                record["followed"] = False
