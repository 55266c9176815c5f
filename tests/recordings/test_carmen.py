"""CARMEN logs: what their lines say, and that a bad line harms no other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from possmap.lab.convert.samples import Samples, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Source, carmen, open_recordings
from possmap.lab.recordings.carmen import PoseOf, open_carmen
from possmap.lab.recordings.recording import Recording

CUT = "lines cut short or without numbers, skipped"
OTHER = "laser lines of another layout than the others, skipped"
NO_POSE = "rows with NaN or infinity for a pose, skipped"
NOTHING = "readings that mean nothing, dropped"
FOUR = (-90, 0, 90, 180)


def words(*values: object) -> str:
    return " ".join(map(str, values))


def flaser(
    t: float,
    ranges: Sequence[float],
    robot: Sequence[float] = (0, 0, 0),
    laser: Sequence[float] | None = None,
    kind: str = "FLASER",
) -> str:
    where = words(*(robot if laser is None else laser), *robot)
    return f"{kind} {len(ranges)} {words(*ranges)} {where} {t} host {t}"


def robotlaser(
    t: float,
    ranges: Sequence[float],
    robot: Sequence[float] = (0, 0, 0),
    laser: Sequence[float] | None = None,
    first: float = -math.pi / 2,
    step: float = math.pi / 180,
    longest: float = 50.0,
    remissions: Sequence[float] = (),
) -> str:
    return words(
        "ROBOTLASER1", 0, first, step * (len(ranges) - 1), step, longest, 0.01, 0,
        len(ranges), *ranges, len(remissions), *remissions,
        *(robot if laser is None else laser), *robot, 0.1, 0.2, 0.3, 0.4, 0.5, t, "host", t,
    )  # fmt: skip


def odom(t: float, x: float, y: float = 0.0, yaw: float = 0.0) -> str:
    return words("ODOM", x, y, yaw, 0.1, 0.2, 0.3, t, "host", t)


def log(folder: Path, *lines: str) -> Path:
    path = folder / "drive.log"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def opened(path: Path, degrees: Sequence[float] = FOUR, pose: PoseOf = "odometry") -> Recording:
    return open_carmen(path, [math.radians(angle) for angle in degrees], pose)


def read(
    path: Path, degrees: Sequence[float] = FOUR, pose: PoseOf = "odometry"
) -> tuple[Samples, Tally]:
    tally = Tally()
    return joined(opened(path, degrees, pose).samples(tally, None)), tally


def angles(recording: Recording) -> list[float]:
    return [math.degrees(mount.angle) for mount in recording.mounts]


def numbered(count: int) -> list[float]:
    """Return a scan of which each reading tells its number: 1 m and so many millimetres."""
    return [round(1 + 0.001 * index, 3) for index in range(count)]


# --- What the lines say ------------------------------------------------------------------------


def test_a_front_laser_gives_pose_time_and_chosen_beams(tmp_path: Path) -> None:
    lines = [flaser(10 + k, numbered(181), (k, 2 * k, 0.1 * k)) for k in range(3)]
    samples, tally = read(log(tmp_path, *lines))
    assert samples.t.tolist() == [10, 11, 12]
    assert samples.x.tolist() == [0, 1, 2]
    assert samples.y.tolist() == [0, 2, 4]
    assert samples.yaw == pytest.approx([0, 0.1, 0.2])
    assert samples.ranges[1].tolist() == [1.0, 1.09, 1.18]
    assert tally.counts == {}


@pytest.mark.parametrize(
    ("count", "degrees", "readings"),
    [
        (180, [-90, 0, 89], [0, 90, 179]),
        (181, [-90, 0, 90], [0, 90, 180]),
        (360, [-90, 0, 89.5], [0, 180, 359]),
        (361, [-90, 0, 90], [0, 180, 360]),
    ],
)
def test_scans_of_every_usual_count_reach_half_around(
    tmp_path: Path, count: int, degrees: list[float], readings: list[int]
) -> None:
    path = log(tmp_path, *(flaser(t, numbered(count)) for t in range(2)))
    assert angles(opened(path)) == pytest.approx(degrees)
    samples, _ = read(path)
    assert samples.ranges[0] == pytest.approx([numbered(count)[index] for index in readings])


def test_a_rear_laser_looks_back(tmp_path: Path) -> None:
    path = log(tmp_path, *(flaser(t, numbered(181), kind="RLASER") for t in range(2)))
    recording = opened(path)
    # Its readings run from the robot's left over its back to its right.
    assert [round(math.degrees(mount.angle)) % 360 for mount in recording.mounts] == [270, 90, 180]
    samples, _ = read(path)
    assert samples.ranges[0].tolist() == [1.18, 1.0, 1.09]


def test_two_lasers_of_different_moments_make_a_sample_each(tmp_path: Path) -> None:
    path = log(
        tmp_path,
        flaser(0, numbered(181)),
        flaser(0.5, numbered(181), (1, 0, 0), kind="RLASER"),
        flaser(1, numbered(181), (2, 0, 0)),
    )
    samples, _ = read(path, (0, 180))
    assert samples.x.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(
        samples.ranges, [[1.09, math.nan], [math.nan, 1.09], [1.09, math.nan]]
    )


def test_a_robotlaser_says_its_own_angles(tmp_path: Path) -> None:
    lines = [
        robotlaser(t, numbered(5), (t, 1, 2), first=-math.pi, step=math.pi / 2) for t in range(2)
    ]
    path = log(tmp_path, *lines)
    assert angles(opened(path)) == pytest.approx([-90, 0, 90, -180])
    samples, _ = read(path)
    assert samples.ranges[0].tolist() == [1.001, 1.002, 1.003, 1.0]
    assert samples.x.tolist() == [0, 1]
    assert samples.yaw.tolist() == [2, 2]


def test_remissions_are_passed_over(tmp_path: Path) -> None:
    lines = [robotlaser(t, numbered(181), (t, 7, 0), remissions=[9] * 181) for t in range(2)]
    samples, _ = read(log(tmp_path, *lines))
    assert samples.x.tolist() == [0, 1]
    assert samples.y.tolist() == [7, 7]
    assert samples.t.tolist() == [0, 1]


def test_a_robotlaser_whose_pose_looks_back_is_a_rear_one(tmp_path: Path) -> None:
    lines = [robotlaser(t, numbered(181), (t, 0, 0), (t - 0.2, 0, math.pi)) for t in range(2)]
    recording = opened(log(tmp_path, *lines), (180,))
    (mount,) = recording.mounts
    assert math.degrees(mount.angle) == pytest.approx(180)
    assert (mount.x, mount.y) == pytest.approx((-0.2, 0))


def test_odometry_alone_makes_a_track_without_beams(tmp_path: Path) -> None:
    path = log(tmp_path, *(odom(t, t, 2 * t, 0.1) for t in range(4)))
    assert opened(path).mounts == ()
    samples, tally = read(path)
    assert samples.x.tolist() == [0, 1, 2, 3]
    assert samples.y.tolist() == [0, 2, 4, 6]
    assert samples.yaw.tolist() == [0.1] * 4
    assert samples.ranges.shape == (4, 0)
    assert tally.counts == {}


def test_odometry_beside_laser_lines_is_counted_and_not_used(tmp_path: Path) -> None:
    path = log(tmp_path, flaser(0, [1] * 181), odom(0.5, 99), flaser(1, [1] * 181, (1, 0, 0)))
    samples, tally = read(path)
    assert samples.x.tolist() == [0, 1]
    assert tally.of("ODOM lines, not needed beside laser lines that have poses") == 1


def test_a_laser_ahead_of_the_wheels_is_where_it_is(tmp_path: Path) -> None:
    half = math.pi / 2
    robot = (3, 4, half)
    lines = [flaser(t, [1] * 181, robot, (2.9, 4.2, half)) for t in range(2)]
    mounts = opened(log(tmp_path, *lines)).mounts
    for mount in mounts:
        assert (mount.x, mount.y) == pytest.approx((0.2, 0.1))


def test_a_corrected_laser_pose_is_no_mount(tmp_path: Path) -> None:
    path = log(tmp_path, *(flaser(t, [1] * 181, (t, 0, 0), (50, 60, 2)) for t in range(2)))
    assert {(mount.x, mount.y) for mount in opened(path).mounts} == {(0, 0)}


@pytest.mark.parametrize("kind", ["FLASER", "RLASER"])
def test_the_laser_pose_may_be_believed_instead(tmp_path: Path, kind: str) -> None:
    """The beams then begin where the log says that the laser was, and look where it looked."""
    behind = math.pi * (kind == "RLASER")
    lasers = [(0.2, 0, behind), (1.3, 0.1, 0.1 + behind), (2.5, 0.3, 0.2 + behind)]
    robots = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    lines = [
        flaser(t, numbered(181), *pair, kind=kind)
        for t, pair in enumerate(zip(robots, lasers, strict=True))
    ]
    path = log(tmp_path, *lines)
    recording = opened(path, (180 if behind else 0,), "laser")
    (mount,) = recording.mounts
    samples = joined(recording.samples(Tally(), None))
    cos, sin = np.cos(samples.yaw), np.sin(samples.yaw)
    start_x = samples.x + cos * mount.x - sin * mount.y
    start_y = samples.y + sin * mount.x + cos * mount.y
    assert start_x == pytest.approx([0.2, 1.3, 2.5])
    assert start_y == pytest.approx([0, 0.1, 0.3])
    looks = np.mod(samples.yaw + mount.angle, 2 * math.pi)
    assert looks == pytest.approx(np.mod([yaw for *_, yaw in lasers], 2 * math.pi))


# --- Readings that are none --------------------------------------------------------------------


def test_a_reading_of_the_maximum_means_nothing_in_sight(tmp_path: Path) -> None:
    path = log(tmp_path, *(flaser(t, [81.83, 80, 79.9]) for t in range(2)))
    samples, _ = read(path)
    assert samples.ranges[0].tolist() == [-80, -80, 79.9]


def test_a_robotlaser_says_its_own_maximum(tmp_path: Path) -> None:
    step = math.pi / 2
    path = log(tmp_path, *(robotlaser(t, [4, 3.9, 50], longest=4, step=step) for t in range(2)))
    samples, _ = read(path)
    assert samples.ranges[0].tolist() == [-4, 3.9, -4]


def test_zero_negative_and_nan_readings_are_none(tmp_path: Path) -> None:
    path = log(tmp_path, *(flaser(t, [0, -1, math.nan]) for t in range(2)))
    samples, tally = read(path)
    assert np.isnan(samples.ranges).all()
    assert tally.of(NOTHING) == 4  # one that is NaN says itself that it is none


# --- Lines that cannot be used -----------------------------------------------------------------


def test_lines_cut_anywhere_are_skipped_and_counted(tmp_path: Path) -> None:
    """Only a cut within the logger's own time at the end, which nobody needs, goes unseen."""
    whole = flaser(1.5, numbered(5), (1, 2, 3))
    end = whole.rindex(" ") + 1
    for length in range(len("FLASER "), end + 1):
        path = log(tmp_path, flaser(0, [1] * 5), whole[:length], flaser(2, [1] * 5))
        samples, tally = read(path)
        assert len(samples) == 2, whole[:length]
        assert tally.of(CUT) + tally.of(OTHER) == 1
        assert next(iter(tally.counts.values())).first == f"{path}:2"


