"""Bags that hold more than they may: refused in one line; what real bags hold goes through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bags import bag_ns, words_of, write_bag

from possmap.errors import RecordingError
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.rosbag import unpack
from possmap.lab.recordings.rosbag.definitions import DefinitionError, check_text, check_types
from possmap.lab.recordings.rosbag.recording import open_bag

IDL = """
// generated from rosidl_adapter/resource/msg.idl.em ("as a rule")
#include "builtin_interfaces/msg/Time.idl"
module m { module msg {
  @verbatim (language="comment", text=
    "A number (of some kind), see \\"above\\" (or below)" "\\n" "a << b")
  struct X {
    @default (value=0.5) @unit (value="m")
    double a;
    sequence<double, 36> b;
    /* (one) */ builtin_interfaces::msg::Time c;
  };
}; };
"""


def refusal(path: Path) -> str:
    """Return how a bag is refused, while it is opened or read."""
    with pytest.raises(RecordingError) as caught:
        list(open_bag(path, (), None).samples(Tally(), None))
    assert str(caught.value).isprintable()
    return caught.value.problem


def drive(folder: Path, compression: str) -> Path:
    words = words_of("db3")
    messages = [("/odom", bag_ns(n), words.odometry(n, 0.1 * n)) for n in range(9)]
    return write_bag(folder, "folder", messages, compression)


def test_a_file_that_unpacks_to_more_than_it_may_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = drive(tmp_path, "file")
    monkeypatch.setattr(unpack, "LARGEST_RATIO", 0)
    monkeypatch.setattr(unpack, "LARGEST_CHUNK", 5000)
    told = "cannot be read as a bag: a compressed file holds more than 5000 bytes"
    assert refusal(bag) == told


def test_a_message_that_unpacks_to_more_than_it_may_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = drive(tmp_path, "message")
    monkeypatch.setattr(unpack, "LARGEST_CHUNK", 100)
    assert "holds more than 100" in refusal(bag)


def test_definitions_as_ros_writes_them_are_taken() -> None:
    check_text(IDL, is_idl=True)
    check_text("float64 LIMIT=0.5  # (metres) << 1\nfloat64[] a\n", is_idl=False)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("double a;", "double a[(2)];"), "found ( in an expression, expected plain values"),
        (("36", "1 << 36"), "found << in an expression, expected plain values"),
        (("value=0.5", "value=(0.5)"), "found ( in an expression, expected plain values"),
        (("double a;", "double a;" * 120_000), "expected at most 1048576"),
    ],
)
def test_definitions_that_compute_are_refused(change: tuple[str, str], told: str) -> None:
    with pytest.raises(DefinitionError, match=told.replace("(", r"\(") + "$"):
        check_text(IDL.replace(*change), is_idl=True)


@pytest.mark.parametrize(
    ("name", "field"),
    [("m/msg/X\nimport os", "a"), ("m/msg/X", "a = os.abort()"), ('m/msg/X"', "a")],
)
def test_names_that_are_none_do_not_become_code(name: str, field: str) -> None:
    with pytest.raises(DefinitionError, match="whose name is none"):
        check_types({name: ([], [(field, (1, ("int32", 0)))])})  # type: ignore[list-item]


def test_readers_of_others_keep_their_profiles_of_quality() -> None:
    from rosbags.rosbag2 import reader, storage_mcap, storage_sqlite3

    modules: list[Any] = [reader, storage_mcap, storage_sqlite3]
    before = [module.parse_qos for module in modules]
    with unpack.bounded_ros2():
        assert all(module.parse_qos is not before[0] for module in modules)
    assert [module.parse_qos for module in modules] == before
