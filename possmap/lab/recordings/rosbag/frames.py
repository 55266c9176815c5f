"""How the sensors of a bag sit on the robot, by its static transforms (/tf_static)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Floats, Mount
from possmap.lab.recordings.rosbag.bag import Bag, Topic
from possmap.lab.recordings.rosbag.fields import ODOMETRY

UNKNOWN = (
    "topics of ranges taken to sit at the robot's middle and look ahead: nothing in the bag says "
    "otherwise (--topic TOPIC:angle=,at_x=,at_y= does)"
)
TILTED = "topics of ranges tilted out of the plane, taken to sit at the robot's middle, look ahead"
FAR = "topics of ranges with a mount beyond 10 m, taken to sit at the robot's middle, look ahead"
OTHER_BODY = (
    "topics of ranges placed against base_link or base_footprint: /tf_static does not have the "
    "frame of the poses"
)
UNREADABLE = "messages of /tf_static that cannot be read as a whole, the rest used"
"""What is tallied."""

FARTHEST_M = 10.0
"""A sensor farther from the robot's middle is not on it [m]."""

_TOPIC = "tf_static"
_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MOST_MESSAGES = 1000
_BODIES = ("base_link", "base_footprint")
_TILT = math.radians(10)
_AHEAD = Mount(0.0)
_LARGEST = 1e6  # [m]

Tree = Mapping[str, tuple[str, Floats]]
"""Frame -> the one it hangs in, and the transform from the former to the latter, (4, 4)."""


@dataclass(frozen=True, slots=True)
class Seat:
    """How a sensor sits on the robot.

    mount : of its own zero direction. flipped : whether its angles count to the right.
    frame : that all its messages must have, or they are another sensor's; None: whatever they have.
    notes : what is to be tallied, a topic for each. sure : whether somebody said where it looks.
    """

    mount: Mount = _AHEAD
    flipped: bool = False
    frame: str | None = None
    notes: tuple[str, ...] = ()
    sure: bool = True


class Frames:
    """The static transforms of a bag that is open; read when they are first asked for.

    place : the topic of the robot's place; None if there is none.
    unreadable : how many messages of /tf_static could not be read.
    """

    def __init__(self, bag: Bag, topics: Mapping[str, Topic], place: Topic | None) -> None:
        self._bag = bag
        self._topics = [
            one
            for one in topics.values()
            if one.name.strip("/") == _TOPIC and one.type in _TYPES and one.count
        ]
        self._place = place
        self.unreadable = 0

    def seat(self, frame: str, single: bool) -> Seat:
        """Return how the sensor of a frame sits on the robot.

        Parameters
        ----------
        single
            Whether it has one beam, along its x axis; else many, in the plane of x and y.
        """
        pose, notes = self._pose(frame)
        if pose is None:
            return Seat(notes=(UNKNOWN,), sure=False)
        up = float(pose[2, 2])
        sine = abs(float(pose[2, 0])) if single else math.sqrt(max(0.0, 1.0 - up * up))
        if sine > math.sin(_TILT):
            return Seat(notes=(TILTED,), sure=False)
        x, y = float(pose[0, 3]), float(pose[1, 3])
        if math.hypot(x, y) > FARTHEST_M:
            return Seat(notes=(FAR,), sure=False)
        angle = math.atan2(pose[1, 0], pose[0, 0])
        return Seat(Mount(angle, x, y), up < 0 and not single, frame, notes)

    def _pose(self, frame: str) -> tuple[Floats | None, tuple[str, ...]]:
        """Return a frame's pose on the robot, and what is to be tallied; None if not known."""
        if not frame:
            return None, ()
        body = self._body
        notes: tuple[str, ...] = ()
        if body and (body in self._frames or body == frame):
            bodies = [body]
        else:  # without a name in the poses, a sensor in the body's own frame needs no transform
            bodies = [one for one in _BODIES if one in self._frames or (not body and one == frame)]
            notes = (OTHER_BODY,) if body else ()
        for one in bodies:
            pose = _poses(self._tree, one).get(frame)
            if pose is not None:
                return pose, notes
        return None, ()

    @cached_property
    def _body(self) -> str:
        """The frame whose place the poses give; empty if they do not say."""
        if self._place is None or self._place.type != ODOMETRY:
            return ""
        message = self._bag.first(self._place, self._bag.decoder(self._place))[0]
        return bare(getattr(message, "child_frame_id", ""))

    @cached_property
    def _frames(self) -> frozenset[str]:
        return frozenset(self._tree) | {parent for parent, _ in self._tree.values()}

    @cached_property
    def _tree(self) -> Tree:
        """The transforms; of several for one frame the last."""
        found: dict[str, tuple[str, Floats]] = {}
        for topic in self._topics:
            try:
                decode = self._bag.decoder(topic)
            except RecordingError:  # the recording can be used without
                self.unreadable += topic.count
                continue
            for _, _, data in islice(self._bag.messages(topic.ids), _MOST_MESSAGES):
                try:
                    message: Any = decode(data)
                    transforms = list(message.transforms)
                except Exception:  # of rosbags, and of types that only share the name
                    self.unreadable += 1
                    continue
                told = [_hung(one) for one in transforms]
                found.update(one for one in told if one is not None)
                self.unreadable += None in told
        return found


def frame_of(message: Any) -> str:
    """Return the frame of a message; empty if it has none."""
    return bare(getattr(getattr(message, "header", None), "frame_id", ""))


def bare(frame: object) -> str:
    """Return a frame's name without slashes before it."""
    return frame.lstrip("/") if isinstance(frame, str) else ""


def _hung(transform: Any) -> tuple[str, tuple[str, Floats]] | None:
    """Return a frame, the one it hangs in, and how; None of a transform that says nothing."""
    try:
        child, parent = bare(transform.child_frame_id), bare(transform.header.frame_id)
        return (child, (parent, _matrix(transform.transform))) if child and parent else None
    except (AttributeError, TypeError, ValueError):
        return None


def _matrix(transform: Any) -> Floats:
    """Return a transform as a matrix, (4, 4).

    Raises
    ------
    ValueError
        If it is none.
    """
    at = np.array([getattr(transform.translation, axis) for axis in "xyz"], dtype=np.float64)
    turn = np.array([getattr(transform.rotation, axis) for axis in "xyzw"], dtype=np.float64)
    if not ((np.abs(at) <= _LARGEST).all() and np.isfinite(turn).all() and turn.any()):
        raise ValueError("no transform")
    turn = turn / np.abs(turn).max()
    x, y, z, w = turn / np.linalg.norm(turn)
    found: Floats = np.eye(4)
    found[:3, 3] = at
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return found


def _poses(tree: Tree, body: str) -> dict[str, Floats]:
    """Return the poses on a body of all frames that hang together with it, (4, 4) each."""
    near: dict[str, list[tuple[str, Floats]]] = {}
    for child, (parent, pose) in tree.items():
        back: Floats = np.eye(4)
        back[:3, :3] = pose[:3, :3].T
        back[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
        near.setdefault(parent, []).append((child, pose))
        near.setdefault(child, []).append((parent, back))
    found: dict[str, Floats] = {body: np.eye(4)}
    waiting = [body]
    while waiting:
        frame = waiting.pop()
        for other, pose in near.get(frame, ()):
            if other not in found:
                found[other] = found[frame] @ pose
                waiting.append(other)
    return found
