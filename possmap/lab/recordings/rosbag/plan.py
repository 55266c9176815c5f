"""How one topic of a bag is read: which rows its messages become, and what these are worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from possmap.core.ranges import LARGEST
from possmap.errors import RecordingError, printable, shown
from possmap.lab.convert.samples import Floats
from possmap.lab.recordings.beams import BeamColumn, Scan, chosen, used_beams
from possmap.lab.recordings.mapping import Mapping, Table, Units
from possmap.lab.recordings.roles import Role
from possmap.lab.recordings.rosbag.bag import Bag, Decoder, Topic, short
from possmap.lab.recordings.rosbag.fields import (
    LIMITS,
    POSES,
    RANGE,
    SCAN,
    Fields,
    Getter,
    listed,
    names_of,
)
from possmap.lab.recordings.rosbag.frames import TRANSFORMS, Frames, Seat, frame_of

Rows: TypeAlias = Callable[[Any, float], "list[list[float]] | None"]
"""Makes rows, as Plan has them, of a message and the bag's own time [s]; None where it is of
another layout, or another sensor's."""

_SAME_ANGLE = 1e-5  # [rad]


@dataclass(frozen=True, slots=True)
class TopicPlan:
    """How to read one table.

    Attributes
    ----------
    mapping
        Whose units hold for this topic.
    decode, rows
        Bytes become a message, and a message rows: the time, the value of each role, the shortest
        and longest range that mean something if it is limited, then a range for each beam.
    unstamped
        Whether the bag's time is taken although the messages have a stamp: it is 0.
    seat
        How the sensor sits, of a standard topic of ranges.
    """

    topic: Topic
    table: Table
    mapping: Mapping
    decode: Decoder
    rows: Rows
    roles: tuple[str, ...]
    beams: tuple[BeamColumn, ...] = ()
    limited: bool = False
    unstamped: bool = False
    seat: Seat | None = None


@dataclass(frozen=True, slots=True)
class _Ranges:
    """What stands in a row behind the roles.

    beams : of the ranges. getters : of the limits and of single ranges.
    listed : of a list of ranges. used, count : which of them, of how many.
    layout : of what must be as in the first message, with the values there.
    """

    beams: Sequence[BeamColumn] = ()
    getters: Sequence[Getter] = ()
    listed: Getter | None = None
    used: Sequence[int] = ()
    count: int = 0
    layout: Sequence[tuple[Getter, float]] = ()


def names_fields(table: Table) -> bool:
    """Whether a table says itself what is where, and its topic's type does not matter."""
    return bool(table.columns.keys() - {"t"} or table.beams) or table.scan is not None


def planned(
    bag: Bag,
    topic: Topic,
    table: Table,
    mapping: Mapping,
    wanted: Sequence[float],
    stamped: bool,
    frames: Frames,
) -> TopicPlan:
    """Return how to read a table; the first messages of its topic tell how long lists are.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    stamped
        Whether the header's time counts, where there is one.
    frames
        Say how the sensors sit where the table does not, and where the robot is by /tf.

    Raises
    ------
    RecordingError
        If a field is missing, or no message can be read.
    """
    decode = bag.decoder(topic)
    first = bag.first(topic, decode)
    fields = Fields(str(bag.path), topic.name, first[0])
    if topic.type in TRANSFORMS and not names_fields(table):
        poses = frames.poses(topic, table.frames)
        pose: dict[Role, str] = {"x": "", "y": "", "yaw": ""}
        plain = replace(mapping, units=Units(), clockwise=False)
        table = replace(table, columns={"t": "", **pose}, frames=None)
        return TopicPlan(topic, table, plain, decode, poses.rows, tuple(pose))
    named = names_fields(table)
    seat, ranges = None, _Ranges()
    if named:
        ranges = _named(fields, table, wanted)
    elif topic.type in POSES:
        columns: dict[Role, str] = {**table.columns, **POSES[topic.type]}
        table = replace(table, columns=columns)
    elif topic.type in LIMITS:
        at = table.mount
        seat = None if at is None else Seat(at.angle_deg, at.x, at.y)
        seat = seat or frames.seat(frame_of(first[0]), single=topic.type == RANGE)
        ranges = (_scan if topic.type == SCAN else _finder)(fields, wanted, seat)
    else:
        raise RecordingError(
            str(bag.path),
            f"topic {printable(topic.name)}: {short(topic.type)} is no type that is understood by "
            "itself, expected --topic TOPIC:ROLE=FIELD,...; it has the fields "
            f"{listed(names_of(first[0]))}",
        )
    stamp = fields.stamp() if stamped and "t" not in table.columns else None
    unstamped = stamp is not None and not any(map(stamp, first))
    # The mapping's units are for fields that it names.
    units = mapping.units if named else Units()
    told = "t" in table.columns and not fields.is_time(table.columns["t"])
    mapping = replace(mapping, units=replace(units, time=mapping.units.time if told else "s"))
    if not named:
        mapping = replace(mapping, clockwise=False)
    roles = [fields.number(path) for path in table.columns.values()]
    return TopicPlan(
        topic,
        table,
        mapping,
        decode,
        _rows(roles, ranges, seat, None if unstamped else stamp),
        tuple(table.columns),
        tuple(ranges.beams),
        not named and bool(ranges.beams),
        unstamped,
        seat,
    )


