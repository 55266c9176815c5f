"""Frames of a bag (/tf_static, /tf): how sensors sit on the robot, and where it stands itself."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, TypeAlias

import numpy as np

from possmap.errors import RecordingError, printable, shown
from possmap.lab.convert.samples import Floats
from possmap.lab.recordings.beams import BeamColumn
from possmap.lab.recordings.rosbag.bag import Bag, Topic
from possmap.lab.recordings.rosbag.fields import ODOMETRY, seconds

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

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
UNREADABLE = "messages of /tf_static or /tf that cannot be read as a whole, the rest used"
"""What is tallied."""

FARTHEST_M = 10.0
"""A sensor farther from the robot's middle is not on it [m]."""

_MOST_MESSAGES = 1000  # of each topic
_BODIES = ("base_link", "base_footprint")
_TILT = math.radians(10)
_STILL = 1e-3  # by which no entry of the matrix of a fixed transform changes
_LARGEST = 1e6  # [m]
_MOST_LISTED = 20

Link: TypeAlias = tuple[str, str]
"""A frame and, before it, the one in which it hangs."""


@dataclass(slots=True)
class _Hung:
    """How a frame hangs in another.

    pose : the transform from the former to the latter, (4, 4). first : that of the first message.
    count : of messages. moves : whether it changes.
    """

    pose: Floats
    count: int = 1
    moves: bool = False

    def add(self, pose: Floats) -> None:
        self.moves |= bool(np.abs(pose - self.pose).max() > _STILL)
        self.count += 1
        self.pose = pose


@dataclass(frozen=True, slots=True)
class Seat:
    """How a sensor sits on the robot.

    angle : of its own zero direction [rad]. x, y : [m].
    flipped : whether its angles count to the right.
    frame : that all its messages must have, or they are another sensor's; None: whatever they have.
    notes : what is to be tallied, a topic for each. sure : whether somebody said where it looks.
    """

    angle: float = 0.0
    x: float = 0.0
    y: float = 0.0
    flipped: bool = False
    frame: str | None = None
    notes: tuple[str, ...] = ()
    sure: bool = True

    def beam(self, angle: float) -> BeamColumn:
        """Return a beam of the sensor that looks at an angle [rad] of the robot's frame."""
        return BeamColumn(column="", angle_deg=angle, x=self.x, y=self.y)


class Frames:
    """The transforms of a bag that is open; read when they are first asked for.

    place : the topic of the robot's place; None if there is none. body : the frame whose place it
    gives; empty if that is not known yet.
    unreadable : how many messages with transforms could not be read.
    """

    def __init__(
        self, bag: Bag, topics: Sequence[Topic], place: Topic | None, body: str = ""
    ) -> None:
        self._bag = bag
        self._topics = [one for one in topics if one.type in TRANSFORMS and one.count]
        self._place = place
        self._told_body = body
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
        return Seat(angle, x, y, up < 0 and not single, frame, notes)

    def _pose(self, frame: str) -> tuple[Floats | None, tuple[str, ...]]:
        """Return a frame's pose on the robot, and what is to be tallied; None if not known."""
        if not frame:
            return None, ()
        body = self._body
        fixed = {link: hung.pose for link, hung in self._links.items() if not hung.moves}
        frames = {one for link in fixed for one in link}
        notes: tuple[str, ...] = ()
        if body and (body in frames or body == frame):
            bodies = [body]
        else:  # without a name in the poses, a sensor in the body's own frame needs no transform
            bodies = [one for one in _BODIES if one in frames or (not body and one == frame)]
            notes = (OTHER_BODY,) if body else ()
        for one in bodies:
            pose = _poses(fixed, one).get(frame)
            if pose is not None:
                return pose, notes
        return None, ()

    @cached_property
    def _body(self) -> str:
        """The frame whose place the poses give; empty if they do not say."""
        if self._told_body or self._place is None or self._place.type != ODOMETRY:
            return self._told_body
        message = self._bag.first(self._place, self._bag.decoder(self._place))[0]
        return bare(getattr(message, "child_frame_id", ""))

    @cached_property
    def _links(self) -> dict[Link, _Hung]:
        """The transforms, by the frames that they lie between."""
        found: dict[Link, _Hung] = {}
        for topic in sorted(self._topics, key=lambda one: "static" not in one.name):
            try:
                decode = self._bag.decoder(topic)
            except RecordingError:  # the recording can be used without
                self.unreadable += topic.count
                continue
            for _, _, data in islice(self._bag.messages(topic.ids), _MOST_MESSAGES):
                try:
                    transforms = list(decode(data).transforms)  # type: ignore[attr-defined]
                except Exception:  # of rosbags, and of types that only share the name
                    self.unreadable += 1
                    continue
                for one in transforms:
                    link = _link(one)
                    if link is None:
                        self.unreadable += 1
                    elif link[0] in found and "static" not in topic.name:
                        found[link[0]].add(link[1])
                    else:
                        found[link[0]] = _Hung(link[1])
        return found

    def choices(self) -> list[str]:
        """Return the frames that move in others, as ``--topic /tf:`` takes them; likely ones first.

        A body that moves in the odometry's frame is what a robot's wheels tell.
        """
        moving = [link for link, hung in self._links.items() if hung.moves]
        moving.sort(key=lambda link: (link[1] not in _BODIES, link[0] != "odom"))
        return [f"{parent}.{child}" for parent, child in moving]

    def poses(self, topic: Topic, frames: str | None) -> TfPoses:
        """Return what follows a frame's place in another.

        Parameters
        ----------
        frames
            Both, ``odom.base_link``.

        Raises
        ------
        RecordingError
            If the bag has no such frames, or does not hang the one in the other.
        """
        parent, _, child = (frames or "").partition(".")
        chain = _chain(list(self._links), bare(child), bare(parent))
        if not chain:
            have = ", ".join(map(printable, self.choices()[:_MOST_LISTED])) or "none that moves"
            raise RecordingError(
                str(self._bag.path),
                f"topic {printable(topic.name)}: found frames {shown(frames or '')}, expected "
                f"FRAME.FRAME of those that hang together, such as odom.base_link; it has {have}",
            )
        return TfPoses(chain, {link: self._links[link] for link in chain})


