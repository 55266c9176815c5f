"""Bags that hold what they may not: refused in one line; what real bags hold goes through."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import Message, bag_ns, words_of, write_bag

from possmap.errors import RecordingError
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.rosbag.recording import open_bag
from possmap.lab.recordings.rosbag.untrusted import UntrustedError, check_text, check_types

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
    with pytest.raises(UntrustedError, match=told.replace("(", r"\(") + "$"):
        check_text(IDL.replace(*change), is_idl=True)


@pytest.mark.parametrize(
    ("name", "field"),
    [("m/msg/X\nimport os", "a"), ("m/msg/X", "a = os.abort()"), ('m/msg/X"', "a")],
)
def test_names_that_are_none_do_not_become_code(name: str, field: str) -> None:
    with pytest.raises(UntrustedError, match="whose name is none"):
        check_types({name: ([], [(field, (1, ("int32", 0)))])})  # type: ignore[list-item]


def spoilt(message: Any, value: float) -> Iterator[tuple[str, Any]]:
    """Yield the name of each number in a message, the message changed there; then mend it."""
    for name, held in list(vars(message).items()):
        if is_dataclass(held):
            yield from ((f"{name}.{inner}", message) for inner, _ in spoilt(held, value))
        elif isinstance(held, float) or (isinstance(held, np.ndarray) and held.dtype.kind == "f"):
            changed = np.full_like(held, value) if isinstance(held, np.ndarray) else value
            setattr(message, name, changed)
            yield name, message
            setattr(message, name, held)


@pytest.mark.parametrize("value", [math.nan, -math.inf, 1e300])
def test_whatever_number_a_field_holds_a_bag_is_read_or_refused(
    tmp_path: Path, value: float
) -> None:
    words = words_of("mcap")
    hung = ("base_link", "laser", (0.25, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    told = {
        "/tf_static": words.transforms(hung),
        "/odom": words.odometry(0.0, 1.0, body="base_link"),
        "/scan": words.scan(0.0, [1.0] * 36, frame="laser"),
        "/sonar": words.range(0.0, 1.0, frame="base_link"),
    }
    parts = {**told, "/tf_static": told["/tf_static"].transforms[0]}
    small = abs(value) < 1e30 or not math.isfinite(value)
    number = 0
    for topic in told:
        for _name, _ in spoilt(parts[topic], value if small else 1e30):
            number += 1
            folder = tmp_path / str(number)
            folder.mkdir()
            messages: list[Message] = [
                (one, bag_ns(t), told[one]) for t in (0.0, 1.0, 2.0) for one in told
            ]
            bag = write_bag(folder, "mcap", messages)
            with suppress(RecordingError):
                for samples in open_bag(bag, (0.0,), None).samples(Tally(), None):
                    assert np.isfinite([samples.t, samples.x, samples.y, samples.yaw]).all()
    assert number > 25
