"""The standard messages of robots: what their fields mean (docs/convert.md, "ROS bags")."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from possmap.lab.convert.samples import Floats
from possmap.lab.convert.tally import Tally

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
SCAN = "sensor_msgs/msg/LaserScan"
RANGE = "sensor_msgs/msg/Range"


def _pose(path: str) -> dict[str, str]:
    places = {axis: f"{path}.position.{axis}" for axis in "xy"}
    return places | {f"q{axis}": f"{path}.orientation.{axis}" for axis in "xyzw"}


POSES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {ODOMETRY: _pose("pose.pose"), POSE: _pose("pose")}
)
"""Type -> role -> field."""

LIMITS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {SCAN: ("range_min", "range_max"), RANGE: ("min_range", "max_range")}
)
"""Type -> fields with the shortest and the longest reading that means something [m]."""


def judged(ranges: Floats, limits: Floats, type_: str, tally: Tally) -> Floats:
    """Return the readings of standard messages: NaN where one is none, infinity for nothing seen.

    As REP 117 has it, +infinity says that nothing was in sight, and -infinity, NaN and whatever is
    out of limits say nothing. A longest reading is the way of many drivers to say infinity.

    ranges : (n, k) [m]. limits : (n, 2), as LIMITS has them [m].
    """
    low, high = limits[:, :1], limits[:, 1:]
    nothing = np.isposinf(ranges) | (ranges >= high if type_ == RANGE else ranges == high)
    sound = (ranges >= low) & (ranges <= high) & ~nothing
    tally.add("readings that mean nothing, dropped", count=int((~sound & ~nothing).sum()))
    return np.where(nothing, math.inf, np.where(sound, ranges, math.nan))