def _scan(fields: Fields, wanted: Sequence[float], seat: Seat) -> _Ranges:
    """Return what is taken of sensor_msgs/LaserScan."""
    layout = []
    for path in ("angle_min", "angle_increment"):
        get = fields.number(path)
        angle = float(get(fields.message))
        if not abs(angle) <= LARGEST:  # phrased so that NaN is refused too
            problem = f"topic {printable(fields.topic)}: {path}, found {shown(angle)} in the first "
            raise RecordingError(fields.place, f"{problem}message, expected an angle in radians")
        layout.append((get, angle))
    (_, start), (_, step) = layout
    side = -1.0 if seat.flipped else 1.0
    get = fields.numbers("ranges")
    count = len(get(fields.message))
    angles = [seat.angle + side * (start + index * step) for index in range(count)]
    used = chosen(angles, wanted, step)
    beams = [seat.beam(math.remainder(angles[index], math.tau)) for index in used]
    return _Ranges(beams, _limits(fields, SCAN), get, used, count, layout)


def _finder(fields: Fields, wanted: Sequence[float], seat: Seat) -> _Ranges:
    """Return what is taken of sensor_msgs/Range."""
    beams = [seat.beam(seat.angle) for _ in chosen([seat.angle], wanted)]
    return _Ranges(beams, [*_limits(fields, RANGE), fields.number("range")])


def _limits(fields: Fields, type_: str) -> list[Getter]:
    return [fields.number(path) for path in LIMITS[type_]]


def _named(fields: Fields, table: Table, wanted: Sequence[float]) -> _Ranges:
    """Return what is taken of the fields that a table names."""
    if table.scan is not None:
        return _list(fields, table.scan, wanted)
    beams = used_beams(table.beams, wanted)
    columns = [one.column for one in beams] + [one.servo for one in beams if one.servo]
    return _Ranges(beams, [fields.number(column) for column in columns])


def _list(fields: Fields, scan: Scan, wanted: Sequence[float]) -> _Ranges:
    get = fields.numbers(scan.column)
    count = len(get(fields.message))
    try:
        used, beams = scan.beams(count, wanted)
    except ValueError as error:
        problem = f"topic {printable(fields.topic)}: {scan.column}, {error}"
        raise RecordingError(fields.place, problem) from None
    return _Ranges(beams, (), get, used, count)


def _rows(
    roles: Sequence[Getter], ranges: _Ranges, seat: Seat | None, stamp: Getter | None
) -> Rows:
    """Return what makes a row of a message.

    Where the seat names a frame, messages of another are another sensor's.
    """
    getters = (*roles, *ranges.getters)
    get_list, count, layout = ranges.listed, ranges.count, ranges.layout
    picked = np.array(ranges.used, dtype=np.intp)
    frame = None if seat is None else seat.frame

    def rows(message: Any, bag_time: float) -> list[list[float]] | None:
        if frame is not None and frame_of(message) != frame:
            return None
        values = [bag_time if stamp is None else stamp(message)]
        values += [get(message) for get in getters]
        if get_list is not None:
            listed = get_list(message)
            if len(listed) != count:
                return None
            for get, expected in layout:
                if not abs(get(message) - expected) <= _SAME_ANGLE:
                    return None
            values += listed[picked].tolist()
        return [values]

    return rows


def judged(ranges: Floats, limits: Floats, type_: str) -> Floats:
    """Return the readings of standard messages, 0 where one means nothing.

    As REP 117 has it, +infinity says that nothing was in sight, and -infinity, NaN and whatever is
    out of limits say nothing. A longest reading is the way of many drivers to say infinity.

    ranges : (n, k) [m]. limits : shortest and longest (n, 2) [m].
    """
    low, high = limits[:, :1], limits[:, 1:]
    beyond = (ranges > high) & ~np.isposinf(ranges) & (type_ != RANGE)
    found: Floats = np.where((ranges >= low) & ~beyond, ranges, 0.0)
    return found
