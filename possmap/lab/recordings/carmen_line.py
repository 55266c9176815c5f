"""One laser line of a CARMEN log: where its numbers stand, and how its laser sits on the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

ODOMETRY = b"ODOM"
LASERS = (b"FLASER", b"RLASER", b"ROBOTLASER1")
"""Kinds of lines with ranges and poses."""
RAW = tuple(f"RAWLASER{number}".encode() for number in range(1, 6))
"""Kinds of lines with ranges alone."""

LONGEST_RANGE = 80.0
"""A SICK laser that says more saw nothing [m]."""

_OFFSETS = {b"robot_frontlaser_offset": RAW[0], b"robot_rearlaser_offset": RAW[1]}


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things stand on the laser lines of one kind, and how that laser sits on the robot.

    count : readings. first : word of the first reading. angles : of the readings [rad].
    picked : readings used, from 0. longest : a reading this long means nothing in sight [m].
    x, y : of the laser in the robot's frame [m]. behind : whether its own pose looks back.
    """

    kind: bytes
    count: int
    first: int
    angles: tuple[float, ...]
    longest: float
    x: float = 0.0
    y: float = 0.0
    behind: bool = False
    picked: tuple[int, ...] = ()

    @property
    def has_remissions(self) -> bool:
        """Whether remissions stand behind the readings, their count before them."""
        return self.kind == b"ROBOTLASER1" or self.kind in RAW


def laid_out(kind: bytes, words: Sequence[bytes]) -> Layout:
    """Return how the lines of a laser are laid out, by one of them.

    Raises
    ------
    IndexError, ValueError
        If the line is cut short, or something is no number that is needed.
    """
    longest = LONGEST_RANGE
    if kind == b"ROBOTLASER1" or kind in RAW:
        start, field, step, farthest = _finite(words[2:6])
        first, count = 9, _count(words, 8)
        step = step or field / max(1, count - 1)
        longest = farthest if farthest > 0 else longest
    else:
        first, count = 2, _count(words, 1)
        step = math.pi / (count if count % 2 == 0 else max(1, count - 1))
        start = math.pi / 2 if kind == b"RLASER" else -math.pi / 2
    angles = tuple(start + index * step for index in range(count))
    if not all(map(math.isfinite, angles)):  # of finite numbers, but huge ones
        raise ValueError
    layout = Layout(kind, count, first, angles, longest)
    _ = words[time_word(words, layout)]
    if kind in RAW:
        return layout
    laser, robot = _poses(words, layout)
    if not all(map(math.isfinite, (*laser, *robot))):
        raise ValueError
    return _mounted(layout, laser, robot)


def mounted_by(words: Sequence[bytes]) -> dict[bytes, float]:
    """Return how far ahead of the robot's middle a raw laser sits, by a PARAM line [m]."""
    if len(words) < 3 or words[1] not in _OFFSETS:
        return {}
    try:
        offset = float(words[2])
    except ValueError:
        return {}
    return {_OFFSETS[words[1]]: offset} if abs(offset) <= 10 else {}


def _count(words: Sequence[bytes], at: int) -> int:
    count = int(words[at])
    if not 1 <= count <= len(words):
        raise ValueError
    return count


def _finite(words: Sequence[bytes]) -> list[float]:
    numbers = [float(word) for word in words]
    if not all(map(math.isfinite, numbers)):
        raise ValueError
    return numbers


def _mounted(layout: Layout, laser: Sequence[float], robot: Sequence[float]) -> Layout:
    """Return a layout that says where the laser sits on the robot, by a pose of each."""
    off_x, off_y, turn = (one - other for one, other in zip(laser, robot, strict=True))
    if math.hypot(off_x, off_y) > 1.0:  # somebody corrected the one: they tell nothing
        return replace(layout, behind=layout.kind == b"RLASER")
    cos, sin = math.cos(robot[2]), math.sin(robot[2])
    behind = math.cos(turn) < 0
    angles = layout.angles
    if behind and layout.kind == b"ROBOTLASER1":  # which does not say so otherwise
        angles = tuple(angle + math.pi for angle in angles)
    return replace(
        layout,
        x=off_x * cos + off_y * sin,
        y=off_y * cos - off_x * sin,
        behind=behind,
        angles=angles,
    )


def pose_and_time(
    words: Sequence[bytes], layout: Layout, of_laser: bool
) -> tuple[float, tuple[float, float, float]]:
    """Return a laser line's time and the robot's pose, as its own or as the laser's says it.

    Raises
    ------
    IndexError, ValueError
        If the line is cut short, or something is no number.
    """
    laser, robot = _poses(words, layout)
    t = float(words[time_word(words, layout)])
    x, y, yaw = laser
    if not of_laser:
        return t, robot
    if not math.isfinite(yaw):
        return t, laser
    yaw -= math.pi * layout.behind
    cos, sin = math.cos(yaw), math.sin(yaw)
    return t, (
        x - cos * layout.x + sin * layout.y,
        y - sin * layout.x - cos * layout.y,
        yaw,
    )


def _poses(
    words: Sequence[bytes], layout: Layout
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    at = _behind_readings(words, layout)
    lx, ly, lyaw, x, y, yaw = (float(word) for word in words[at : at + 6])
    return (lx, ly, lyaw), (x, y, yaw)


def _behind_readings(words: Sequence[bytes], layout: Layout) -> int:
    """Return which word stands behind readings and remissions.

    Raises
    ------
    IndexError, ValueError
        If the line ends before it, or the count of remissions is none.
    """
    at = layout.first + layout.count
    if not layout.has_remissions:
        return at
    remissions = int(words[at])
    if remissions < 0:
        raise ValueError
    return at + 1 + remissions


def time_word(words: Sequence[bytes], layout: Layout) -> int:
    """Return which word holds the time of the reading; the logger's own comes behind the host.

    Raises
    ------
    IndexError, ValueError
        If the line ends before it.
    """
    after = _behind_readings(words, layout)
    if layout.kind not in RAW:
        after += 11 if layout.kind == b"ROBOTLASER1" else 6
    if len(words) < after + 3:
        raise IndexError
    return after
