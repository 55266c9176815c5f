"""Bags of ROS: whatever format, the same track and beams; whatever damage, one plain sentence."""

from __future__ import annotations

import math
import os
import re
import sqlite3
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import bags
import numpy as np
import pytest
from bags import BAG_LATER_S, FORMATS, START_S, Message, bag_ns, words_of, write_bag

from possmap.errors import RecordingError, SettingsError
from possmap.lab.convert.samples import Samples, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import Scan, SeatedAt
from possmap.lab.recordings.mapping import Mapping, Nothing, Table, Units
from possmap.lab.recordings.rosbag.frames import UNKNOWN
from possmap.lab.recordings.rosbag.recording import Clock, open_bag
from possmap.lab.recordings.rosbag.topics import table_of

REAL = Path(__file__).resolve().parents[3] / "shared" / "realdata" / "crazyflie"

FOUR = tuple(math.radians(angle) for angle in (-90, 0, 90, 180))
INVALID = "readings that mean nothing, dropped"
ROUND = [1.0 + 0.01 * index for index in range(36)]
"""A scan of which each reading tells where it points: -180 degrees first, 10 degrees apart."""


def topics_of(*options: str, **rest: object) -> Mapping:
    return Mapping(format="ros", tables=tuple(map(table_of, options)), **rest)  # type: ignore[arg-type]


def read(
    path: Path,
    mapping: Mapping | None = None,
    wanted: tuple[float, ...] = FOUR,
    clock: Clock = "header",
) -> tuple[Samples, Tally]:
    tally = Tally()
    return joined(open_bag(path, wanted, mapping, clock).samples(tally, None)), tally


def refusal(path: Path, mapping: Mapping | None = None) -> str:
    """Return how a bag is refused, while it is opened or read."""
    with pytest.raises(RecordingError) as caught:
        read(path, mapping)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    return caught.value.problem


def drive(form: str, count: int = 30, scans: bool = True) -> Iterator[Message]:
    """Yield odometry every 0.1 s along a bend, and a scan between each two."""
    words = words_of(form)
    for index in range(count):
        t = 0.1 * index
        yield "/odom", bag_ns(t), words.odometry(t, 0.1 * index, 0.02 * index, 0.03 * index)
        if scans:
            yield "/scan", bag_ns(t + 0.05), words.scan(t + 0.05, ROUND)


def still(form: str, extra: list[Message], count: int = 30) -> list[Message]:
    """Return odometry that stays where it is, with other messages among it."""
    return sorted([*drive(form, count, scans=False), *extra], key=lambda message: message[1])


def ranges_of(samples: Samples, beam: int = 0) -> list[float]:
    """Return the readings of a beam, where there is one."""
    column = samples.ranges[:, beam]
    return [float(value) for value in column[~np.isnan(column)]]


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_gives_the_same_track(tmp_path: Path, form: str) -> None:
    samples, tally = read(write_bag(tmp_path, form, drive(form)))
    assert samples.t == pytest.approx(START_S + 0.05 * np.arange(59))
    assert samples.x == pytest.approx(0.05 * np.arange(59))
    assert samples.y == pytest.approx(0.01 * np.arange(59))
    assert samples.yaw == pytest.approx(0.015 * np.arange(59))
    assert samples.ranges[1] == pytest.approx([1.09, 1.18, 1.27, 1.0], abs=1e-6)
    assert set(tally.counts) == {UNKNOWN, "rows of ranges too far in time from a pose, dropped"}


@pytest.mark.parametrize(
    ("form", "compression"),
    [
        ("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage"), ("folder", "file"),
        ("folder", "message"),
    ],
)  # fmt: skip
def test_compressed_bags_give_the_same_track(tmp_path: Path, form: str, compression: str) -> None:
    (tmp_path / "plain").mkdir()
    plain, _ = read(write_bag(tmp_path / "plain", form, drive(form)))
    packed, _ = read(write_bag(tmp_path, form, drive(form), compression))
    for name in ("t", "x", "y", "yaw", "ranges"):
        np.testing.assert_array_equal(getattr(packed, name), getattr(plain, name))


