"""The records of one excursion, numbered and in order: poses with what was seen between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from possmap.core.track import wrap_degrees

JsonRecord: TypeAlias = dict[str, Any]

FORWARDS_DEG, BACKWARDS_DEG = 60.0, 120.0
"""So far may the way lie off where the body looks to be driven forwards, and backwards."""

_STILL_DEG = 1.0


@dataclass(slots=True)
class _Halt:
    """A pose whose heading is not known before the next run; seen: what was seen before it."""

    t: float
    x: float
    y: float
    yaw_deg: float
    seen: list[JsonRecord]


class LogBuilder:
    """Numbers records, and gives poses their headings: the direction of travel.

    A robot that plainly drives backwards has the opposite heading: it has not turned round. At a
    standstill the heading turns from the last run's direction to the next's, the way round
    and the full turns being the body's; ``x_yaw`` keeps the body's own heading.

    Parameters
    ----------
    errors
        Half-widths of the first pose: x, y [m] and heading [deg].

    Attributes
    ----------
    poses, turned_deg
        How many were written, and by how much their headings turn in all.
    """

    def __init__(self, errors: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self._errors = errors
        self._halts: list[_Halt] = []
        self._fixes: list[JsonRecord] = []  # of the last pose
        self._direction: float | None = None
        self._backwards = False
        self._seq = 0
        self._heading: float | None = None
        self.poses = 0
        self.turned_deg = 0.0

    @property
    def begun(self) -> bool:
        """Whether there is a pose yet."""
        return bool(self.poses or self._halts)

    def pose(
        self, t: float, x: float, y: float, yaw_deg: float, seen: list[JsonRecord]
    ) -> Iterator[JsonRecord]:
        """Take in the next pose with what was seen on the way to it; yield what is settled."""
        x, y = round(x, 4) + 0.0, round(y, 4) + 0.0
        halts = self._halts
        if halts and (halts[-1].x, halts[-1].y) != (x, y):
            direction = math.degrees(math.atan2(y - halts[-1].y, x - halts[-1].x))
            off = abs(wrap_degrees(direction - (halts[-1].yaw_deg + yaw_deg) / 2))
            if not FORWARDS_DEG <= off <= BACKWARDS_DEG:  # sideways one keeps on as one did
                self._backwards = off > BACKWARDS_DEG
            yield from self._settled(direction + 180.0 * self._backwards)
        self._halts.append(_Halt(t, x, y, yaw_deg, [*self._fixes, *seen]))
        self._fixes.clear()

    def finish(self) -> Iterator[JsonRecord]:
        """Yield the rest: after the last run the robot goes on to look the way its body turned."""
        if not self._halts:
            return
        first, last = self._halts[0], self._halts[-1]
        turned = last.yaw_deg - first.yaw_deg
        before = first.yaw_deg if self._direction is None else self._direction
        yield from self._settled(before + turned, exactly=True)
        yield from map(self._numbered, self._fixes)

    def fix(self, t: float, x: float, y: float, half: float) -> None:
        """Take in where the robot truly was at its last pose [m]."""
        place = {"x": round(x, 4) + 0.0, "y": round(y, 4) + 0.0}
        self._fixes.append({"kind": "fix", "t": t, **place, "error_x": half, "error_y": half})

    def _settled(self, direction: float, exactly: bool = False) -> Iterator[JsonRecord]:
        halts, self._halts = self._halts, []
        turned = halts[-1].yaw_deg - halts[0].yaw_deg
        if self._direction is None:
            before, whole = direction - turned, turned
        else:
            before = self._direction
            whole = wrap_degrees(direction - before)
            if exactly:
                whole = turned
            else:
                whole += 360 * round((turned - whole) / 360)
        for number, halt in enumerate(halts):
            share = 1.0 if number == len(halts) - 1 else 0.0
            if abs(turned) > _STILL_DEG:
                share = (halt.yaw_deg - halts[0].yaw_deg) / turned if len(halts) > 1 else 1.0
            yield from self._written(halt, before + share * whole)
        self._direction = before + whole if exactly else direction

    def _written(self, halt: _Halt, heading_deg: float) -> Iterator[JsonRecord]:
        for record in halt.seen:
            yield self._numbered(record)
        pose: JsonRecord = {
            "kind": "pose",
            "t": halt.t,
            "x": halt.x,
            "y": halt.y,
            "heading": round(wrap_degrees(heading_deg), 2) + 0.0,
        }
        if not self.poses:
            names = ("error_x", "error_y", "error_heading")
            pose |= {k: v for k, v in zip(names, self._errors, strict=True) if v}
        self.poses += 1
        if self._heading is not None and pose["heading"] != self._heading:
            pose["turned"] = True  # the way bends: no belief was set anew here
            self.turned_deg += abs(wrap_degrees(pose["heading"] - self._heading))
        self._heading = pose["heading"]
        pose["x_yaw"] = round(wrap_degrees(halt.yaw_deg), 2) + 0.0
        yield self._numbered(pose)

    def _numbered(self, record: JsonRecord) -> JsonRecord:
        self._seq += 1
        return {"seq": self._seq - 1, **record}
