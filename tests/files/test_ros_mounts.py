"""How sensors of a bag sit on the robot: as told, as its transforms say, or as is assumed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bags import FORMATS, Message, Transform, bag_ns, words_of, write_bag

from possmap.errors import RecordingError, SettingsError
from possmap.lab.convert.samples import Mount, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping, read_mapping
from possmap.lab.recordings.rosbag.frames import OTHER_BODY, TILTED, UNKNOWN, UNREADABLE
from possmap.lab.recordings.rosbag.recording import open_bag
from possmap.lab.recordings.rosbag.topics import table_of

SIDES = (-math.pi / 2, 0.0, math.pi / 2)
TF = "/tf_static"
HALF = math.sqrt(0.5)

STRAIGHT = (0.0, 0.0, 0.0, 1.0)
LEFT = (0.0, 0.0, HALF, HALF)  # by 90 degrees
OVER = (1.0, 0.0, 0.0, 0.0)  # rolled by 180 degrees
DOWN = (0.0, HALF, 0.0, HALF)  # pitched by 90 degrees

ROUND = [1.0 + 0.01 * index for index in range(36)]
"""-180 degrees first, 10 degrees apart: 1.09 at -90, 1.18 at 0, 1.27 at 90, 1.00 at 180."""

FORWARD = [(0.0, -1.09), (1.18, 0.0), (0.0, 1.27)]
"""Where the three beams end if the laser sits at the middle and looks ahead."""

PLACES = [
    pytest.param([("base_link", "laser", (0.25, 0.0, 0.2), STRAIGHT)],
        [(0.25, -1.09), (1.43, 0.0), (0.25, 1.27)], id="ahead"),
    # Looking left: the robot's right is behind the laser, ahead is its right, left is ahead of it.
    pytest.param([("base_link", "laser", (0.0, 0.1, 0.0), LEFT)],
        [(0.0, 0.1 - 1.0), (1.09, 0.1), (0.0, 0.1 + 1.18)], id="turned"),
    pytest.param([("base_link", "laser", (0.25, 0.1, 0.0), OVER)],
        [(0.25, 0.1 - 1.27), (0.25 + 1.18, 0.1), (0.25, 0.1 + 1.09)], id="upside-down"),
    # Turned left and then rolled over its own x axis: right is behind it, ahead is its left.
    pytest.param([("base_link", "laser", (0.0, 0.0, 0.0), (HALF, HALF, 0.0, 0.0))],
        [(0.0, -1.0), (1.27, 0.0), (0.0, 1.18)], id="turned-and-upside-down"),
    # A plate 0.2 ahead that looks left, on it the laser 0.1 further along: to the left.
    pytest.param([("base_link", "plate", (0.2, 0.0, 0.0), LEFT),
        ("plate", "laser", (0.1, 0.0, 0.0), STRAIGHT)],
        [(0.2, 0.1 - 1.0), (0.2 + 1.09, 0.1), (0.2, 0.1 + 1.18)], id="chain"),
    # Both hang in the chassis: the laser is 0.5 before it, the robot's middle 0.2, the same way.
    pytest.param([("chassis", "laser", (0.5, 0.3, 0.0), STRAIGHT),
        ("chassis", "base_link", (0.2, 0.0, 0.0), STRAIGHT)],
        [(0.3, 0.3 - 1.09), (0.3 + 1.18, 0.3), (0.3, 0.3 + 1.27)], id="both-ways"),
    # The body hangs in the laser, 0.2 before it and turned left: to the body, the laser lies
    # 0.2 to the left, and looks right.
    pytest.param([("laser", "base_link", (0.2, 0.0, 0.0), LEFT)],
        [(0.0, 0.2 - 1.18), (1.27, 0.2), (0.0, 0.2 + 1.0)], id="backwards"),
    # Not of length 1, and with slashes.
    pytest.param([("/base_link", "//laser", (0.25, 0.0, 0.0), (0.0, 0.0, 3.0, 3.0))],
        [(0.25, -1.0), (0.25 + 1.09, 0.0), (0.25, 1.18)], id="slashes"),
]  # fmt: skip


def flight(
    form: str,
    transforms: list[Transform] | None = None,
    body: str = "base_link",
    frame: str = "laser",
) -> list[Message]:
    """Return a bag's messages: a robot that stands at 0, 0 and looks along x."""
    words = words_of(form)
    told: list[Message] = []
    if transforms is not None:  # one message each, as of publishers of their own
        told = [(TF, bag_ns(0.0), words.transforms(one)) for one in transforms]
    for t in (0.0, 1.0, 2.0):
        told.append(("/odom", bag_ns(t), words.odometry(t, 0.0, body=body)))
        told.append(("/scan", bag_ns(t), words.scan(t, ROUND, frame=frame)))
    return told


