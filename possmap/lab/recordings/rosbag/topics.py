"""The option ``--topic``: which topic of a bag is used, and which of its fields mean what."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from possmap.errors import SettingsError, did_you_mean, shown
from possmap.lab.recordings.beams import BeamColumn, SeatedAt
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.roles import ROLES

MOUNT = ("angle", "at_x", "at_y")
"""The roles that say how the sensor of a standard topic of ranges sits on the robot."""

_RANGE = "range"
_FRAMES = r"[^=,.@]+\.[^=,.@]+"
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d{1,9}\])*(\.[A-Za-z]\w*(\[\d{1,9}\])*)*", re.ASCII)


def table_of(option: str) -> Table:
    """Return the table that ``TOPIC[:ROLE=FIELD,...]`` describes.

    Roles are those of a mapping, ``range@DEGREES`` for a beam, left positive. ``angle=DEGREES``,
    ``at_x=METRES`` and ``at_y=METRES`` say how the sensor of a standard topic of ranges sits; those
    not given are 0. ``/tf:odom.base_link`` is where a frame stands in another. Without roles, the
    topic's type says what it means.

    Raises
    ------
    SettingsError
        If the option cannot be understood.
    """
    topic, colon, rest = option.partition(":")
    if not topic.strip() or (colon and not rest.strip()):
        raise SettingsError(
            f"--topic: found {shown(option)}, expected TOPIC or TOPIC:ROLE=FIELD,ROLE=FIELD"
        )
    if re.fullmatch(_FRAMES, rest):
        return Table(topic=topic.strip(), frames=rest)
    columns: dict[Any, str] = {}
    beams: list[BeamColumn] = []
    seat: dict[str, float] = {}
    seen: set[str] = set()
    for part in rest.split(",") if colon else ():
        role, equals, value = (word.strip() for word in part.partition("="))
        if not equals or not role or not value:
            raise SettingsError(f"--topic: found {shown(part.strip())}, expected ROLE=FIELD")
        if role in seen:
            raise SettingsError(f"--topic: found {shown(role)} twice, expected each role once")
        seen.add(role)
        name, at, degrees = role.partition("@")
        if at and name == _RANGE:
            beams.append(BeamColumn(column=_field(role, value), angle_deg=_radians(role, degrees)))
        elif role in MOUNT:
            seat[role] = (_radians if role == "angle" else _metres)(role, value)
        elif role in ROLES:
            columns[role] = _field(role, value)
        else:
            known = (*ROLES, f"{_RANGE}@DEGREES", *MOUNT)
            expected = f"one of {', '.join(known)}{did_you_mean(role, known)}"
            if name == _RANGE:
                expected = f"{_RANGE}@DEGREES, such as {_RANGE}@-90"
            raise SettingsError(f"--topic: ROLE, found {shown(role)}, expected {expected}")
    if seat and len(seen) > len(seat):
        raise SettingsError(
            f"--topic: found {next(iter(seat))} beside other roles, expected {', '.join(MOUNT)} "
            "alone, as a standard topic of ranges has nothing else"
        )
    angle, x, y = (seat.get(role, 0.0) for role in MOUNT)
    mount = SeatedAt(angle_deg=angle, x=x, y=y) if seat else None
    return Table(topic=topic.strip(), columns=columns, beams=tuple(beams), mount=mount)


def _field(role: str, value: str) -> str:
    if not _FIELD.fullmatch(value):
        raise SettingsError(
            f"--topic: the field of {role}, found {shown(value)}, "
            "expected a path such as pose.pose.position.x or raw[0]"
        )
    return value


def _number(role: str, text: str, most: float, expected: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) <= most:  # phrased so that NaN is refused too
        raise SettingsError(f"--topic: {shown(role)}, found {shown(text)}, expected {expected}")
    return number


def _radians(role: str, text: str) -> float:
    return math.radians(_number(role, text, 360.0, "degrees from -360 to 360, left positive"))


def _metres(role: str, text: str) -> float:
    return _number(role, text, 10.0, "metres from the robot's middle, at most 10")


def mapping_of(topics: Sequence[str]) -> Mapping:
    """Return the mapping that ``--topic`` options make together.

    Raises
    ------
    SettingsError
        If one cannot be read, or two say the same.
    """
    return Mapping(format="ros", tables=tuple(table_of(text) for text in topics))
