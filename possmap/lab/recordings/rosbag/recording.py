"""Bags of ROS 1 and ROS 2: topics read, messages gathered (docs/convert.md, "ROS bags")."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from possmap.errors import RecordingError, did_you_mean, printable, shown
from possmap.lab.convert.samples import Floats, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import mounts_of
from possmap.lab.recordings.join import Join
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.readings import Interpreter
from possmap.lab.recordings.recording import BRIDGED, CHUNK_ROWS, Handling, Recording
from possmap.lab.recordings.roles import PLACES, said
from possmap.lab.recordings.rosbag.bag import STUBBORN, Bag, Topic, opened, short, size_of
from possmap.lab.recordings.rosbag.covariance import Guess
from possmap.lab.recordings.rosbag.fields import (
    LIMITS,
    ODOMETRY,
    POSE,
    POSES,
    RANGE,
    SCAN,
)
from possmap.lab.recordings.rosbag.frames import TRANSFORMS, UNREADABLE, Frames, bare
from possmap.lab.recordings.rosbag.plan import TopicPlan, judged, names_fields, planned
from possmap.lab.recordings.stream import Progress

Clock: TypeAlias = Literal["header", "bag"]
"""Whose time counts: the stamp that the sensor's driver gave, or when the bag took it in."""

_UNREADABLE = "messages that cannot be read, skipped"
_UNSTAMPED = "messages stamped 0, the bag's own time taken"
_WITHOUT_FIELD = "messages without a field that is named, skipped"
_OTHER_LAYOUT = "scans of another layout or frame than the first, skipped"
_CUT = "bytes at the end of a bag that was cut short, left out; `mcap recover` may find more"
_MOST_LISTED = 20


