"""How one topic of a bag is read: what is taken out of each message, and what it is worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from possmap.core.ranges import LARGEST
from possmap.errors import RecordingError, printable, shown
from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.mapping import Mapping, Scan, Table, Units, chosen, of_scan
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
from possmap.lab.recordings.rosbag.frames import Frames, Seat, frame_of

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
class _Ranges:
    """What stands in a row behind the roles.

    mounts : of the ranges. getters : of the limits and of single ranges.
    listed : of a list of ranges. used, count : which of them, of how many.
    layout : of what must be as in the first message, with the values there.
    """

    mounts: Sequence[Mount] = ()
    getters: Sequence[Getter] = ()
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
    decode = bag.decoder(topic)
    first = bag.first(topic, decode)
    fields = Fields(str(bag.path), topic.name, first[0])
    named = names_fields(table)
    seat, ranges = None, _Ranges()
    if named:
        ranges = _named(fields, table, wanted)
    elif topic.type in POSES:
        table = replace(table, columns={**table.columns, **POSES[topic.type]})
    elif topic.type in LIMITS:
        seat = Seat(table.mount) if table.mount is not None else None
        seat = seat or frames.seat(frame_of(first[0]), single=topic.type == RANGE)
        ranges = (_scan if topic.type == SCAN else _finder)(fields, wanted, seat)
    else:
        raise RecordingError(
            str(bag.path),
            f"topic {printable(topic.name)}: {short(topic.type)} is no type that is understood by "
            "itself, expected --topic TOPIC:ROLE=FIELD,...; it has the fields "
            f"{listed(names_of(first[0]))}",
        )
    roles = [fields.number(path) for path in table.columns.values()]
    stamp = fields.stamp() if stamped and "t" not in table.columns else None
    unstamped = stamp is not None and not any(map(stamp, first))
    # The mapping's units are for fields that it names.
    units = mapping.units if named else Units()
    told = "t" in table.columns and not fields.is_time(table.columns["t"])
    units = replace(units, time=mapping.units.time if told else "s")
    return Plan(
        topic,
        table,
        replace(mapping, units=units),
        decode,
        _row(roles, ranges, seat),
        tuple(table.columns),
        not named and bool(ranges.mounts),
        tuple(ranges.mounts),
        None if unstamped else stamp,
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
    mount, side = seat.mount, -1.0 if seat.flipped else 1.0
    scan = Scan("ranges", mount.angle + side * start, side * step, None, mount.x, mount.y)
    found = _list(fields, scan, wanted)
    mounts = [replace(one, angle=math.remainder(one.angle, math.tau)) for one in found.mounts]
    return replace(found, mounts=mounts, getters=_limits(fields, SCAN), layout=layout)


def _finder(fields: Fields, wanted: Sequence[float], seat: Seat) -> _Ranges:
    """Return what is taken of sensor_msgs/Range."""
    mounts = [seat.mount for _ in chosen([seat.mount.angle], wanted)]
    return _Ranges(mounts, [*_limits(fields, RANGE), fields.number("range")])


def _limits(fields: Fields, type_: str) -> list[Getter]:
    return [fields.number(path) for path in LIMITS[type_]]


def _named(fields: Fields, table: Table, wanted: Sequence[float]) -> _Ranges:
    """Return what is taken of the fields that a table names."""
    if table.scan is not None:
        return _list(fields, table.scan, wanted)
    used = chosen([beam.mount.angle for beam in table.beams], wanted)
    beams = [table.beams[index] for index in used]
    return _Ranges([one.mount for one in beams], [fields.number(one.column) for one in beams])


def _list(fields: Fields, scan: Scan, wanted: Sequence[float]) -> _Ranges:
    get = fields.numbers(scan.column)
    count = scan.count or len(get(fields.message))
    used, mounts = of_scan(scan, count, wanted)
    return _Ranges(mounts, (), get, used, count)


def _row(roles: Sequence[Getter], ranges: _Ranges, seat: Seat | None) -> Row:
    """Return what makes a row of a message: roles, limits, ranges.

    Where the seat names a frame, messages of another are another sensor's.
    """
    getters = (*roles, *ranges.getters)
    get_list, count, layout = ranges.listed, ranges.count, ranges.layout
    picked = np.array(ranges.used, dtype=np.intp)
    frame = None if seat is None else seat.frame

    def row(message: object) -> list[float] | None:
        if frame is not None and frame_of(message) != frame:
            return None
        values: list[float] = [get(message) for get in getters]
        if get_list is not None:
            listed: Any = get_list(message)
            if len(listed) != count:
                return None
            for get, expected in layout:
                if not abs(get(message) - expected) <= _SAME_ANGLE:
                    return None
            values.extend(listed[picked].tolist())
        return values

    return row