@pytest.mark.parametrize("form", FORMATS)
def test_progress_adds_up_to_the_size(tmp_path: Path, form: str) -> None:
    recording = open_bag(write_bag(tmp_path, form, drive(form, 6000, False)), FOUR, None)
    told: list[int] = []
    for _ in recording.samples(Tally(), told.append):
        assert sum(told) <= recording.size
    assert sum(told) == recording.size
    assert len(told) > 1


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="open files cannot be counted")
@pytest.mark.parametrize("form", FORMATS)
def test_a_bag_is_closed_when_its_samples_are_dropped(tmp_path: Path, form: str) -> None:
    path = write_bag(tmp_path, form, drive(form, 6000, False))
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    stream = open_bag(path, FOUR, None).samples(Tally(), None)
    next(stream)
    assert len(os.listdir("/proc/self/fd")) > before  # noqa: PTH208
    del stream
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


def test_odometry_is_preferred_to_pose_stamped(tmp_path: Path) -> None:
    words = words_of("bag")
    pose = [("/pose", bag_ns(t), words.stamped(t, 50.0)) for t in (0.0, 1.0)]
    samples, _ = read(write_bag(tmp_path, "bag", still("bag", pose)))
    assert samples.x.max() < 10


def test_several_odometry_topics_are_listed(tmp_path: Path) -> None:
    words = words_of("bag")
    other = [("/odom/filtered", bag_ns(0.0), words.odometry(0.0, 7.0))]
    path = write_bag(tmp_path, "bag", still("bag", other))
    problem = refusal(path)
    assert "/odom (nav_msgs/Odometry), /odom/filtered (nav_msgs/Odometry)" in problem
    assert "--topic TOPIC" in problem
    samples, _ = read(path, topics_of("/odom/filtered"))
    assert samples.x.tolist() == [7.0]


def test_without_a_place_the_topics_are_listed_with_their_types(tmp_path: Path) -> None:
    words = words_of("db3")
    scans = [(f"/scan{n:02}", bag_ns(0.0), words.scan(0.0, ROUND)) for n in range(25)]
    problem = refusal(write_bag(tmp_path, "db3", scans))
    assert "no topic of nav_msgs/Odometry or geometry_msgs/PoseStamped" in problem
    assert "/scan00 (sensor_msgs/LaserScan)" in problem
    assert "/scan19" in problem
    assert "/scan20" not in problem
    assert "and 5 more" in problem
    assert "--topic TOPIC:x=FIELD,y=FIELD" in problem


def test_a_missing_topic_is_refused_with_those_there_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", drive("mcap"))
    problem = refusal(path, topics_of("/odmo"))
    assert 'topic "/odmo" is missing' in problem
    assert "/scan (sensor_msgs/LaserScan)" in problem
    assert problem.endswith('did you mean "/odom"?')


def test_an_empty_topic_is_refused_when_named_and_passed_over_else(tmp_path: Path) -> None:
    empty = [("/odom_old", bags.ODOMETRY)]
    path = write_bag(tmp_path, "mcap", drive("mcap"), topics=empty)
    assert len(read(path)[0])
    assert "has no messages" in refusal(path, topics_of("/odom_old"))


@pytest.mark.parametrize("form", FORMATS)
def test_the_reading_nearest_to_each_beam_is_chosen(tmp_path: Path, form: str) -> None:
    path = write_bag(tmp_path, form, drive(form))
    wanted = (math.radians(41), math.radians(-90))
    recording = open_bag(path, wanted, None)
    assert [math.degrees(mount.angle) for mount in recording.mounts] == pytest.approx([40, -90])
    samples, _ = read(path, wanted=wanted)
    assert samples.ranges[1] == pytest.approx([1.22, 1.09], abs=1e-6)


def test_readings_beyond_the_limits_are_none_and_infinity_is_nothing_in_sight(
    tmp_path: Path,
) -> None:
    words = words_of("mcap")
    told = [1.5, math.inf, -math.inf, math.nan, 0.0, 0.05, 10.5, 10.0]
    scans: list[Message] = [
        ("/scan", bag_ns(0.2 + 0.1 * n), words.scan(0.2 + 0.1 * n, [9.0, 9.0, value, 9.0]))
        for n, value in enumerate(told)
    ]
    path = write_bag(tmp_path, "mcap", still("mcap", scans))
    samples, tally = read(path, wanted=(0.0,))
    assert ranges_of(samples) == [1.5, -10, -10]
    assert tally.of(INVALID) == 5


