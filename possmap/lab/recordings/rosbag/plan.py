"""How one topic of a bag is read: what is taken out of each message, and what it is worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from possmap.errors import RecordingError, printable, shown
from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.beams import chosen, of_scan
from possmap.lab.recordings.mapping import STANDARD_UNITS, Mapping, Scan, Table
from possmap.lab.recordings.rosbag.bag import Bag, Decoder, Topic
from possmap.lab.recordings.rosbag.fields import Fields, Getter, short
from possmap.lab.recordings.rosbag.first import first_messages
from possmap.lab.recordings.rosbag.frames import Frames, Seat, frame_of
from possmap.lab.recordings.rosbag.types import LIMITS, POSES, RANGE, SCAN

Row: TypeAlias = Callable[[object], list[float] | None]
"""What a message says, as Plan has it; None of a scan of another layout, or another sensor's."""

_SAME_ANGLE = 1e-5  # [rad]


@dataclass(frozen=True, slots=True)
class Plan:
    """How to read one table.

    Attributes
    ----------
    mapping
        Whose units hold for this topic.
    roles, limited, mounts
        What a row has: the value of each role, then the shortest and longest range that mean
        something if it is limited, then a range for each mount.
    stamp
        What takes the time out of a message; None where the bag's own counts.
    unstamped
        Whether that is so although the messages have a stamp: it is 0.
    seat
        How the sensor sits, of a standard topic of ranges.
    """

    topic: Topic
    table: Table
    mapping: Mapping
    decode: Decoder
    row: Row
    roles: tuple[str, ...]
    limited: bool
    mounts: tuple[Mount, ...]
    stamp: Getter | None
    unstamped: bool
    seat: Seat | None = None


@dataclass(frozen=True, slots=True)
class _Taken:
    """What stands in a row behind the roles.

    mounts : of the ranges. getters : with their paths, of the limits and of single ranges.
    listed : of a list of ranges. used, count : which of them, of how many.
    layout : of what must be as in the first message, with the values there.
    """

    mounts: Sequence[Mount] = ()
    getters: Sequence[tuple[str, Getter]] = ()
    listed: Getter | None = None
    used: Sequence[int] = ()
    count: int = 0
    layout: Sequence[tuple[Getter, float]] = ()


def names_fields(table: Table) -> bool:
    """Whether a table says itself what is where, and its topic's type does not matter."""
    named = table.columns.keys() - {"t"} or any(beam.column for beam in table.beams)
    return bool(named) or table.scan is not None


def planned(
    bag: Bag,
    topic: Topic,
    table: Table,
    mapping: Mapping,
    wanted: Sequence[float],
    stamped: bool,
    frames: Frames,
) -> Plan:
    """Return how to read a table; the first messages of its topic tell how long lists are.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    stamped
        Whether the header's time counts, where there is one.
    frames
        Say how the sensors sit where the table does not.

    Raises
    ------
    RecordingError
        If a field is missing, or no message can be read.
    """
    fields, decode = bag.decoder(topic)
    first = list(first_messages(bag, topic, decode))
    named = names_fields(table)
    seat = None
    if not named and topic.type in LIMITS:
        seat = _seat(topic, table, frames, first[0])
    if named:
        taken = _named(fields, first[0], table, wanted)
    elif topic.type in POSES:
        table = replace(table, columns={**table.columns, **POSES[topic.type]})
        taken = _Taken()
    elif seat is not None and topic.type == SCAN:
        taken = _standard_scan(fields, first[0], wanted, seat)
    elif seat is not None:
        taken = _standard_range(fields, wanted, seat)
    else:
        raise RecordingError(
            str(bag.path),
            f"topic {printable(topic.name)}: {short(topic.type)} is no type that is understood by "
            f"itself, expected --topic TOPIC:ROLE=FIELD,...; it has the fields {fields.top()}",
        )
    roles = [(path, fields.number(path)) for path in table.columns.values()]
    for path, get in (*roles, *taken.getters):
        _check_first(fields, path, get, first[0])
    stamp = fields.stamp() if stamped and "t" not in table.columns else None
    unstamped = stamp is not None and not any(stamp(message) for message in first)
    return Plan(
        topic,
        table,
        replace(mapping, units=_units(mapping, fields, table, named)),
        decode,
        _of_sensor(seat, _row([get for _, get in roles], taken)),
        tuple(table.columns),
        not named and bool(taken.mounts),
        tuple(taken.mounts),
        None if unstamped else stamp,
        unstamped,
        seat,
    )


