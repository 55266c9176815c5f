"""One laser line of a CARMEN log: where its numbers stand, and how its laser sits on the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

LONGEST_RANGE = 80.0
"""A SICK laser that says more saw nothing [m]."""


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


def laid_out(kind: bytes, words: Sequence[bytes]) -> Layout:
    """Return how the lines of a laser are laid out, by one of them.

    Raises
    ------
    IndexError, ValueError
        If the line is cut short, or something is no number that is needed.
    """
    longest = LONGEST_RANGE
    if kind == b"ROBOTLASER1":
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
    laser, robot = poses(words, layout)
    _ = words[time_word(words, layout)]
    if not all(map(math.isfinite, (*laser, *robot))):
        raise ValueError
    return _mounted(layout, laser, robot)


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


def poses(
    words: Sequence[bytes], layout: Layout
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the laser's and the robot's pose on a laser line.

    Raises
    ------
    IndexError, ValueError
        If the line is cut short, or something is no number.
    """
    at = _pose_word(words, layout)
    lx, ly, lyaw, x, y, yaw = (float(word) for word in words[at : at + 6])
    return (lx, ly, lyaw), (x, y, yaw)


def _pose_word(words: Sequence[bytes], layout: Layout) -> int:
    """Return which word holds the first number of the poses, behind readings and remissions.

    Raises
    ------
    IndexError, ValueError
        If the line ends before it, or the count of remissions is none.
    """
    at = layout.first + layout.count
    if layout.kind != b"ROBOTLASER1":
        return at
    remissions = int(words[at])
    if remissions < 0:
        raise ValueError
    return at + 1 + remissions


def robot_at(laser: Sequence[float], layout: Layout) -> tuple[float, float, float]:
    """Return the pose of the robot that carries a laser."""
    x, y, yaw = laser
    if not math.isfinite(yaw):
        return x, y, yaw
    yaw -= math.pi * layout.behind
    cos, sin = math.cos(yaw), math.sin(yaw)
    return (
        x - cos * layout.x + sin * layout.y,
        y - sin * layout.x - cos * layout.y,
        yaw,
    )


def time_word(words: Sequence[bytes], layout: Layout) -> int:
    """Return which word holds the time of the reading; the logger's own comes behind the host.

    Raises
    ------
    IndexError, ValueError
        If the line ends before it.
    """
    after = _pose_word(words, layout) + 6
    if layout.kind == b"ROBOTLASER1":
        after += 5
    if len(words) < after + 3:
        raise IndexError
    return after