def test_scans_of_another_layout_are_skipped_and_counted(tmp_path: Path) -> None:
    words = words_of("bag")
    turned = words.scan(1.05, [5.0] * 36)
    turned.angle_min = 0.0
    extra: list[Message] = [
        ("/scan", bag_ns(1.0), words.scan(1.0, [5.0] * 18)),
        ("/scan", bag_ns(1.05), turned),
    ]
    path = write_bag(tmp_path, "bag", sorted([*drive("bag"), *extra], key=lambda m: m[1]))
    samples, tally = read(path)
    assert 5.0 not in ranges_of(samples)
    assert tally.of("scans of another layout or frame than the first, skipped") == 2


def test_several_scans_are_listed(tmp_path: Path) -> None:
    words = words_of("bag")
    rear: list[Message] = [("/rear", bag_ns(0.2), words.scan(0.2, [5.0] * 36))]
    path = write_bag(tmp_path, "bag", sorted([*drive("bag"), *rear], key=lambda m: m[1]))
    problem = refusal(path)
    assert "/scan (sensor_msgs/LaserScan), /rear (sensor_msgs/LaserScan), expected one" in problem
    samples, _ = read(path, topics_of("/odom", "/rear"))
    assert set(ranges_of(samples)) == {5.0}


def test_a_list_of_an_own_type_is_a_scan_if_the_mapping_says_so(tmp_path: Path) -> None:
    words = words_of("mcap")
    own: list[Message] = [("/ring", bag_ns(0.2), words.raw(0.2, 100, 200, 300, 400))]
    path = write_bag(tmp_path, "mcap", still("mcap", own))
    scan = Scan(column="raw", first_deg=-math.pi / 2, step_deg=math.pi / 2, x=0.1)
    mapping = Mapping(
        format="ros",
        tables=(Table(topic="/odom"), Table(topic="/ring", scan=scan)),
        units=Units(range="cm", time="ms"),
        nothing=Nothing(values=(300.0,)),
    )
    recording = open_bag(path, FOUR, mapping)
    assert recording.mounts[0].x == 0.1
    samples, _ = read(path, mapping)
    found = samples.ranges[~np.isnan(samples.ranges).all(axis=1)]
    assert found.tolist() == [[1.0, 2.0, -math.inf, 4.0]]
    assert samples.x.max() == pytest.approx(2.9)  # in metres still


def test_the_only_one_looks_ahead(tmp_path: Path) -> None:
    words = words_of("db3")
    told = [0.5, math.inf, 2.0, 2.5, math.nan, -math.inf, 0.05, 0.0]
    found: list[Message] = [
        ("/sonar", bag_ns(0.2 + 0.1 * n), words.range(0.2 + 0.1 * n, value))
        for n, value in enumerate(told)
    ]
    path = write_bag(tmp_path, "db3", still("db3", found))
    (mount,) = open_bag(path, FOUR, None).mounts
    assert mount.angle == 0.0
    samples, tally = read(path)
    assert ranges_of(samples) == [0.5, -2, -2, -2]
    assert tally.of(INVALID) == 4


def test_several_need_their_angles(tmp_path: Path) -> None:
    words = words_of("bag")
    found: list[Message] = [
        (topic, bag_ns(t), words.range(t, value))
        for t in (0.2, 0.3)
        for topic, value in (("/left", 0.5), ("/right", 1.5))
    ]
    path = write_bag(tmp_path, "bag", still("bag", found))
    assert "--topic TOPIC:angle=DEGREES" in refusal(path)
    assert "angle=" in refusal(path, topics_of("/odom", "/left", "/right:angle=-90"))
    mapping = topics_of("/right:angle=-90", "/odom", "/left:angle=90")
    angles = [math.degrees(mount.angle) for mount in open_bag(path, FOUR, mapping).mounts]
    assert angles == pytest.approx([-90, 90])
    samples, _ = read(path, mapping)
    assert (set(ranges_of(samples, 0)), set(ranges_of(samples, 1))) == ({1.5}, {0.5})


