"""The ``.mcap`` export: the map and the tracks as ROS 2 messages, for nav2, Foxglove and Rerun."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from possmap.errors import OutputError
from possmap.exports.job import A_PART, Job, library
from possmap.exports.ros_map import UNKNOWN, percent

FRAME_ID = "map"
MOST = 10**8
"""Cells of a map: it is one message, and held whole."""

_NOT_OF_A_TOPIC = re.compile(r"[^A-Za-z0-9_]")


def write_mcap(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write ``/map``, a nav_msgs/OccupancyGrid, and a nav_msgs/Path for each excursion.

    ``/possmap`` says in a std_msgs/String what the file is of.

    Paths are named ``/tracks/ROBOT/EXCURSION``, with ``_`` for what a topic may not hold. All is
    written at time 0, so that one grid gives one set of bytes; poses have times of their own.
    Whoever listens late gets it, too: topics are latched.

    Raises
    ------
    OutputError
        If rosbags is not installed, or the map is too large for a message.
    """
    rows, columns = job.window.shape
    if job.window.cells > MOST:
        raise OutputError(
            f"{job.name}: {rows} × {columns} cells, expected at most {MOST:,}; {A_PART}"
        )
    library(job, "rosbags", "ros")
    rosbag2, typesys = (library(job, f"rosbags.{name}", "ros") for name in ("rosbag2", "typesys"))
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    make = partial(_made, types.types)
    with TemporaryDirectory(prefix="possmap-") as folder:
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(Path(folder, "bag"), version=9, storage_plugin=plugin) as bag:
            connections: dict[str, Any] = {}
            for topic, message in _messages(job, make):
                kind = message.__msgtype__
                if topic not in connections:  # two names may become one
                    connections[topic] = bag.add_connection(
                        topic, kind, typestore=types, offered_qos_profiles=[_latched(job)]
                    )
                bag.write(connections[topic], 0, types.serialize_cdr(message, kind))
        (written,) = Path(folder, "bag").glob("*.mcap")
        with written.open("rb") as source:
            shutil.copyfileobj(source, streams[0])


Make = Callable[..., Any]
"""Makes a message: its type without ``msg``, and its fields in their order."""


def _made(types: Any, kind: str, *fields: Any) -> Any:
    return types[kind.replace("/", "/msg/")](*fields)


def _messages(job: Job, make: Make) -> Iterator[tuple[str, Any]]:
    """Yield topics and messages: the map, then the tracks in the order of the ledger."""
    x, y = job.origin
    rows, columns = job.window.shape
    cells = job.filled(job.window, partial(percent, job), UNKNOWN, np.int8)
    about = make(
        "nav_msgs/MapMetaData", _time(make, 0.0), job.grid.resolution, columns, rows,
        _pose(make, x, y, 0.0),
    )  # fmt: skip
    facts = job.comments(job.thresholds()).encode("ascii", "replace").decode()
    yield "/possmap", make("std_msgs/String", facts)
    yield "/map", make("nav_msgs/OccupancyGrid", _header(make, 0.0), about, cells.ravel())
    for outing in job.outings():
        names = (_NOT_OF_A_TOPIC.sub("_", name) for name in (outing.robot, outing.excursion))
        poses = [
            make(
                "geometry_msgs/PoseStamped",
                _header(make, record.t or 0.0),
                _pose(make, at.x, at.y, math.radians(at.heading_deg or 0.0)),
            )
            for record, at in outing.poses
        ]
        if poses:
            # A name of a topic does not begin with a digit.
            topic = "/tracks/" + "/".join(f"_{one}" if one[0].isdigit() else one for one in names)
            yield topic, make("nav_msgs/Path", _header(make, 0.0), poses)


def _time(make: Make, seconds: float) -> Any:
    whole, part = divmod(round(max(0.0, min(seconds, 2.0**31 - 1)) * 1e9), 10**9)
    return make("builtin_interfaces/Time", whole, part)


def _header(make: Make, seconds: float) -> Any:
    return make("std_msgs/Header", _time(make, seconds), FRAME_ID)


def _pose(make: Make, x: float, y: float, heading: float) -> Any:
    turn = make("geometry_msgs/Quaternion", 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
    return make("geometry_msgs/Pose", make("geometry_msgs/Point", x, y, 0.0), turn)


def _latched(job: Job) -> Any:
    """Return what ROS calls the quality of service of a topic whose last message is kept."""
    told = library(job, "rosbags.interfaces", "ros")
    always = told.QosTime(0, 0)
    return told.Qos(
        told.QosHistory.KEEP_LAST, 1, told.QosReliability.RELIABLE,
        told.QosDurability.TRANSIENT_LOCAL, always, always, told.QosLiveliness.AUTOMATIC, always,
        False,
    )  # fmt: skip