class TfPoses:
    """Follows a frame's place in another along the transforms between them.

    A row comes with each message that has the transform told most often: that one moves.
    """

    def __init__(self, chain: Sequence[Link], hung: Mapping[Link, _Hung]) -> None:
        self._chain = chain
        self._leads = max(chain, key=lambda link: (hung[link].moves, hung[link].count))
        # Those that move are known from their first message on.
        self._now = {link: one.pose for link, one in hung.items() if not one.moves}

    def rows(self, message: Any, bag_time: float) -> list[list[float]]:
        """Return t, x, y and yaw of a message; none if it does not move the frame."""
        found = []
        for one in message.transforms:
            link = _link(one)
            if link is None or link[0] not in self._chain:
                continue
            self._now[link[0]] = link[1]
            if link[0] == self._leads and len(self._now) == len(self._chain):
                pose: Floats = np.eye(4)
                for step in self._chain:
                    pose = pose @ self._now[step]
                t = seconds(one.header.stamp) or bag_time
                yaw = math.atan2(pose[1, 0], pose[0, 0])
                found.append([t, float(pose[0, 3]), float(pose[1, 3]), yaw])
        return found


def frame_of(message: Any) -> str:
    """Return the frame of a message; empty if it has none."""
    return bare(getattr(getattr(message, "header", None), "frame_id", ""))


def bare(frame: object) -> str:
    """Return a frame's name without slashes before it."""
    return frame.lstrip("/") if isinstance(frame, str) else ""


def _link(transform: Any) -> tuple[Link, Floats] | None:
    """Return two frames and how they hang together; None of a transform that says nothing."""
    try:
        parent, child = bare(transform.header.frame_id), bare(transform.child_frame_id)
        return ((parent, child), _matrix(transform.transform)) if child and parent else None
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


def _chain(links: Sequence[Link], child: str, parent: str) -> list[Link]:
    """Return the links that lead from a frame down to one that hangs in it; none: it does not."""
    ways: dict[str, list[Link]] = {child: []}
    waiting = [child]
    while waiting:
        frame = waiting.pop(0)
        for link in links:
            if link[1] == frame and link[0] not in ways:
                ways[link[0]] = [link, *ways[frame]]
                waiting.append(link[0])
    return ways.get(parent, [])


def _poses(fixed: Mapping[Link, Floats], body: str) -> dict[str, Floats]:
    """Return the poses on a body of all frames that hang together with it, (4, 4) each."""
    near: dict[str, list[tuple[str, Floats]]] = {}
    for (parent, child), pose in fixed.items():
        near.setdefault(parent, []).append((child, pose))
        back: Floats = np.linalg.inv(pose).astype(np.float64)
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