@pytest.mark.parametrize("form", FORMATS)
def test_fields_of_a_type_that_only_the_bag_knows(tmp_path: Path, form: str) -> None:
    words = words_of(form)
    told: list[Message] = [
        ("/state", bag_ns(0.1 * n), words.raw(0.1 * n, n, 2 * n, 0.5, 3.0)) for n in range(5)
    ]
    path = write_bag(tmp_path, form, told)
    mapping = topics_of("/state:x=raw[0],y=raw[1],yaw=raw[2],range@90=raw[3]")
    samples, _ = read(path, mapping)
    assert samples.x.tolist() == [0, 1, 2, 3, 4]
    assert samples.y.tolist() == [0, 2, 4, 6, 8]
    assert samples.yaw == pytest.approx([0.5] * 5)
    assert samples.ranges.tolist() == [[3.0]] * 5
    assert samples.t == pytest.approx(START_S + 0.1 * np.arange(5))


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ("x=rwa[0],y=raw[1]", "has the fields header, raw, fixed, from, did you mean"),
        ("x=raw[9],y=raw[1]", "expected an index below 2, as in the first message"),
        ("x=fixed[3],y=raw[1]", "expected an index below 3"),
        ("x=raw,y=raw[1]", "found a list, expected a number"),
        ("x=header,y=raw[1]", "std_msgs/Header with the fields"),
        ("x=from,y=raw[1]", "found a string, expected a number"),
        ("x=raw[0].x,y=raw[1]", "expected a message before .x"),
        ("x=header.stamp[0],y=raw[1]", "expected a list before [0]"),
    ],
)
def test_a_field_that_does_not_exist_is_refused(tmp_path: Path, fields: str, told: str) -> None:
    words = words_of("mcap")
    path = write_bag(tmp_path, "mcap", [("/state", bag_ns(0), words.raw(0, 1, 2))])
    problem = refusal(path, topics_of(f"/state:{fields}"))
    assert "topic /state" in problem
    assert told in problem


def test_lists_that_become_shorter_are_skipped_and_counted(tmp_path: Path) -> None:
    words = words_of("bag")
    lengths = (3, 3, 1, 3)
    told: list[Message] = [
        ("/s", bag_ns(n), words.raw(n, *([1.0] * length))) for n, length in enumerate(lengths)
    ]
    path = write_bag(tmp_path, "bag", told)
    samples, tally = read(path, topics_of("/s:x=raw[0],y=raw[2]"))
    assert len(samples) == 3
    count = tally.counts["messages without a field that is named, skipped"]
    assert (count.count, count.first) == (1, f"{path} /s:3")


def test_named_times_are_read_by_their_unit(tmp_path: Path) -> None:
    words = words_of("bag")
    told: list[Message] = [("/s", bag_ns(n), words.raw(n, 10 * n, 1.0)) for n in range(3)]
    path = write_bag(tmp_path, "bag", told)
    own = topics_of("/s:t=raw[0],x=raw[1],y=raw[1]", units=Units(time="ms"))
    assert read(path, own)[0].t == pytest.approx([0, 0.01, 0.02])
    stamp = topics_of("/s:t=header.stamp,x=raw[1],y=raw[1]", units=Units(time="ms"))
    assert read(path, stamp)[0].t == pytest.approx(START_S + np.arange(3))


@pytest.mark.parametrize("form", FORMATS)
def test_where_nobody_stamps_the_bags_clock_is_taken(tmp_path: Path, form: str) -> None:
    words = words_of(form)
    told = [("/odom", bag_ns(n), words.odometry(None, n)) for n in range(12)]
    samples, tally = read(write_bag(tmp_path, form, told))
    assert samples.t == pytest.approx(START_S + BAG_LATER_S + np.arange(12))
    assert tally.of("messages stamped 0, the bag's own time taken") == 12


@pytest.mark.parametrize("form", ["bag", "db3"])
def test_a_bag_that_was_cut_short_is_refused(tmp_path: Path, form: str) -> None:
    path = write_bag(tmp_path, form, drive(form, 300))
    data = path.read_bytes()
    advice = {"bag": "`rosbag reindex`", "db3": "`ros2 bag reindex`"}
    for share in (0.3, 0.6, 0.9):
        path.write_bytes(data[: int(len(data) * share)])
        assert advice[form] in refusal(path), share


