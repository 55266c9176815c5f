"""A partial map sent to another process arrives as it left, and is opened only when needed."""

from __future__ import annotations

import pickle
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from possmap.core.records import Beam, Corner, Meet, PartialMap, Pose, Wall
from possmap.logs import Parcel, read_log
from possmap.settings.limits import Limits

numbers = st.floats(-1e6, 1e6)
times = st.none() | numbers
extras = st.sampled_from(["", '{"x_battery": 0.4}'])
records = st.one_of(
    st.builds(Pose, st.integers(0), times, *[numbers] * 6, extras),
    st.builds(Wall, st.integers(0), times, *[numbers] * 4, st.booleans(), extras),
    st.builds(Beam, st.integers(0), times, *[numbers] * 4, st.booleans(), extras),
    st.builds(Corner, st.integers(0), times, numbers, numbers, st.just("end"), extras),
    st.builds(
        Meet, st.integers(0), times, st.text(), st.text(), st.none() | st.integers(0), extras
    ),
)


@given(st.lists(records, max_size=5), st.text(), extras)
def test_a_parcel_arrives_as_it_left(some: list[Pose], robot: str, extra: str) -> None:
    version = PartialMap(robot, "1", (("along", 0.1),), tuple(some), extra)
    sent = Parcel(version)
    arrived = pickle.loads(pickle.dumps(sent))
    assert (arrived.name, arrived.own_model, arrived.count) == (
        (robot, "1"),
        version.model,
        len(some),
    )
    assert arrived.span == sent.span
    assert arrived.version == version and arrived.version.extra == extra
    assert [one.extra for one in arrived.version.records] == [one.extra for one in some]
    assert arrived == sent


def test_a_parcel_stays_shut_until_its_records_are_looked_at() -> None:
    log = read_log(Path(__file__).parents[2] / "data" / "json" / "02-r1-a.json", Limits())
    arrived = pickle.loads(pickle.dumps(log)).deliveries[0].parcel
    assert "version" not in vars(pickle.loads(pickle.dumps(arrived)))
    assert arrived.version == log.deliveries[0].version
