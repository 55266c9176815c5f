"""Fields of a message by their path: ``pose.pose.position.x``, ``raw[0]``."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from keyword import iskeyword
from typing import TYPE_CHECKING, Any, TypeAlias

from possmap.errors import RecordingError, did_you_mean, printable, shown

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc

Getter: TypeAlias = Callable[[object], Any]
"""Takes a value out of a message."""

_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d{1,9})\]", re.ASCII)
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4  # rosbags.interfaces.Nodetype
_MOST_LISTED = 30


@dataclass(frozen=True, slots=True)
class Fields:
    """What the messages of one topic consist of.

    place : the bag, for messages. topic, type : names.
    known : type -> constants and fields, as a store of rosbags has them.
    """

    place: str
    topic: str
    type: str
    known: Mapping[str, tuple[Any, Sequence[tuple[str, FieldDesc]]]]

    def number(self, path: str) -> Getter:
        """Return what takes the number at a path out of a message; a time in seconds.

        Raises
        ------
        RecordingError
            If the type has no such field, or it is no number.
        """
        found, get = self._walk(path)
        if found[0] == _BASE and "string" not in str(found[1][0]):
            return get
        if self._is_time(found):
            return lambda message: _seconds(get(message))
        raise self._not(path, found, "a number")

    def is_time(self, path: str) -> bool:
        """Whether a time of seconds and nanoseconds stands at a path."""
        return self._is_time(self._walk(path)[0])

    def numbers(self, path: str) -> Getter:
        """Return what takes the list of numbers at a path out of a message.

        Raises
        ------
        RecordingError
            If the type has no such field, or it is no list of numbers.
        """
        found, get = self._walk(path)
        inner: Any = found[1][0]  # a letter, of anything but a list
        if found[0] in (_ARRAY, _SEQUENCE) and inner[0] == _BASE and inner[1][0] != "string":
            return get
        raise self._not(path, found, "a list of numbers")

    def stamp(self) -> Getter | None:
        """Return what takes the header's time [s] out of a message; None if it has none."""
        header = dict(self.known[self.type][1]).get("header")
        if header is None or header[0] != _NAME:
            return None
        stamp = dict(self.known[str(header[1])][1]).get("stamp")
        if stamp is None or not self._is_time(stamp):
            return None
        get = operator.attrgetter("header.stamp")
        return lambda message: _seconds(get(message))

    def top(self) -> str:
        """Return the fields of the type, to be shown."""
        return self._listed(self.type)

    def _walk(self, path: str) -> tuple[FieldDesc, Getter]:
        """Return what stands at a path, and what takes it out of a message."""
        at: Any = (_NAME, self.type)
        steps: list[Getter] = []
        end = 0
        while end < len(path):
            step = _STEP.match(path, end)
            if step is None:
                raise self._not(path, at, "a path such as pose.pose.position.x or raw[0]")
            end = step.end()
            name, index = step.groups()
            if name is not None:
                at = self._member(path, at, name)
                steps.append(operator.attrgetter(f"{name}_" if iskeyword(name) else name))
            else:
                if at[0] not in (_ARRAY, _SEQUENCE):
                    raise self._not(path, at, f"a list before [{index}]")
                if at[0] == _ARRAY and int(index) >= at[1][1]:
                    raise self._not(path, at, f"an index below {at[1][1]}")
                at = at[1][0]
                steps.append(_item(int(index)))
        return at, _chained(path, steps)

    def _member(self, path: str, at: Any, name: str) -> FieldDesc:
        if at[0] != _NAME:
            raise self._not(path, at, f"a message before .{name}")
        fields = dict(self.known[at[1]][1])
        if name not in fields:
            raise RecordingError(
                self.place,
                f"topic {printable(self.topic)}: found {shown(path)}, but {short(at[1])} has the "
                f"fields {self._listed(at[1])}{did_you_mean(name, fields)}",
            )
        return fields[name]

    def _is_time(self, found: FieldDesc) -> bool:
        if found[0] != _NAME:
            return False
        return {"sec", "nanosec"} <= dict(self.known[str(found[1])][1]).keys()

    def _not(self, path: str, found: Any, expected: str) -> RecordingError:
        if found[0] == _NAME:
            what = f"{short(found[1])} with the fields {self._listed(found[1])}"
        elif found[0] == _BASE:
            what = f"a {found[1][0]}"
        else:
            what = "a list"
        return RecordingError(
            self.place,
            f"topic {printable(self.topic)}: {shown(path)}, found {what}, expected {expected}",
        )

    def _listed(self, type_: str) -> str:
        names = [name for name, _ in self.known[type_][1]]
        more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
        return ", ".join(names[:_MOST_LISTED]) + more


def short(type_: str) -> str:
    """Return a type's name as people say it: ``nav_msgs/Odometry``."""
    return printable(type_.replace("/msg/", "/"))


def _chained(path: str, steps: Sequence[Getter]) -> Getter:
    """Return one function of several steps: the common shapes without a loop, for speed."""
    if all(isinstance(step, operator.attrgetter) for step in steps):
        keywords = [f"{name}_" if iskeyword(name) else name for name in path.split(".")]
        return operator.attrgetter(".".join(keywords))
    if len(steps) == 2:
        first, second = steps
        return lambda message: second(first(message))

    def get(message: object) -> Any:
        for step in steps:
            message = step(message)
        return message

    return get


def _item(index: int) -> Getter:
    def get(values: Any) -> Any:
        return values[index]

    return get


def _seconds(time: Any) -> float:
    return float(time.sec + 1e-9 * time.nanosec)