def open_bag(
    path: Path,
    wanted: Sequence[float],
    mapping: Mapping | None,
    clock: Clock = "header",
    handling: Handling = BRIDGED,
) -> Recording:
    """Open a ROS 1 bag, a file of a ROS 2 bag, or a ROS 2 bag's folder.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    mapping
        Topics and their fields; a table without any is of a standard type. None: the only topic
        with the place, and every topic with ranges.
    clock
        Whose time counts where a message has both.

    Raises
    ------
    RecordingError
        If it is no bag, is damaged, or has not the topics and fields that are needed.
    """
    with opened(path) as bag:
        topics = bag.topics()
        if mapping is None:
            mapping = Mapping(format="ros", tables=_found(bag, topics))
        named = [_named(path, table, topics) for table in mapping.tables]
        _check_mounted(path, mapping.tables, named)
        frames = _frames(bag, topics, mapping.tables, named)
        plans = [
            planned(bag, topic, table, mapping, wanted, clock == "header", frames)
            for topic, table in zip(named, mapping.tables, strict=True)
        ]
    _check_looking(path, plans)
    unreadable = frames.unreadable
    fault = replace(mapping, tables=tuple(plan.table for plan in plans)).fault()
    if fault is not None:
        raise RecordingError(
            str(path),
            f"{fault}; the bag has {_listed(topics.values())}; "
            "name what is to be used, each with --topic TOPIC",
        )
    used = [plan for plan in plans if plan.beams or set(plan.roles) - {"t"}]
    whole = replace(mapping, tables=tuple(plan.table for plan in used))
    size = size_of(path)
    widths, mounts = mounts_of([plan.beams for plan in used])

    def samples(tally: Tally, progress: Progress | None) -> Iterator[Samples]:
        join = Join(str(path), whole, widths, tally)
        tally.add(UNREADABLE, f"{path} /tf", unreadable)
        gatherers = [_Gatherer(path, plan, tally, handling) for plan in used]
        total = max(1, sum({plan.topic.name: plan.topic.count for plan in used}.values()))
        told, guess = 0, Guess()
        with opened(path, again=True) as bag:
            if bag.left_out is not None:
                tally.add(_CUT, str(path), bag.left_out)
            for count in _gathered(bag, gatherers):
                for number, gatherer in enumerate(gatherers):
                    gatherer.hand_to(join, number)
                for part in join.samples():
                    guess.drive(part)
                    yield part
                if progress is not None:
                    now = min(size, size * count // total)
                    progress(now - told)
                    told = now
        for gatherer in gatherers:
            gatherer.finish()
        for part in join.samples(last=True):
            guess.drive(part)
            yield part
        for gatherer in gatherers:
            suggested = guess.words(gatherer.first, gatherer.last)
            if suggested:
                tally.note(suggested)

    unused = [one for plan in used for one in plan.table.beams if one not in plan.beams]
    return Recording(path.name, mounts, samples, size, tuple(one.angle for one in unused))


class _Gatherer:
    """Takes rows of one table out of messages, until they are looked at together."""

    def __init__(self, path: Path, plan: TopicPlan, tally: Tally, handling: Handling) -> None:
        self.plan = plan
        self.rows: list[list[float]] = []
        self._name = f"{path} {printable(plan.topic.name)}"
        self.first: object = None
        self.last: object = None
        self._number = 0
        self._failed = 0
        self._tally = tally
        for note in plan.seat.notes if plan.seat else ():
            tally.add(note, self._name)
        self._told = Interpreter(self._name, plan.table, plan.mapping, plan.beams, tally, handling)
        self.finish = self._told.finish

    def take(self, stamp: int, data: bytes) -> None:
        """Take in a message: the bag's time [ns], and its bytes.

        Raises
        ------
        RecordingError
            If too many in a row cannot be read.
        """
        plan = self.plan
        self._number += 1
        try:
            message = plan.decode(data)
        except Exception as error:  # of rosbags alone: damaged bytes can lead it anywhere
            self._failed += 1
            self._skipped(_UNREADABLE)
            if self._failed == STUBBORN:
                raise RecordingError(
                    f"{self._name}:{self._number}",
                    f"{STUBBORN} messages in a row that cannot be read, "
                    f"expected {short(plan.topic.type)}",
                ) from error
            return
        self._failed = 0
        self.first = self.first or message
        self.last = message
        try:
            rows = plan.rows(message, stamp * 1e-9)
        except IndexError:  # a list may be shorter than in the first message
            self._skipped(_WITHOUT_FIELD)
            return
        if rows is None:
            self._skipped(_OTHER_LAYOUT)
            return
        self.rows += [[self._number, *row] for row in rows]

    def hand_to(self, join: Join, table: int) -> None:
        """Give the rows gathered to a join, as the readings of its table."""
        if not self.rows:
            return
        block: Floats = np.array(self.rows, dtype=np.float64)
        self.rows = []
        plan = self.plan
        end = 2 + len(plan.roles)
        columns = dict(zip(plan.roles, block[:, 2:end].T, strict=True))
        columns.setdefault("t", block[:, 1])
        ranges = longest = None
        if plan.beams:
            ranges = block[:, end + 2 * plan.limited :]
            if plan.limited:
                limits = block[:, end : end + 2]
                ranges, longest = judged(ranges, limits, plan.topic.type), limits[:, 1:]
        if plan.unstamped:
            first = f"{self._name}:{int(block[0, 0])}"
            self._tally.add(_UNSTAMPED, first, len(block))
        join.feed(table, self._told.read(columns, ranges, block[:, 0], longest))

    def _skipped(self, what: str) -> None:
        self._tally.add(what, f"{self._name}:{self._number}")


def _gathered(bag: Bag, gatherers: Sequence[_Gatherer]) -> Iterator[int]:
    """Yield how many messages were read, whenever as many rows are gathered as are kept."""
    by_connection: dict[int, list[_Gatherer]] = {}
    for gatherer in gatherers:
        for one in gatherer.plan.topic.ids:
            by_connection.setdefault(one, []).append(gatherer)
    count = waiting = 0
    for connection, stamp, data in bag.messages(by_connection.keys()):
        for gatherer in by_connection[connection]:
            gatherer.take(stamp, data)
            waiting += 1
        count += 1
        if waiting >= CHUNK_ROWS:
            yield count
            waiting = 0
    yield count


def _found(bag: Bag, topics: dict[str, Topic]) -> tuple[Table, ...]:
    """Return tables of the standard topics that a bag has."""
    path = bag.path
    by_type: dict[str, list[Topic]] = {}
    for topic in topics.values():
        if topic.count:
            by_type.setdefault(topic.type, []).append(topic)
    places = by_type.get(ODOMETRY) or by_type.get(POSE) or []
    scans, finders = by_type.get(SCAN, []), by_type.get(RANGE, [])
    if not places:
        advice = "say where the place is with --topic TOPIC:x=FIELD,y=FIELD"
        moving = [one for type_ in TRANSFORMS for one in by_type.get(type_, [])]
        frames = Frames(bag, moving, None).choices()
        if frames:
            options = [f"{moving[-1].name}:{frames[0]}", *(one.name for one in (*scans, *finders))]
            advice = (
                f"the place may stand in its transforms, which move {', '.join(frames[:5])}: "
                + " ".join(f"--topic {printable(one)}" for one in options)
            )
        raise RecordingError(
            str(path),
            f"no topic of {short(ODOMETRY)} or {short(POSE)}; the bag has "
            f"{_listed(topics.values())}; {advice}",
        )
    for several in (places, scans):
        if len(several) > 1:
            raise RecordingError(
                str(path),
                f"{len(several)} topics of {short(several[0].type)}, {_listed(several)}, expected "
                "one; name what is to be used, place and ranges, each with --topic TOPIC",
            )
    return tuple(Table(topic=topic.name) for topic in (*places, *scans, *finders))


def _named(path: Path, table: Table, topics: dict[str, Topic]) -> Topic:
    topic = topics.get(table.source)
    if topic is None and not table.source and len(topics) == 1:
        (topic,) = topics.values()
    if topic is None:
        raise RecordingError(
            str(path),
            f"topic {shown(table.source)} is missing, the bag has {_listed(topics.values())}"
            f"{did_you_mean(table.source, topics)}",
        )
    if not topic.count:
        raise RecordingError(str(path), f"topic {shown(topic.name)} has no messages")
    return topic


def _check_mounted(path: Path, tables: Iterable[Table], topics: Iterable[Topic]) -> None:
    """Refuse mounts of topics that are no standard ones of ranges."""
    for table, topic in zip(tables, topics, strict=True):
        if table.mount is not None and (topic.type not in LIMITS or names_fields(table)):
            raise RecordingError(
                str(path),
                f"topic {printable(topic.name)}: found {short(topic.type)} with a mount (angle, "
                f"at_x, at_y), expected {' or '.join(map(short, LIMITS))}",
            )


def _check_looking(path: Path, plans: Sequence[TopicPlan]) -> None:
    """Refuse several range finders of which one does not say where it looks."""
    seats = [(plan.topic, plan.seat) for plan in plans if plan.seat and plan.topic.type == RANGE]
    if len(seats) > 1 and not all(seat.sure for _, seat in seats):
        raise RecordingError(
            str(path),
            f"{len(seats)} topics of {short(RANGE)}, {_listed(topic for topic, _ in seats)}; say "
            "where each looks, with --topic TOPIC:angle=DEGREES, and name the place's topic as "
            "well",
        )


def _frames(
    bag: Bag, topics: dict[str, Topic], tables: Sequence[Table], named: Sequence[Topic]
) -> Frames:
    """Return the bag's frames, with the topic that has the robot's place."""
    for table, topic in zip(tables, named, strict=True):
        if said(PLACES, table.columns) or (topic.type in POSES and not names_fields(table)):
            return Frames(bag, list(topics.values()), topic)
        if table.frames is not None:
            body = bare(table.frames.partition(".")[2])
            return Frames(bag, list(topics.values()), None, body)
    return Frames(bag, list(topics.values()), None)


def _listed(topics: Iterable[Topic]) -> str:
    names = [f"{printable(topic.name)} ({short(topic.type)})" for topic in topics]
    more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    return (", ".join(names[:_MOST_LISTED]) or "no topics") + more