def _units(mapping: Mapping, fields: Fields, table: Table, named: bool) -> MappingABC[str, str]:
    """Return whose units hold: the mapping's for fields that it names, else the standard's."""
    units = dict(mapping.units if named else STANDARD_UNITS)
    told = "t" in table.columns and not fields.is_time(table.columns["t"])
    units["time"] = mapping.units.get("time", "s") if told else "s"
    return units


def _check_first(fields: Fields, path: str, get: Getter, message: object) -> None:
    try:
        get(message)
    except IndexError:
        raise RecordingError(
            fields.place,
            f"topic {printable(fields.topic)}: {shown(path)} is behind the end of its list in the "
            "first message",
        ) from None


def _seat(topic: Topic, table: Table, frames: Frames, first: object) -> Seat:
    if table.mount is not None:
        return Seat(table.mount)
    return frames.seat(frame_of(first), single=topic.type == RANGE)


def _standard_scan(fields: Fields, first: object, wanted: Sequence[float], seat: Seat) -> _Taken:
    """Return what is taken of sensor_msgs/LaserScan."""
    layout = [
        (get, float(get(first))) for get in map(fields.number, ("angle_min", "angle_increment"))
    ]
    (_, start), (_, step) = layout
    mount, side = seat.mount, -1.0 if seat.flipped else 1.0
    scan = Scan("ranges", mount.angle + side * start, side * step, None, mount.x, mount.y)
    taken = _list(fields, first, scan, wanted)
    mounts = [replace(one, angle=math.remainder(one.angle, math.tau)) for one in taken.mounts]
    return replace(taken, mounts=mounts, getters=_limits(fields, SCAN), layout=layout)


def _standard_range(fields: Fields, wanted: Sequence[float], seat: Seat) -> _Taken:
    """Return what is taken of sensor_msgs/Range."""
    mounts = [seat.mount for _ in chosen([seat.mount.angle], wanted)]
    return _Taken(mounts, [*_limits(fields, RANGE), ("range", fields.number("range"))])


def _limits(fields: Fields, type_: str) -> list[tuple[str, Getter]]:
    return [(path, fields.number(path)) for path in LIMITS[type_]]


def _named(fields: Fields, first: object, table: Table, wanted: Sequence[float]) -> _Taken:
    """Return what is taken of the fields that a table names."""
    if table.scan is not None:
        return _list(fields, first, table.scan, wanted)
    angles = [beam.mount.angle for beam in table.beams]
    beams = [table.beams[index] for index in chosen(angles, wanted)]
    getters = [(beam.column, fields.number(beam.column)) for beam in beams]
    return _Taken([beam.mount for beam in beams], getters)


def _list(fields: Fields, first: object, scan: Scan, wanted: Sequence[float]) -> _Taken:
    get = fields.numbers(scan.column)
    _check_first(fields, scan.column, get, first)
    count = scan.count or len(get(first))
    used, mounts = of_scan(scan, count, wanted)
    return _Taken(mounts, (), get, used, count)


def _of_sensor(seat: Seat | None, row: Row) -> Row:
    """Return what makes rows of the messages of one sensor alone, if its frame tells it."""
    frame = None if seat is None else seat.frame
    if frame is None:
        return row
    return lambda message: row(message) if frame_of(message) == frame else None


def _row(roles: Sequence[Getter], taken: _Taken) -> Row:
    """Return what makes a row of a message: roles, limits, ranges."""
    getters = (*roles, *(get for _, get in taken.getters))
    listed, count, layout = taken.listed, taken.count, taken.layout
    if listed is None:
        return lambda message: [get(message) for get in getters]
    picked = np.array(taken.used, dtype=np.intp)

    def row(message: object) -> list[float] | None:
        ranges = listed(message)
        if len(ranges) != count:
            return None
        for get, expected in layout:
            if not abs(get(message) - expected) <= _SAME_ANGLE:
                return None
        values: list[float] = [get(message) for get in getters]
        values.extend(ranges[picked].tolist())
        return values

    return row
