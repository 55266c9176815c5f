"""Helpers of the tests: bags of ROS 1 and ROS 2, written with rosbags."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

START_S = 1_000
"""When the recordings begin, by the stamps of the sensors [s]; the bag's own time is 5 s later."""

BAG_LATER_S = 5

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
SCAN = "sensor_msgs/msg/LaserScan"
RANGE = "sensor_msgs/msg/Range"
TF = "tf2_msgs/msg/TFMessage"
TF_TEXT = "geometry_msgs/TransformStamped[] transforms\n"
RAW = "robots/msg/Raw"
RAW_TEXT = "std_msgs/Header header\nfloat32[] raw\nfloat32[3] fixed\nstring from\n"

Message = tuple[str, int, Any]
"""Topic, the bag's time [ns], the message."""

Transform = tuple[str, str, tuple[float, float, float], tuple[float, float, float, float]]
"""Parent, child, where the child sits [m], how it is turned (a quaternion x, y, z, w)."""


class Words:
    """Makes messages of one ROS."""

    def __init__(self, ros: int) -> None:
        self.ros = ros
        self.store: Typestore = get_typestore(
            Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_KILTED
        )
        self.store.register(get_types_from_msg(RAW_TEXT, RAW))
        if TF not in self.store.fielddefs:
            self.store.register(get_types_from_msg(TF_TEXT, TF))

    def new(self, type_: str, **given: Any) -> Any:
        """Return a message; what is not given is zero."""
        values = {}
        for name, desc in self.store.fielddefs[type_][1]:
            attribute = f"{name}_" if name in ("from",) else name
            values[attribute] = given.get(name, self._zero(desc))
        return self.store.types[type_](**values)

    def _zero(self, desc: Any) -> Any:
        kind, inner = desc
        if kind == 1:
            return "" if inner[0] == "string" else 0
        if kind == 2:
            return self.new(inner)
        size = inner[1] if kind == 3 else 0
        return np.zeros(size, dtype=inner[0][1][0])

    def header(self, t: float | None, frame: str = "") -> Any:
        """Return a header stamped t seconds after the start; None: stamped 0."""
        ns = 0 if t is None else round((START_S + t) * 1e9)
        time = self.new("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self.new("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def pose(self, x: float, y: float, yaw: float) -> Any:
        """Return geometry_msgs/Pose."""
        return self.new(
            "geometry_msgs/msg/Pose",
            position=self.new("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=self.new(
                "geometry_msgs/msg/Quaternion",
                x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2),
            ),
        )  # fmt: skip

    def odometry(
        self, t: float | None, x: float, y: float = 0.0, yaw: float = 0.0, body: str = ""
    ) -> Any:
        """Return nav_msgs/Odometry."""
        held = self.new("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(x, y, yaw))
        return self.new(ODOMETRY, header=self.header(t), pose=held, child_frame_id=body)

    def stamped(self, t: float | None, x: float, y: float = 0.0, yaw: float = 0.0) -> Any:
        """Return geometry_msgs/PoseStamped."""
        return self.new(POSE, header=self.header(t), pose=self.pose(x, y, yaw))

    def scan(
        self,
        t: float | None,
        ranges: Sequence[float],
        low: float = 0.1,
        high: float = 10.0,
        frame: str = "",
    ) -> Any:
        """Return sensor_msgs/LaserScan all around, from -180 degrees on."""
        return self.new(
            SCAN,
            header=self.header(t, frame),
            angle_min=-math.pi,
            angle_max=math.pi,
            angle_increment=2 * math.pi / len(ranges),
            range_min=low,
            range_max=high,
            ranges=np.array(ranges, dtype=np.float32),
        )

    def range(
        self, t: float | None, value: float, low: float = 0.1, high: float = 2.0, frame: str = ""
    ) -> Any:
        """Return sensor_msgs/Range."""
        header = self.header(t, frame)
        return self.new(RANGE, header=header, min_range=low, max_range=high, range=value)

    def transforms(self, *given: Transform, t: float = 0.0) -> Any:
        """Return tf2_msgs/TFMessage."""
        found = []
        for parent, child, at, turn in given:
            transform = self.new(
                "geometry_msgs/msg/Transform",
                translation=self.new(
                    "geometry_msgs/msg/Vector3", **dict(zip("xyz", at, strict=True))
                ),
                rotation=self.new(
                    "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))
                ),
            )
            found.append(
                self.new(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(t, parent),
                    child_frame_id=child,
                    transform=transform,
                )
            )
        return self.new(TF, transforms=found)

    def raw(self, t: float | None, *values: float) -> Any:
        """Return a message of a type that nobody else has."""
        numbers = np.array(values, dtype=np.float32)
        return self.new(RAW, header=self.header(t), raw=numbers)


WORDS = {1: Words(1), 2: Words(2)}

FORMATS = ("bag", "db3", "mcap", "folder")


def words_of(form: str) -> Words:
    """Return what makes the messages of a format."""
    return WORDS[1 if form == "bag" else 2]


def bag_ns(t: float) -> int:
    """Return the bag's own time of what was seen t seconds after the start."""
    return round((START_S + BAG_LATER_S + t) * 1e9)


def write_bag(
    folder: Path,
    form: str,
    messages: Iterable[Message],
    compression: str = "",
    topics: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write a bag, and return what is to be opened.

    form : of FORMATS. compression : ``bz2``, ``lz4``; ``file``, ``message``, ``storage``.
    topics : with their types, without messages.
    """
    words = words_of(form)
    if form == "bag":
        path = folder / "flight.bag"
        writer: Any = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
        write = words.store.serialize_ros1
    else:
        path = folder / "flight"
        plugin = StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
        write = words.store.serialize_cdr
    with writer:
        known = {
            topic: writer.add_connection(topic, type_, typestore=words.store)
            for topic, type_ in topics
        }
        for topic, stamp, message in messages:
            if isinstance(message, tuple):
                type_, data = message
            else:
                type_, data = message.__msgtype__, write(message, message.__msgtype__)
            if topic not in known:
                known[topic] = writer.add_connection(topic, type_, typestore=words.store)
            writer.write(known[topic], stamp, data)
    if form in ("db3", "mcap"):
        return path / f"flight.{form}"
    return path