def ends_of(path: Path, mapping: Mapping | None = None) -> tuple[list[tuple[float, float]], Tally]:
    """Return where the beams to the right, ahead and to the left end, and the tally."""
    tally = Tally()
    recording = open_bag(path, SIDES, mapping)
    samples = joined(recording.samples(tally, None))
    assert not samples.x.any() and not samples.yaw.any()
    (ranges,) = np.unique(samples.ranges, axis=0)
    ends = [
        (one.x + float(r) * math.cos(one.angle), one.y + float(r) * math.sin(one.angle))
        for one, r in zip(recording.mounts, ranges, strict=True)
    ]
    return ends, tally


def check(found: list[tuple[float, float]], places: list[tuple[float, float]]) -> None:
    np.testing.assert_allclose(found, places, atol=1e-6)


@pytest.mark.parametrize("form", ["bag", "mcap"])
@pytest.mark.parametrize(("transforms", "places"), PLACES)
def test_walls_stand_where_the_transforms_put_them(
    tmp_path: Path, form: str, transforms: list[Transform], places: list[tuple[float, float]]
) -> None:
    found, tally = ends_of(write_bag(tmp_path, form, flight(form, transforms)))
    check(found, places)
    assert not tally.counts


@pytest.mark.parametrize("form", FORMATS)
def test_without_transforms_the_middle_is_assumed_and_said(tmp_path: Path, form: str) -> None:
    path = write_bag(tmp_path, form, flight(form))
    found, tally = ends_of(path)
    check(found, FORWARD)
    count = tally.counts.pop(UNKNOWN)
    assert (count.count, count.first) == (1, f"{path} /scan")
    assert not tally.counts


@pytest.mark.parametrize("transforms", [None, [("base_link", "laser", (0.0, 0.0, 0.0), OVER)]])
def test_the_option_has_the_last_word(tmp_path: Path, transforms: list[Transform] | None) -> None:
    path = write_bag(tmp_path, "mcap", flight("mcap", transforms))
    tables = tuple(map(table_of, ("/odom", "/scan:angle=90,at_x=0.25")))
    found, tally = ends_of(path, Mapping(format="ros", tables=tables))
    check(found, [(0.25, -1.0), (0.25 + 1.09, 0.0), (0.25, 1.18)])
    assert not tally.counts


def test_a_mapping_says_it_too(tmp_path: Path) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "format: ros\ntables:\n- topic: /odom\n"
        "- {topic: /scan, mount: {angle_deg: 90, x: 0.25, y: -0.5}}\n"
    )
    found, tally = ends_of(write_bag(tmp_path, "db3", flight("db3")), read_mapping(rules))
    check(found, [(0.25, -0.5 - 1.0), (0.25 + 1.09, -0.5), (0.25, -0.5 + 1.18)])
    assert not tally.counts


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "format: ros\ntables: [{topic: /s, mount: {x: 11}}]",
            'mount.x, found "11", expected a number, -10 to 10',
        ),
        ("format: ros\ntables: [{topic: /s, mount: {angle: 3}}]", "angle"),
        ("format: ros\ntables: [{topic: /s, columns: {x: a}, mount: {x: 1}}]", "without columns"),
        ("format: json\ntables: [{columns: {x: a, y: b}, mount: {x: 1}}]", "mount"),
        ("format: ros\nmount: {x: 1}", "mount"),
    ],
)
def test_a_mount_that_says_nothing_is_refused(tmp_path: Path, text: str, told: str) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(text)
    with pytest.raises(SettingsError) as caught:
        read_mapping(rules)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    "turn", [DOWN, (math.sin(math.radians(6)), 0, 0, math.cos(math.radians(6)))]
)
def test_a_laser_tilted_out_of_the_plane_is_said(
    tmp_path: Path, turn: tuple[float, float, float, float]
) -> None:
    path = write_bag(tmp_path, "bag", flight("bag", [("base_link", "laser", (0.2, 0, 0), turn)]))
    found, tally = ends_of(path)
    check(found, FORWARD)
    assert tally.counts[TILTED].first == f"{path} /scan"


@pytest.mark.parametrize(
    ("parent", "body", "notes"),
    [
        ("base_link", "", []),
        ("base_footprint", "", []),
        ("base_link", "base_footprint", [OTHER_BODY]),
        ("base_link", "odom", [OTHER_BODY]),
        ("map", "", [UNKNOWN]),
        ("map", "robot", [UNKNOWN]),
        ("robot", "/robot", []),
    ],
)
def test_the_body_is_the_poses_own_or_a_usual_one(
    tmp_path: Path, parent: str, body: str, notes: list[str]
) -> None:
    told = flight("mcap", [(parent, "laser", (0.25, 0, 0), STRAIGHT)], body)
    found, tally = ends_of(write_bag(tmp_path, "mcap", told))
    check(found, FORWARD if notes == [UNKNOWN] else [(0.25, -1.09), (1.43, 0.0), (0.25, 1.27)])
    assert list(tally.counts) == notes