@pytest.mark.parametrize("compression", ["", "storage"])
def test_of_an_mcap_that_was_cut_short_the_rest_is_read(tmp_path: Path, compression: str) -> None:
    path = write_bag(tmp_path, "mcap", drive("mcap", 6000), compression)
    whole, data = read(path)[0], path.read_bytes()
    counts = []
    for share in (0.35, 0.6, 0.8):
        path.write_bytes(data[: int(len(data) * share)])
        samples, tally = read(path)
        count = len(samples)
        assert samples.t == pytest.approx(whole.t[:count])
        assert samples.x == pytest.approx(whole.x[:count])
        cut = "bytes at the end of a bag that was cut short, left out; `mcap recover` may find more"
        assert 0 <= tally.of(cut) < len(data) * share
        counts.append(count)
    assert 0 < counts[0] < counts[1] < counts[2] < len(whole)


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("a.bag", b"", "is empty"),
        ("a.mcap", b"", "is empty"),
        ("a.bag", b"t,x,y\n1,2,3\n", "not a ROS bag"),
        ("a.bag", b"#ROSBAG V1.2\n" + bytes(100), "not supported"),
        ("a.bag", b"#ROSBAG V2.0\n", "`rosbag reindex`"),
        ("a.bag", b"#ROSBAG V2.0\n\xff\xff\xff\xff", "`rosbag reindex`"),
        ("a.mcap", b"\x89MCAP0\r\n", "cannot be read as a bag"),
        ("a.mcap", b"\x89MCAP0\r\n\x01" + b"\xff" * 60, "cannot be read as a bag"),
        ("a.mcap", b"SQLite format 3\0" + bytes(100), "expected .db3"),
        ("a.db3", b"SQLite format 3\0" + b"\xff" * 100, "file is not a database"),
        ("a.db3.zstd", b"\x28\xb5\x2f\xfd" + bytes(50), "compressed as a whole"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str, data: bytes, told: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    assert told in refusal(path)


def test_what_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "absent.bag")
    assert "`ros2 bag reindex`" in refusal(tmp_path)
    os.mkfifo(tmp_path / "pipe.bag")
    assert "not a regular file" in refusal(tmp_path / "pipe.bag")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 3}")
    assert "metadata key is missing" in refusal(tmp_path)
    (tmp_path / "metadata.yaml").write_text("just: [words")
    assert "cannot be read as a bag" in refusal(tmp_path)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("UPDATE messages SET timestamp = 'noon'", "do not fit together (TypeError in rosbags)"),
        (
            "INSERT INTO messages VALUES (999, 1, 'noon', x'0001')",
            'the time of a message, found "noon"',
        ),
        ("UPDATE topics SET type = x'00'", 'a topic "/odom" of type a bytes with 30 messages'),
        ("UPDATE topics SET serialization_format = 'xml'", 'found messages written as "xml"'),
        ("UPDATE messages SET data = 7", "no message can be read"),
    ],
)
def test_a_database_that_holds_something_else_is_refused(
    tmp_path: Path, change: str, told: str
) -> None:
    path = write_bag(tmp_path, "db3", drive("db3", scans=False))
    base = sqlite3.connect(path, isolation_level=None)
    base.execute(change)
    base.close()
    assert told in refusal(path)


def test_an_index_that_leads_to_another_topic_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "bag", drive("bag", scans=True))
    data = path.read_bytes()
    told = []
    for one, other in ((0, 1), (1, 0)):
        field = b"conn=" + one.to_bytes(4, "little")
        at = data.find(field)
        while at >= 0:
            changed = b"conn=" + other.to_bytes(4, "little")
            path.write_bytes(data[:at] + changed + data[at + len(field) :])
            try:
                read(path)
            except RecordingError as error:
                told.append(str(error))
            at = data.find(field, at + 1)
    assert any("the index leads to topic" in one for one in told), told


def test_a_chunk_that_does_not_decompress_is_refused(tmp_path: Path) -> None:
    for form, compression in (("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage")):
        folder = tmp_path / compression
        folder.mkdir()
        path = write_bag(folder, form, drive(form), compression)
        data = bytearray(path.read_bytes())
        magic = {"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18", "storage": b"\x28\xb5\x2f\xfd"}
        at = data.index(magic[compression])
        data[at + 4 : at + 60] = b"\xff" * 56
        path.write_bytes(data)
        assert refusal(path).startswith("damaged: ")


@pytest.mark.parametrize("form", FORMATS)
def test_some_unreadable_messages_are_skipped_and_counted(tmp_path: Path, form: str) -> None:
    told = list(drive(form, 100, scans=False))
    told[20:25] = [("/odom", stamp, (bags.ODOMETRY, b"\0\1\0\0abc")) for _, stamp, _ in told[20:25]]
    path = write_bag(tmp_path, form, told)
    samples, tally = read(path)
    assert len(samples) == 95
    count = tally.counts["messages that cannot be read, skipped"]
    assert (count.count, count.first) == (5, f"{path} /odom:21")


