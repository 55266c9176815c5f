"""The option ``--topic``: which topic of a bag is used, and which of its fields mean what."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from possmap.conversion.samples import Mount
from possmap.errors import SettingsError, did_you_mean, shown
from possmap.files.recordings.mapping import ROLES, Beam, Mapping, Table

ANGLE = "angle"
"""The role that says where a topic of sensor_msgs/Range looks; its beam has no column."""

_RANGE = "range"
_MOST_DEGREES = 360.0
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d{1,9}\])*(\.[A-Za-z]\w*(\[\d{1,9}\])*)*", re.ASCII)


def table_of(option: str) -> Table:
    """Return the table that ``TOPIC[:ROLE=FIELD,...]`` describes.

    Roles are those of a mapping, ``range@DEGREES`` for a beam, left positive, and ``angle=DEGREES``
    for the only beam of a standard range topic. Without roles, the topic's type says what it means.

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
    columns: dict[str, str] = {}
    beams: list[Beam] = []
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
            beams.append(Beam(_field(role, value), Mount(_radians(role, degrees))))
        elif role == ANGLE:
            beams.append(Beam("", Mount(_radians(role, value))))
        elif role in ROLES:
            columns[role] = _field(role, value)
        else:
            raise _unknown(role, name)
    if ANGLE in seen and len(seen) > 1:
        raise SettingsError(
            f"--topic: found {ANGLE} beside other roles, expected it alone, "
            "as a range topic has nothing else"
        )
    return Table(topic.strip(), columns, tuple(beams))


def _field(role: str, value: str) -> str:
    if not _FIELD.fullmatch(value):
        raise SettingsError(
            f"--topic: the field of {role}, found {shown(value)}, "
            "expected a path such as pose.pose.position.x or raw[0]"
        )
    return value


def _radians(role: str, text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not abs(degrees) <= _MOST_DEGREES:  # phrased so that NaN is refused too
        raise SettingsError(
            f"--topic: the angle of {shown(role)}, found {shown(text)}, "
            "expected degrees from -360 to 360, left positive"
        )
    return math.radians(degrees)


def _unknown(role: str, name: str) -> SettingsError:
    known = (*ROLES, f"{_RANGE}@DEGREES", ANGLE)
    if name == _RANGE:
        return SettingsError(
            f"--topic: ROLE, found {shown(role)}, expected {_RANGE}@DEGREES, such as {_RANGE}@-90"
        )
    return SettingsError(
        f"--topic: ROLE, found {shown(role)}, expected one of {', '.join(known)}"
        f"{did_you_mean(role, known)}"
    )


def mapping_of(topics: Sequence[str]) -> Mapping:
    """Return the mapping that ``--topic`` options make together.

    Raises
    ------
    SettingsError
        If one cannot be read, or two say the same.
    """
    return Mapping(format="ros", tables=tuple(table_of(text) for text in topics))