@pytest.mark.parametrize("body", ["base_link", ""])
def test_a_sensor_in_the_bodys_frame_needs_no_transform(tmp_path: Path, body: str) -> None:
    told = flight("bag", None, body, "/base_link")
    found, tally = ends_of(write_bag(tmp_path, "bag", told))
    check(found, FORWARD)
    assert not tally.counts


def test_of_several_transforms_of_one_frame_the_last_holds(tmp_path: Path) -> None:
    told = flight(
        "bag",
        [
            ("base_link", "laser", (0.9, 0, 0), OVER),
            ("base_link", "laser", (0.25, 0, 0), STRAIGHT),
        ],
    )
    found, _ = ends_of(write_bag(tmp_path, "bag", told))
    check(found, [(0.25, -1.09), (1.43, 0.0), (0.25, 1.27)])


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_transforms_that_are_none_are_counted(tmp_path: Path, form: str) -> None:
    bad: list[Transform] = [
        ("base_link", "laser", (math.nan, 0, 0), STRAIGHT),
        ("base_link", "laser", (0, 0, 0), (0, 0, 0, 0)),
        ("base_link", "laser", (1e300, 0, 0), STRAIGHT),
        ("", "laser", (1, 0, 0), STRAIGHT),
        ("laser", "laser", (1, 0, 0), STRAIGHT),
        ("b", "a", (0, 0, 0), STRAIGHT),
        ("a", "b", (0, 0, 0), STRAIGHT),
    ]
    told = [*flight(form, bad)]
    told.insert(0, (TF, bag_ns(0.0), ("tf2_msgs/msg/TFMessage", b"\xff" * 7)))
    found, tally = ends_of(write_bag(tmp_path, form, told))
    check(found, FORWARD)
    assert tally.of(UNREADABLE) == 5
    assert tally.of(UNKNOWN) == 1


def finders(form: str, *topics: str) -> list[Message]:
    """Return odometry with range finders, each in the frame of its topic's name."""
    words = words_of(form)
    told = [one for one in flight(form) if one[0] != "/scan"]
    for t in (0.0, 1.0, 2.0):
        told += [
            (topic, bag_ns(t), words.range(t, 0.5, frame=topic.lstrip("/"))) for topic in topics
        ]
    return sorted(told, key=lambda one: one[1])


def test_transforms_tell_where_range_finders_look(tmp_path: Path) -> None:
    words = words_of("bag")
    # Rolled about its own axis, which to one beam is all the same.
    roll = (HALF, 0.0, 0.0, HALF)
    hung = words.transforms(
        ("base_link", "left", (0.1, 0.2, 0.0), LEFT), ("base_link", "front", (0.3, 0, 0), roll)
    )
    told = [(TF, bag_ns(0.0), hung), *finders("bag", "/left", "/front")]
    path = write_bag(tmp_path, "bag", told)
    front, left = sorted(open_bag(path, SIDES, None).mounts, key=lambda one: one.angle)
    assert (left.x, left.y, left.angle) == pytest.approx((0.1, 0.2, math.pi / 2))
    assert (front.x, front.y, front.angle) == pytest.approx((0.3, 0.0, 0.0))


def test_several_range_finders_of_which_one_is_unknown_are_refused(tmp_path: Path) -> None:
    words = words_of("bag")
    hung = words.transforms(("base_link", "left", (0.1, 0.2, 0.0), LEFT))
    told = [(TF, bag_ns(0.0), hung), *finders("bag", "/left", "/front")]
    path = write_bag(tmp_path, "bag", told)
    with pytest.raises(RecordingError, match="--topic TOPIC:angle=DEGREES"):
        open_bag(path, SIDES, None)
    tables = tuple(map(table_of, ("/odom", "/left", "/front:angle=0,at_x=0.3")))
    left, front = open_bag(path, SIDES, Mapping(format="ros", tables=tables)).mounts
    assert left.y == pytest.approx(0.2)
    assert front == Mount(0.0, 0.3)


def test_another_sensor_on_the_same_topic_is_left_out(tmp_path: Path) -> None:
    words = words_of("bag")
    told = flight("bag", [("base_link", "laser", (0.25, 0, 0), STRAIGHT)])
    rear = words.scan(1.5, [5.0] * 36, frame="rear")
    told.insert(-2, ("/scan", bag_ns(1.5), rear))
    found, tally = ends_of(write_bag(tmp_path, "bag", told))
    check(found, [(0.25, -1.09), (1.43, 0.0), (0.25, 1.27)])
    assert tally.of("scans of another layout or frame than the first, skipped") == 1