def test_the_first_line_may_be_cut(tmp_path: Path) -> None:
    path = log(tmp_path, flaser(0, [1] * 181)[:300], *(flaser(t, [1] * 181) for t in (1, 2, 3)))
    samples, tally = read(path)
    assert samples.t.tolist() == [1, 2, 3]
    assert tally.counts[CUT].first == f"{path}:1"


def test_scans_of_another_layout_are_skipped(tmp_path: Path) -> None:
    path = log(
        tmp_path, flaser(0, [1] * 181), flaser(1, [1] * 180), flaser(2, [1] * 181, (5, 0, 0))
    )
    samples, tally = read(path)
    assert samples.x.tolist() == [0, 5]
    assert (tally.counts[OTHER].count, tally.counts[OTHER].first) == (1, f"{path}:2")


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("pose", ["odometry", "laser"])
def test_a_pose_of_nan_is_skipped(tmp_path: Path, bad: str, at: int, pose: PoseOf) -> None:
    where: list[object] = [0, 0, 0]
    where[at] = bad
    line = flaser(1, [1] * 3, (4, 4, 4)).replace("4 4 4", words(*where))
    path = log(tmp_path, flaser(0, [1] * 3), line, flaser(2, [1] * 3))
    samples, tally = read(path, pose=pose)
    assert samples.t.tolist() == [0, 2]
    assert tally.counts[NO_POSE].first == f"{path}:2"


