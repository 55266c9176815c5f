"""Tables of different times joined: the same as a slow look at one row after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Samples, joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import join as join_module
from possmap.lab.recordings.beams import BeamColumn
from possmap.lab.recordings.join import (
    SAME_TIME,
    WITHOUT_HEADING,
    WITHOUT_POSE,
    Join,
)
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.readings import Readings

GAP = 1.0
PLACE = Table(file="place", columns={"t": "t", "x": "x", "y": "y"})
POSE = Table(file="pose", columns={"t": "t", "x": "x", "y": "y", "yaw": "yaw"})
YAW = Table(file="yaw", columns={"t": "t", "yaw": "yaw"})
RANGE = Table(file="range", columns={"t": "t"}, beams=(BeamColumn(column="r", angle_deg=0.0),))
YAW_RANGE = Table(
    file="both", columns={"t": "t", "yaw": "yaw"}, beams=(BeamColumn(column="r", angle_deg=0.0),)
)
POSE_RANGE = Table(
    file="all",
    columns={"t": "t", "x": "x", "y": "y", "yaw": "yaw"},
    beams=(BeamColumn(column="r", angle_deg=0.0),),
)


@dataclass
class Rows:
    """The rows of one table: times, and for each a number that its values are made of."""

    t: list[float]
    told: list[float]

    def readings(self, table: Table, start: int = 0, stop: int | None = None) -> Readings:
        """Return what the rows from start up to stop say in a table."""
        t, told = np.array(self.t[start:stop]), np.array(self.told[start:stop])
        return Readings(
            t,
            np.column_stack([told, -2 * told]).reshape(-1, 2) if "x" in table.columns else None,
            told / 7 if "yaw" in table.columns else None,
            told[:, None] if table.beams else None,
            np.zeros(len(t)) if "x" in table.columns else None,
        )


def fed(
    tables: Sequence[Table], rows: Sequence[Rows], sizes: Sequence[int], gap: float = GAP
) -> tuple[Samples | None, Tally]:
    """Feed a join as files are read: always the table that is most behind, in blocks."""
    tally = Tally()
    widths = [(len(table.beams), 0) for table in tables]
    mapping = Mapping(format="csv", tables=tuple(tables), gap=gap)
    join = Join("drive", mapping, widths, tally, patience=math.inf)
    at = [0] * len(tables)
    open_ones = set(range(len(tables)))
    found: list[Samples] = []
    turn = 0
    while open_ones:
        behind = min(open_ones, key=join.reach)
        if at[behind] == len(rows[behind].t):
            open_ones.remove(behind)
            join.close(behind)
            continue
        stop = at[behind] + sizes[turn % len(sizes)]
        turn += 1
        join.feed(behind, rows[behind].readings(tables[behind], at[behind], stop))
        at[behind] = min(stop, len(rows[behind].t))
        found += join.samples()
    found += join.samples(last=True)
    return (joined(found) if found else None), tally


def between(t: float, rows: Rows) -> float:
    """Return what rows say at a moment, linearly between the two around it."""
    if t <= rows.t[0]:
        return rows.told[0]
    for k in range(1, len(rows.t)):
        if t <= rows.t[k]:
            share = (t - rows.t[k - 1]) / (rows.t[k] - rows.t[k - 1])
            return rows.told[k - 1] + share * (rows.told[k] - rows.told[k - 1])
    return rows.told[-1]


def enclosed(t: float, rows: Rows, gap: float) -> bool:
    """Whether a moment is one of the rows, or lies between two near ones."""
    if t in rows.t:
        return True
    return any(
        a < t < b and min(t - a, b - t) <= gap for a, b in zip(rows.t, rows.t[1:], strict=False)
    )


def literally(
    tables: Sequence[Table], rows: Sequence[Rows], gap: float
) -> tuple[list[tuple[float, ...]], int, int]:
    """Return each sample (t, x, y, yaw, ranges), and how many rows lack a pose or a heading."""
    place = next(k for k, table in enumerate(tables) if "x" in table.columns)
    yaw = next(k for k, table in enumerate(tables) if "yaw" in table.columns)
    without_pose = without_heading = 0
    ranged = [k for k, table in enumerate(tables) if table.beams]
    samples: dict[float, list[float]] = {}
    if not rows[place].t or not rows[yaw].t:
        return [], -1, -1
    end = min(rows[place].t[-1], rows[yaw].t[-1])
    for t in rows[place].t:
        if t <= end:
            samples[t] = [math.nan] * len(ranged)
        else:
            without_heading += 1
    for column, k in enumerate(ranged):
        for t, told in zip(rows[k].t, rows[k].told, strict=True):
            if k == place:
                if t <= end:
                    samples[t][column] = told
            elif math.isnan(told):
                continue
            elif t <= end and enclosed(t, rows[place], gap) and enclosed(t, rows[yaw], gap):
                samples.setdefault(t, [math.nan] * len(ranged))[column] = told
            else:
                without_pose += 1
    found = []
    for t in sorted(samples):
        x = between(t, rows[place])
        found.append((t, x, -2 * x, between(t, rows[yaw]) / 7, *samples[t]))
    return found, without_pose, without_heading


ticks = st.lists(st.integers(0, 60), max_size=14, unique=True).map(sorted)
told = st.integers(-50, 50).map(float)


@st.composite
def some_rows(draw: st.DrawFn, nothing: bool = False) -> Rows:
    t = [n / 8 for n in draw(ticks)]
    value = told | st.just(math.nan) if nothing else told
    return Rows(t, [draw(value) for _ in t])


KINDS = {
    "pose alone": (POSE,),
    "pose and ranges in one": (POSE_RANGE,),
    "pose, ranges": (POSE, RANGE),
    "ranges, pose": (RANGE, POSE),
    "place, heading": (PLACE, YAW),
    "place, heading with ranges": (PLACE, YAW_RANGE),
    "place, heading, ranges": (PLACE, YAW, RANGE),
    "pose, ranges, ranges": (POSE, RANGE, RANGE),
    "ranges, heading with ranges, place": (RANGE, YAW_RANGE, PLACE),
}


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data(), sizes=st.lists(st.integers(1, 6), min_size=1, max_size=5))
def test_samples_are_those_of_a_literal_look(
    kind: str, data: st.DataObject, sizes: list[int]
) -> None:
    tables = KINDS[kind]
    rows = [data.draw(some_rows(nothing=table is RANGE)) for table in tables]
    gap = data.draw(st.sampled_from([0.125, 0.5, 1.0, 100.0]))
    expected, without_pose, without_heading = literally(tables, rows, gap)
    samples, tally = fed(tables, rows, sizes, gap)
    if not expected:
        assert samples is None or not len(samples)
    else:
        assert samples is not None
        got = np.column_stack([samples.t, samples.x, samples.y, samples.yaw, samples.ranges])
        np.testing.assert_allclose(got, np.array(expected), rtol=0, atol=1e-9)
    if without_pose >= 0:
        assert tally.of(WITHOUT_POSE) == without_pose
        assert tally.of(WITHOUT_HEADING) == without_heading


@given(
    times=st.lists(st.integers(0, 12), min_size=1, max_size=30).map(sorted),
    sizes=st.lists(st.integers(1, 5), min_size=1, max_size=4),
)
@example(times=[0, 0, 1, 1], sizes=[1])
def test_rows_of_one_time_are_one_sample_however_they_are_fed(
    times: list[int], sizes: list[int]
) -> None:
    rows = Rows([float(t) for t in times], [float(n) for n in range(len(times))])
    samples, tally = fed((POSE_RANGE,), [rows], sizes)
    assert samples is not None
    last = {t: float(n) for n, t in enumerate(times)}
    assert samples.t.tolist() == sorted(last)
    assert samples.x.tolist() == samples.ranges[:, 0].tolist() == [last[t] for t in sorted(last)]
    assert tally.of(SAME_TIME) == len(times) - len(last)


def test_headings_that_end_early_end_the_track_and_the_rest_is_counted_not_kept() -> None:
    place, yaw = Rows(list(range(500)), list(range(500))), Rows([0, 10, 20], [0, 1, 2])
    mapping = Mapping(format="csv", tables=(PLACE, YAW))
    join = Join("drive", mapping, [(0, 0)] * 2, tally := Tally(), math.inf)
    join.feed(1, yaw.readings(YAW))
    join.close(1)
    count = 0
    for start in range(0, 500, 10):
        join.feed(0, place.readings(PLACE, start, start + 10))
        count += sum(map(len, join.samples()))
        assert join.waiting < 25
    assert count + sum(map(len, join.samples(last=True))) == 21
    assert tally.of(WITHOUT_HEADING) == 479


def late(patience: float) -> tuple[list[float], Tally]:
    """Feed ranges that stop for a minute, and come again late."""
    tally = Tally()
    join = Join(
        "drive", Mapping(format="csv", tables=(POSE, RANGE)), [(0, 0), (1, 0)], tally, patience
    )
    pose = Rows(list(range(60)), list(range(60)))
    times: list[float] = []
    for k in range(60):
        join.feed(0, pose.readings(POSE, k, k + 1))
        if k in (1, 59):
            # The second time one row is from where samples were given out already.
            rows = Rows([0.5, 1.5], [1, 2]) if k == 1 else Rows([30.5, 48.75, 58.5], [3, 4, 5])
            join.feed(1, rows.readings(RANGE))
        times += [t for part in join.samples() for t in part.t.tolist()]
    times += [t for part in join.samples(last=True) for t in part.t.tolist()]
    return times, tally


def test_a_topic_that_stops_is_waited_for_no_longer_than_is_patient() -> None:
    times, tally = late(10.0)
    assert times == sorted(times)
    assert set(times) == {*range(60), 0.5, 1.5, 48.75, 58.5}
    assert tally.of(WITHOUT_POSE) == 1


def test_a_file_is_waited_for_however_long_it_takes() -> None:
    times, tally = late(math.inf)
    assert times == sorted(times)
    assert set(times) == {*range(60), 0.5, 1.5, 30.5, 48.75, 58.5}
    assert tally.counts == {}


def test_tables_that_never_meet_are_refused_before_memory_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(join_module, "MOST_WAITING", 100)
    join = Join("drive.bag", Mapping(format="csv", tables=(PLACE, YAW)), [(0, 0)] * 2, Tally())
    rows = Rows(list(range(200)), list(range(200)))
    for start in range(0, 100, 10):
        join.feed(0, rows.readings(PLACE, start, start + 10))
        assert list(join.samples()) == []
    join.feed(0, rows.readings(PLACE, 100))
    with pytest.raises(RecordingError) as caught:
        list(join.samples())
    assert str(caught.value) == (
        'drive.bag: "yaw" says nothing for 100 rows of the others, expected tables of one time'
    )