def test_many_unreadable_messages_are_refused(tmp_path: Path) -> None:
    told = list(drive("bag", 300, scans=False))
    bad = [("/odom", stamp, (bags.ODOMETRY, b"abc")) for _, stamp, _ in told]
    path = write_bag(tmp_path, "bag", bad)
    assert 'topic "/odom": no message can be read' in refusal(path)
    later = tmp_path / "later"
    later.mkdir()
    path = write_bag(later, "bag", told[:50] + bad[50:])
    assert "100 messages in a row that cannot be read" in refusal(path)


def test_a_definition_that_cannot_be_understood_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "bag", drive("bag"))
    data = path.read_bytes()
    path.write_bytes(data.replace(b"MSG: geometry_msgs/PoseW", b"MSG: geometry_msgs/XoseW"))
    assert "the definition of nav_msgs/Odometry cannot be understood" in refusal(path)


def test_other_topics_may_have_definitions_that_nobody_understands(tmp_path: Path) -> None:
    extra = [("/odd", bag_ns(0), words_of("bag").raw(0, 1))]
    path = write_bag(tmp_path, "bag", still("bag", extra))
    path.write_bytes(path.read_bytes().replace(b"float32[3] fixed", b"float32[?] f!xed"))
    assert len(read(path)[0]) == 30


@pytest.mark.filterwarnings("default")
def test_without_rosbags_the_command_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path, "bag", drive("bag"))
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    assert "pip install 'possmap[ros]'" in refusal(path)


def old(path: Path) -> Path:
    """Make a database one that does not define its types, as before ROS 2 Iron."""
    base = sqlite3.connect(path)
    base.execute("UPDATE schema SET schema_version = 3")
    base.execute("DROP TABLE message_definitions")
    base.commit()
    base.close()
    return path


def test_standard_types_are_known(tmp_path: Path) -> None:
    path = old(write_bag(tmp_path, "db3", drive("db3")))
    samples, _ = read(path)
    assert samples.ranges[1] == pytest.approx([1.09, 1.18, 1.27, 1.0], abs=1e-6)


def test_other_types_are_refused(tmp_path: Path) -> None:
    words = words_of("db3")
    extra = [("/s", bag_ns(0), words.raw(0, 1, 2))]
    path = old(write_bag(tmp_path, "db3", still("db3", extra)))
    problem = refusal(path, topics_of("/s:x=raw[0],y=raw[1]"))
    assert "the bag does not say what robots/Raw consists of" in problem


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("form", "count", "most"),
    # rosbags keeps the index of a .bag, some 200 bytes for each message, and chunks of 1 MB
    [("db3", 50_000, 5e6), ("mcap", 20_000, 8e6), ("bag", 20_000, 12e6)],
)
def test_messages_are_not_kept(tmp_path: Path, form: str, count: int, most: float) -> None:
    words = words_of(form)
    write = words.store.serialize_ros1 if form == "bag" else words.store.serialize_cdr
    pair = [
        (topic, (type_, bytes(write(message, type_))))
        for topic, type_, message in (
            ("/odom", bags.ODOMETRY, words.odometry(None, 1.0)),
            ("/scan", bags.SCAN, words.scan(None, [1.0] * 360)),
        )
    ]
    told = ((pair[n % 2][0], bag_ns(0.01 * n), pair[n % 2][1]) for n in range(count))
    recording = open_bag(write_bag(tmp_path, form, told), FOUR, None)
    assert recording.size > 1.5 * most
    tracemalloc.start()
    try:
        found = sum(len(part) for part in recording.samples(Tally(), None))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found == count - 1
    assert peak < most