@pytest.mark.parametrize("count", ["1000000000", "-5", "0", "x", "9" * 5000, "1e3", ""])
def test_a_count_that_is_none_takes_no_memory(tmp_path: Path, count: str) -> None:
    line = flaser(0, [1] * 181).replace("FLASER 181", f"FLASER {count}", 1)
    path = log(tmp_path, line, *(flaser(t, [1] * 181) for t in (1, 2, 3)))
    samples, tally = read(path)
    assert samples.t.tolist() == [1, 2, 3]
    assert sum(one.count for one in tally.counts.values()) == 1


@pytest.mark.parametrize("count", ["-1", "-200", "99999999999", "x"])
def test_a_count_of_remissions_that_is_none_is_skipped(tmp_path: Path, count: str) -> None:
    line = robotlaser(1, [1] * 3).split(" ")
    line[12] = count
    samples, tally = read(
        log(tmp_path, robotlaser(0, [1] * 3), " ".join(line), robotlaser(2, [1] * 3))
    )
    assert samples.t.tolist() == [0, 2]
    assert tally.of(CUT) == 1


# --- However the file is read ------------------------------------------------------------------


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
def test_blocks_of_any_size_give_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    lines = [
        flaser(t, numbered(5), (t, 0, 0.5 * t), kind=kind)
        for t in range(10)
        for kind in ("FLASER", "RLASER")
    ]
    path = log(tmp_path, *lines)
    whole, _ = read(path)
    monkeypatch.setattr(carmen, "CHUNK_ROWS", rows)
    parts, _ = read(path)
    for name in ("t", "x", "y", "yaw", "ranges"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_carmen_is_told_by_what_is_inside(tmp_path: Path) -> None:
    path = log(tmp_path, "# some log", "PARAM a b", flaser(0, [1] * 181), flaser(1, [1] * 181))
    path = path.rename(tmp_path / "drive.txt")
    (recording,) = open_recordings([path], Source(beams=(0.0,)))
    assert recording.name == "drive.txt"
    assert len(joined(recording.samples(Tally(), None))) == 2
