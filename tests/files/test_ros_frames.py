"""Bags whose poses stand in transforms, and what their messages say of their own errors."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bags import Message, Transform, bag_ns, words_of, write_bag

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Samples, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping
from possmap.lab.recordings.rosbag.recording import open_bag
from possmap.lab.recordings.rosbag.topics import table_of

SIDES = (-math.pi / 2, 0.0, math.pi / 2)
SAME = (0.0, 0.0, 0.0, 1.0)
LEFT = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))


def turned(angle: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)


def flight(form: str = "mcap", wheel: bool = True) -> list[Message]:
    """Return messages of a robot that drives to the north of its odometry's frame for 3 m.

    The odometry's frame lies 10 m east of the map's, turned left; it is corrected by 0.5 m on the
    way. The laser hangs 0.2 m before the middle, said on /tf over and over; a wheel spins.
    """
    words = words_of(form)
    told: list[Message] = []
    for k in range(31):
        t = k / 10
        links: list[Transform] = [
            ("odom", "base_footprint", (0.0, 0.1 * k, 0.0), LEFT),
            ("base_footprint", "base_link", (0.0, 0.0, 0.1), SAME),
            ("base_link", "laser", (0.2, 0.0, 0.1), SAME),
        ]
        if wheel:
            links.append(("base_link", "wheel", (0.0, 0.1, 0.0), turned(0.5 * k)))
        if k % 10 == 0:
            correction: Transform = ("map", "odom", (10.0, 0.5 * (k == 30), 0.0), LEFT)
            told.append(("/tf", bag_ns(t), words.transforms(correction, t=t)))
        told += [("/tf", bag_ns(t), words.transforms(one, t=t)) for one in links]
        told.append(("/scan", bag_ns(t), words.scan(t, [1.0] * 36, high=3.0, frame="laser")))
    return told


def read(path: Path, *options: str) -> tuple[Samples, Tally, set[tuple[float, float]]]:
    tally = Tally()
    mapping = Mapping(format="ros", tables=tuple(map(table_of, options)))
    recording = open_bag(path, SIDES, mapping)
    seats = {(round(one.x, 6), round(one.y, 6)) for one in recording.mounts}
    return joined(recording.samples(tally, None)), tally, seats


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_a_frame_is_followed_in_another_whatever_hangs_between(tmp_path: Path, form: str) -> None:
    path = write_bag(tmp_path, form, flight(form))
    samples, tally, seats = read(path, "/tf:odom.base_link", "/scan")
    assert samples.x == pytest.approx(np.zeros(31))
    assert samples.y == pytest.approx(0.1 * np.arange(31))
    assert samples.yaw == pytest.approx(np.full(31, math.pi / 2))
    assert np.nanmax(samples.ranges) == 1.0
    assert seats == {(0.2, 0.0)}
    assert tally.counts == {}


def test_transforms_that_move_are_chained(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", flight())
    samples, _, _ = read(path, "/tf:map.base_link", "/scan")
    assert samples.x[[0, 10, 29]] == pytest.approx([10, 9, 7.1])
    assert samples.y[[0, 29, 30]] == pytest.approx([0, 0, 0.5])
    assert samples.yaw == pytest.approx(np.full(31, math.pi))


def test_without_a_pose_the_refusal_says_which_frames_move(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", flight(wheel=False))
    with pytest.raises(RecordingError) as caught:
        open_bag(path, SIDES, None)
    assert str(caught.value).endswith(
        "the place may stand in its transforms, which move odom.base_footprint, map.odom: "
        "--topic /tf:odom.base_footprint --topic /scan"
    )


def test_frames_that_do_not_hang_together_are_refused_with_those_that_do(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", flight(wheel=False))
    with pytest.raises(RecordingError) as caught:
        read(path, "/tf:world.base_link", "/scan")
    assert str(caught.value) == (
        f'{path}: topic /tf: found frames "world.base_link", expected FRAME.FRAME of those that '
        "hang together, such as odom.base_link; it has odom.base_footprint, map.odom"
    )


@pytest.mark.parametrize(
    ("variances", "said"),
    [
        (
            [(0, 0, 0), (0.04, 0.09, 0.01)],
            "--set along=0.075 --set across=0.075 --set drift_spread",
        ),
        ([(0.04, 0.04, 0.01)] * 2, ""),
        ([(0, 0, 0), (1e6, 1e6, 1e6)], ""),
    ],
)
def test_a_covariance_that_grows_suggests_a_model(
    tmp_path: Path, variances: list[tuple[float, float, float]], said: str
) -> None:
    words = words_of("mcap")
    told: list[Message] = []
    for k in range(10):
        message = words.odometry(k, float(k))
        covariance = np.zeros(36)
        covariance[[0, 7, 35]] = variances[k > 0]
        message.pose.covariance = covariance
        told.append(("/odom", bag_ns(k), message))
    path = write_bag(tmp_path, "mcap", told)
    _, tally, _ = read(path, "/odom")
    assert any(said in note for note in tally.notes) if said else not tally.notes