def test_roles_beams_and_angles() -> None:
    table = table_of("/s:x=raw[0],y=pose.y, qw=q[3].w ,range@-90=raw[2],range@0.5=range")
    assert table.source == "/s"
    assert table.columns == {"x": "raw[0]", "y": "pose.y", "qw": "q[3].w"}
    assert [beam.column for beam in table.beams] == ["raw[2]", "range"]
    angles = [math.degrees(beam.angle) for beam in table.beams]
    assert angles == pytest.approx([-90, 0.5])
    assert table_of("/sonar:angle=45").mount == SeatedAt(angle_deg=math.radians(45))
    at = SeatedAt(angle_deg=-math.pi / 2, x=0.25, y=-1.0)
    assert table_of("/s:angle=-90, at_x=0.25,at_y=-1").mount == at
    assert table_of("/s:at_y=0.5").mount == SeatedAt(y=0.5)
    assert table_of("/tf:odom.base_link").frames == "odom.base_link"
    assert table_of("/s").mount is None


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("", "expected TOPIC"),
        (":x=a", "expected TOPIC"),
        ("/s:", "expected TOPIC"),
        ("/s:x", 'found "x", expected ROLE=FIELD'),
        ("/s:x=a,", 'found "", expected ROLE=FIELD'),
        ("/s:x=a,x=b", 'found "x" twice'),
        ("/s:forwrd=a", 'ROLE, found "forwrd", expected one of t, x,'),
        ("/s:forwrd=a", 'did you mean "forward"?'),
        ("/s:range=a", "expected range@DEGREES"),
        ("/s:range@=a", "expected degrees"),
        ("/s:range@nan=a", "expected degrees"),
        ("/s:range@1e9=a", "expected degrees"),
        ("/s:angle=left", "expected degrees"),
        ("/s:angle=9,x=a", "found angle beside other roles"),
        ("/s:range@0=a,at_x=1", "found at_x beside other roles"),
        ("/s:at_x=left", '"at_x", found "left", expected metres'),
        ("/s:at_x=nan", "expected metres"),
        ("/s:at_y=-10.5", "expected metres"),
        ("/s:at_z=1", "expected one of t, x,"),
        ("/s:x=a..b", "expected a path"),
        ("/s:x=a[x]", "expected a path"),
        ("/s:x=__class__", "expected a path"),
    ],
)
def test_what_cannot_be_understood_is_refused(option: str, told: str) -> None:
    with pytest.raises(SettingsError, match=f"^--topic: .*{re.escape(told)}"):
        table_of(option)


real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no recordings in {REAL}")

FLIGHT = (
    "/crazyflie2/state_xyzv:x=raw[0],y=raw[1],vx=raw[3],vy=raw[4]",
    "/crazyflie2/state_ranger_qxyzw:qx=raw[5],qy=raw[6],qz=raw[7],qw=raw[8],"
    "range@-90=raw[0],range@0=raw[1],range@90=raw[2],range@180=raw[3]",
)


@real
@pytest.mark.parametrize(("name", "metres"), [("olsson-3loop", 295), ("rice", 194)])
def test_a_bag_says_what_its_csv_says(name: str, metres: float) -> None:
    samples, tally = read(REAL / f"{name}.bag", topics_of(*FLIGHT, guard=0.0))
    place = np.loadtxt(REAL / f"{name}_state_xyzv.csv", delimiter=",")
    turning = np.loadtxt(REAL / f"{name}_state_ranger_qxyzw.csv", delimiter=",")
    wanted = np.searchsorted(samples.t, place[1:-1, 0] - 2e-6)
    assert samples.t[wanted] == pytest.approx(place[1:-1, 0], abs=2e-6)
    assert samples.x[wanted] == pytest.approx(place[1:-1, 1], abs=1e-5)
    assert samples.y[wanted] == pytest.approx(place[1:-1, 2], abs=1e-5)
    seen = np.flatnonzero(~np.isnan(samples.ranges).all(axis=1))
    wanted = np.searchsorted(turning[:, 0], samples.t[seen] - 2e-6)
    assert len(seen) >= len(turning) - 2
    given = samples.ranges[seen]
    same = np.where(np.isnan(given), 0.0, given)  # a reading of 0 is none
    assert same == pytest.approx(turning[wanted, 1:5], abs=1e-5)
    qx, qy, qz, qw = turning[wanted, 6:10].T
    yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2))
    off = np.angle(np.exp(1j * (samples.yaw[seen] - yaw)))
    assert np.abs(off).max() < 1e-5
    way = np.hypot(np.diff(samples.x), np.diff(samples.y)).sum()
    assert way == pytest.approx(metres, rel=0.02)
    assert set(tally.counts) <= {INVALID, "rows of ranges too far in time from a pose, dropped"}
