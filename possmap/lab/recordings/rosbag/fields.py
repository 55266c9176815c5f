"""Fields of a message by their path (``pose.pose.position.x``), and what standard ones mean."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from keyword import iskeyword
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from possmap.errors import RecordingError, did_you_mean, printable, shown
from possmap.lab.recordings.roles import Role
from possmap.lab.recordings.rosbag.bag import short

Getter: TypeAlias = Callable[[object], Any]
"""Takes a value out of a message."""

_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d{1,9})\]", re.ASCII)
_MOST_LISTED = 30


@dataclass(frozen=True, slots=True)
class Fields:
    """What the messages of one topic consist of, as one of them shows.

    place : the bag, for messages to the user. topic : its name.
    """

    place: str
    topic: str
    message: object

    def number(self, path: str) -> Getter:
        """Return what takes the number at a path out of a message; a time in seconds.

        Raises
        ------
        RecordingError
            If the message has no such field, or it is no number.
        """
        value, get = self._walk(path)
        if isinstance(value, (int, float, np.generic)):
            return get
        if _is_time(value):
            return lambda message: seconds(get(message))
        raise self._not(path, value, "a number")

    def is_time(self, path: str) -> bool:
        """Whether a time of seconds and nanoseconds stands at a path."""
        return _is_time(self._walk(path)[0])

    def numbers(self, path: str) -> Getter:
        """Return what takes the list of numbers at a path out of a message.

        Raises
        ------
        RecordingError
            If the message has no such field, or it is no list of numbers.
        """
        value, get = self._walk(path)
        if isinstance(value, np.ndarray):
            return get
        raise self._not(path, value, "a list of numbers")

    def stamp(self) -> Getter | None:
        """Return what takes the header's time [s] out of a message; None if it has none."""
        stamp = getattr(getattr(self.message, "header", None), "stamp", None)
        get = operator.attrgetter("header.stamp")
        return (lambda message: seconds(get(message))) if _is_time(stamp) else None

    def _walk(self, path: str) -> tuple[Any, Getter]:
        """Return what stands at a path, and what takes it out of a message."""
        value: Any = self.message
        steps: list[str | int] = []
        end = 0
        while end < len(path):
            step = _STEP.match(path, end)
            if step is None:
                raise self._not(path, value, "a path such as pose.pose.position.x or raw[0]")
            end = step.end()
            name, index = step.groups()
            if name is None and not isinstance(value, (list, np.ndarray)):
                raise self._not(path, value, f"a list before [{index}]")
            if name is None and int(index) >= len(value):
                expected = f"an index below {len(value)}, as in the first message"
                raise self._not(path, value, expected)
            if name is not None:
                self._check_member(path, value, name)
            one = int(index) if name is None else f"{name}_" if iskeyword(name) else name
            steps.append(one)
            value = value[one] if isinstance(one, int) else getattr(value, one)
        return value, _chained(steps)

    def _check_member(self, path: str, value: Any, name: str) -> None:
        if not is_dataclass(value):
            raise self._not(path, value, f"a message before .{name}")
        names = names_of(value)
        if name not in names:
            raise RecordingError(
                self.place,
                f"topic {printable(self.topic)}: found {shown(path)}, but {_type(value)} has the "
                f"fields {listed(names)}{did_you_mean(name, names)}",
            )

    def _not(self, path: str, value: Any, expected: str) -> RecordingError:
        if is_dataclass(value):
            what = f"{_type(value)} with the fields {listed(names_of(value))}"
        else:
            what = {list: "a list", np.ndarray: "a list", str: "a string"}.get(
                type(value), "a number"
            )
        return RecordingError(
            self.place,
            f"topic {printable(self.topic)}: {shown(path)}, found {what}, expected {expected}",
        )


def names_of(message: Any) -> list[str]:
    """Return the names of a message's fields, as its definition has them."""
    names = (one.name for one in fields(message) if not one.name.startswith("__"))
    return [name[:-1] if iskeyword(name[:-1]) else name for name in names]


def listed(names: list[str]) -> str:
    """Return names to be shown, not too many."""
    more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    return ", ".join(names[:_MOST_LISTED]) + more


def _type(message: Any) -> str:
    return short(str(getattr(message, "__msgtype__", type(message).__name__)))


def _chained(steps: list[str | int]) -> Getter:
    """Return one function of several steps: members in a row are one, for speed."""
    getters: list[Getter] = []
    names: list[str] = []
    for step in [*steps, None]:
        if isinstance(step, str):
            names.append(step)
            continue
        if names:
            getters.append(operator.attrgetter(".".join(names)))
            names = []
        if step is not None:
            getters.append(_item(step))
    if len(getters) == 1:
        return getters[0]

    def get(message: object) -> Any:
        for one in getters:
            message = one(message)
        return message

    return get


def _item(index: int) -> Getter:
    get: Callable[[Any], Any] = operator.itemgetter(index)
    return get


def _is_time(value: object) -> bool:
    return hasattr(value, "sec") and hasattr(value, "nanosec")


def seconds(time: Any) -> float:
    """Return a time of a message in seconds."""
    return float(time.sec + 1e-9 * time.nanosec)


ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
SCAN = "sensor_msgs/msg/LaserScan"
RANGE = "sensor_msgs/msg/Range"


def _pose(path: str) -> dict[Role, str]:
    return {
        "x": f"{path}.position.x",
        "y": f"{path}.position.y",
        "qx": f"{path}.orientation.x",
        "qy": f"{path}.orientation.y",
        "qz": f"{path}.orientation.z",
        "qw": f"{path}.orientation.w",
    }


POSES: Mapping[str, Mapping[Role, str]] = MappingProxyType(
    {ODOMETRY: _pose("pose.pose"), POSE: _pose("pose")}
)
"""Type -> role -> field."""

LIMITS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {SCAN: ("range_min", "range_max"), RANGE: ("min_range", "max_range")}
)
"""Type -> fields with the shortest and the longest reading that means something [m]."""
