"""From a recording's samples to the records of its excursions: the whole way, in order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Protocol

import numpy as np

from possmap.lab.convert.block import Block, Claims, converted
from possmap.lab.convert.legs import (
    WITHOUT_FIX,
    WITHOUT_SAMPLE,
    KnownPlace,
    Laying,
    LegPiece,
    Reference,
    Start,
    legs,
)
from possmap.lab.convert.lines import FittedWall
from possmap.lab.convert.log import JsonRecord, LogBuilder
from possmap.lab.convert.orthogonal import Alignment, Bearing, Straightening
from possmap.lab.convert.samples import Floats, Mount, Samples, blinded, joined
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.convert.simplify import Strays
from possmap.lab.convert.tally import Tally

BLOCK = 4096
"""Samples that are looked at together: walls and runs do not go on beyond."""


class Sink(Protocol):
    """Takes in excursions as they come about."""

    def begin(self, leg: int) -> None:
        """Begin the log of a leg, numbered from 0."""

    def record(self, record: JsonRecord) -> None:
        """Take in the next record."""

    def end(self) -> None:
        """End the log."""


@dataclass(slots=True)
class ConvertOutcome:
    """What came of a recording.

    samples, legs, way : how many, how many, and how far they went [m].
    kinds : records by kind. followed : walls that claim it. readings : within reach.
    turned_deg : how much the headings of the logs turn in all.
    strays : of the samples from the simplified track.
    bearings : fitted walls, for the building's axes.
    speeds : how fast it went in the middle of each piece, where it moved [m/s].
    marks : numbers of those that became fixes; one where a leg ends and the next begins is in both.
    """

    samples: int = 0
    legs: int = 0
    way: float = 0.0
    followed: int = 0
    readings: int = 0
    turned_deg: float = 0.0
    kinds: dict[str, int] = field(default_factory=dict)
    strays: Strays = field(default_factory=Strays)
    bearings: list[Bearing] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    marks: set[int] = field(default_factory=set)

    @property
    def speed(self) -> float:
        """How fast it went in the middle, where it moved [m/s]; NaN if the clock stood still."""
        return median(self.speeds) if self.speeds else math.nan

    def clock(self, samples: Samples) -> None:
        """Take note of how fast a piece was driven."""
        seconds, step = np.diff(samples.t), np.hypot(np.diff(samples.x), np.diff(samples.y))
        moving = (seconds > 0) & (step > 0)
        if moving.any():
            self.speeds.append(float(np.median(step[moving] / seconds[moving])))


@dataclass(frozen=True, slots=True, kw_only=True)
class Whereabouts:
    """Where a recording begins, and what is known of its heading.

    start : of the first leg; None: where the recording has it. reference : poses for each leg.
    errors : half-widths of each leg's first pose, x, y [m] and heading [deg].
    alignment : the heading's error, from walls.
    end : what is known of where it ends; None: nothing. marks : poses that it truly had on the way.
    """

    start: Start | None = None
    reference: Reference | None = None
    errors: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alignment: Alignment | None = None
    end: KnownPlace | None = None
    marks: Reference | None = None


def convert(
    recorded: Iterable[Samples],
    mounts: Sequence[Mount],
    place: Whereabouts,
    settings: ConvertSettings,
    sink: Sink | None,
    tally: Tally,
) -> ConvertOutcome:
    """Turn a stream of samples into logs.

    Known errors are taken out, the track is cut into legs and laid where they begin, the heading
    straightened by the building's axes if these are known; then block by block the track becomes
    runs, and readings walls. Without a sink its bearings alone are of use.
    """
    outcome = ConvertOutcome()
    laying = Laying(settings.known)

    def track() -> Iterator[tuple[Samples, Floats]]:
        for samples in recorded:
            if len(samples):
                outcome.clock(samples)
                yield laying.lay(samples)

    now: _Leg | None = None
    for piece in legs(track(), settings.legs, place.start, place.reference, tally):
        if now is None or now.number != piece.leg:
            if now is not None:
                now.finish(is_last=False)
            now = _Leg(piece.leg, mounts, place, settings, sink, tally, outcome)
        now.take(piece)
    if now is not None:
        now.finish(is_last=True)
    if place.marks is not None:
        tally.add(WITHOUT_SAMPLE, count=len(place.marks.t) - len(outcome.marks))
    return outcome


class _Leg:
    """One excursion that is being converted."""

    def __init__(
        self,
        number: int,
        mounts: Sequence[Mount],
        place: Whereabouts,
        settings: ConvertSettings,
        sink: Sink | None,
        tally: Tally,
        outcome: ConvertOutcome,
    ) -> None:
        self.number = number
        self._mounts = mounts
        self._place = place
        self._settings = settings
        self._sink = sink
        self._tally = tally
        self._outcome = outcome
        self._straight = None if place.alignment is None else Straightening(place.alignment, number)
        self._claims = None if place.alignment is None else Claims(place.alignment)
        self._log = LogBuilder(place.errors)
        self._held: list[Samples] = []
        self._ways: list[Floats] = []
        self._past: list[Samples] = []
        self._end: tuple[float, float] | None = None
        self._t = 0.0
        self._way = 0.0
        outcome.legs += 1
        if sink is not None:
            sink.begin(number)

    def take(self, piece: LegPiece) -> None:
        """Take in the next samples; convert them when there are enough."""
        samples = piece.samples
        if self._straight is not None:
            samples = self._straight.lay(samples, piece.way)
        self._held.append(samples)
        self._ways.append(piece.way)
        if sum(map(len, self._held)) >= BLOCK:
            self._convert(last=False)

    def finish(self, is_last: bool) -> None:
        """Convert what is left; is_last : whether the recording ends here."""
        self._convert(last=True)
        self._fix(is_last)
        self._write(self._log.finish())
        self._outcome.way += self._way
        self._outcome.turned_deg += self._log.turned_deg
        if self._sink is not None:
            self._sink.end()

    def _fix(self, is_last: bool) -> None:
        """Write down where the leg truly ended, if that is known."""
        end, reference = self._place.end, self._place.reference
        if end is None or end.columns is not None:
            return
        at = end.place if is_last else None
        if end.place is None and reference is not None:
            found = reference.at(self._t)
            at = None if found is None else found[:2]
            self._tally.add(WITHOUT_FIX, count=found is None)
        if at is not None:
            self._log.fix(self._t, *at, end.half)

    def _convert(self, last: bool) -> None:
        samples, way = joined(self._held), np.concatenate(self._ways)
        if not last:
            cut = self._cut(samples)
            if cut is None:
                self._held, self._ways = [samples], [way]
                return
            block, block_way = samples.part(0, cut + 1), way[: cut + 1]
            self._held, self._ways = [blinded(samples.part(cut))], [way[cut:]]
        else:
            block, block_way = samples, way
        around = joined([*self._past, samples])
        marks = self._marks(block)
        found = converted(
            block, self._mounts, around, self._settings, self._tally, self._claims, self._end,
            np.array(sorted(marks), dtype=np.int64),
        )  # fmt: skip
        self._end = float(found.outline.x[-1]), float(found.outline.y[-1])
        self._told(found, block, block_way, marks)
        old = int(np.searchsorted(block.t, block.t[-1] - self._settings.echo_s))
        self._past = [block.part(old, -1)]

    def _cut(self, samples: Samples) -> int | None:
        """Return where a block can end: late, but with enough behind it to know echoes by."""
        cut = int(np.searchsorted(samples.t, samples.t[-1] - self._settings.echo_s)) - 1
        if cut < BLOCK // 2 and len(samples) < 4 * BLOCK:
            return None
        return max(cut, 1)

    def _marks(self, block: Samples) -> dict[int, int]:
        """Return which samples of a block stand for marks: those of the same time."""
        known = self._place.marks
        if known is None:
            return {}
        first, last = np.searchsorted(known.t, block.t[[0, -1]], side="right")
        first -= not self._log.begun and known.t[max(0, first - 1)] == block.t[0]
        here = range(int(first), int(last))
        at = np.searchsorted(block.t, known.t[here.start : here.stop])
        return dict(zip(at.tolist(), here, strict=True))

    def _told(self, found: Block, block: Samples, way: Floats, marks: Mapping[int, int]) -> None:
        """Hand on a block's poses and sightings; marks : number of the mark by the sample's."""
        outcome, poses = self._outcome, found.outline
        first = 1 if self._log.begun else 0  # the block before ended where this one begins
        for number in range(first, len(poses.index)):
            index = int(poses.index[number])
            self._write(
                self._log.pose(
                    float(block.t[index]),
                    float(poses.x[number]),
                    float(poses.y[number]),
                    math.degrees(float(block.yaw[index])),
                    found.seen[number - 1] if number else [],
                )
            )
            mark = marks.get(index)
            if mark is not None and self._place.marks is not None and self._place.end is not None:
                known = self._place.marks
                self._outcome.marks.add(mark)
                at = float(known.x[mark]), float(known.y[mark])
                self._log.fix(float(block.t[index]), *at, self._place.end.half)
        outcome.strays.add(found.strays[first:])
        outcome.readings += found.readings
        outcome.samples += len(found.strays) - first
        self._way, self._t = float(way[-1]), float(block.t[-1])
        for wall in found.walls:
            self._bearing(wall, way)

    def _bearing(self, wall: FittedWall, way: Floats) -> None:
        middle = int(wall.index[len(wall.index) // 2])
        self._outcome.bearings.append(
            Bearing(self.number, float(way[middle]), wall.angle, wall.length)
        )

    def _write(self, records: Iterable[JsonRecord]) -> None:
        for record in records:
            kind = record["kind"]
            self._outcome.kinds[kind] = self._outcome.kinds.get(kind, 0) + 1
            self._outcome.followed += bool(record.get("followed"))
            if self._sink is not None:
                self._sink.record(record)
