"""Bags that unpack to more than fits: refused before rosbags unpacks them."""

from __future__ import annotations

import bz2
import sqlite3
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import lz4.frame
import pytest
from bags import bag_ns, words_of, write_bag

from possmap.errors import RecordingError
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.rosbag import unpacking
from possmap.lab.recordings.rosbag.cut import MAGIC
from possmap.lab.recordings.rosbag.recording import open_bag

BOMB = 300 << 20
"""What the bombs unpack to: a chunk or a message of more than 256 MiB is none."""

BEGINS = {"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18", "storage": b"\x28\xb5\x2f\xfd"}


def bomb(compression: str) -> bytes:
    """Return some kilobytes of which zeros without end are made."""
    if compression == "bz2":
        return bz2.compress(bytes(BOMB))
    if compression == "lz4":
        return bytes(lz4.frame.compress(bytes(BOMB)))
    block = ((131_072 << 3) | 2).to_bytes(3, "little") + b"\0"  # one byte, 131,072 times
    return BEGINS["storage"] + b"\0\x38" + block * (BOMB // 131_072)


def drive(folder: Path, form: str, compression: str) -> Path:
    """Write a bag of some odometry."""
    words = words_of(form)
    told = [("/odom", bag_ns(n), words.odometry(n, 0.1 * n)) for n in range(30)]
    return write_bag(folder, form, told, compression)


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        list(open_bag(path, (), None).samples(Tally(), None))
    return caught.value.problem


@pytest.mark.parametrize(
    ("form", "compression"),
    [("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage"), ("folder", "message")],
)
def test_a_bomb_is_refused_before_it_goes_off(tmp_path: Path, form: str, compression: str) -> None:
    path = drive(tmp_path, form, compression)
    packed = bomb(compression)
    assert len(packed) < BOMB / 200
    if form == "folder":
        base = sqlite3.connect(next(path.glob("*.db3")), isolation_level=None)
        base.execute("UPDATE messages SET data = ? WHERE id = 5", [packed])
        base.close()
    else:
        data = path.read_bytes()
        at = data.index(BEGINS[compression])
        path.write_bytes(data[:at] + packed + data[at:])
    tracemalloc.start()
    try:
        told = refusal(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert told == (
        "cannot be read as a bag: found compressed data of more than 256 MiB, expected chunks of "
        "some MiB"
    )
    assert peak < BOMB / 2


def test_a_bag_compressed_as_a_whole_must_fit_beside_what_lies_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = drive(tmp_path, "folder", "file")
    for free in (1 << 30, 0):
        monkeypatch.setattr(
            unpacking, "disk_usage", lambda _, free=free: SimpleNamespace(free=free)
        )
        if free:
            open_bag(path, (), None)
    assert "found compressed data of more than 0 MiB" in refusal(path)


def test_streams_within_one_another_do_not_take_for_ever(tmp_path: Path) -> None:
    path = drive(tmp_path, "mcap", "")
    block = ((131_072 << 3) | 2).to_bytes(3, "little") + b"\0"
    streams = (BEGINS["storage"] + b"\0\x38" + block * 99) * 500
    path.write_bytes(path.read_bytes() + streams + MAGIC)  # it ends as a whole one does
    assert "found compressed data in one another" in refusal(path)
