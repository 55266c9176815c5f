"""Work grows with what a file holds, not with the product of two counts of it (docs/trust.md).

Counted are records looked at and copied, rows read and bans asked: no clock decides.
"""

from __future__ import annotations

import hashlib
import pickle
import sqlite3
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from teams import digest
from versions import SETTINGS, log_of, outcomes, prefix, written

import possmap
from possmap.budget import LEAST_MIB, Budget
from possmap.core.records import PartialMap, Pose, Wall
from possmap.fusing.admission import MOST_NAMED
from possmap.fusing.forget import Target, forget
from possmap.fusing.fuse import fuse
from possmap.grid.arrivals import Again, Arrivals, Event, Part, replayed
from possmap.grid.forgotten import Bans, Forgotten
from possmap.grid.grid import Grid
from possmap.grid.rows import record_of_row
from possmap.logs import Parcel
from possmap.logs.delivery import Origin

MANY = 300
AT = "2026-01-01T00:00:00+00:00"


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count what is done to records: ``==``, copies into beginnings, rows parsed."""
    counts: Counter[str] = Counter()
    for kind in (Pose, Wall):
        monkeypatch.setattr(kind, "__eq__", counting(counts, "compared", kind.__eq__))

    def copied(version: PartialMap, count: int) -> PartialMap:
        counts["copied"] += count
        return beginning(version, count)

    beginning = PartialMap.prefix
    monkeypatch.setattr(PartialMap, "prefix", copied)
    rows = counting(counts, "rows", record_of_row)
    monkeypatch.setattr("possmap.grid.ledger.record_of_row", rows)
    return counts


def counting(counts: Counter[str], name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def counted(*values: Any) -> Any:
        counts[name] += 1
        return function(*values)

    return counted


def crowded(folder: Path) -> Path:
    """Make a sound grid of one excursion, of which as many files as records held beginnings."""
    grid = folder / "crowded.possmap"
    possmap.fuse(written(folder, long=log_of("r1", MANY)), grid, SETTINGS)
    with closing(sqlite3.connect(grid)) as database, database:
        for number in range(2, MANY):
            sha256 = hashlib.sha256(b"%d" % number).hexdigest()
            source = number, f"{number}.json", sha256, 1, AT, "0"
            database.execute("INSERT INTO source VALUES (?, ?, ?, ?, ?, ?)", source)
            database.execute("INSERT INTO again VALUES (1, ?, ?, NULL, NULL)", (number, number))
    return grid


def scattered(folder: Path) -> Path:
    """Make a grid of format 1 of many excursions, which one file brought."""
    grid = folder / "scattered.possmap"
    possmap.fuse([crowd(folder, "carrier")], grid, SETTINGS)
    with closing(sqlite3.connect(grid)) as database:
        database.executescript(
            "DROP TABLE again; DROP TABLE forgotten; DROP INDEX part_of_excursion;"
            " PRAGMA user_version = 1"
        )
    return grid


def crowd(folder: Path, robot: str) -> Path:
    """Write the log of a robot that carried many others'."""
    others = [log_of(f"q{number}", 1) for number in range(MANY)]
    (path,) = written(folder, **{robot: {**log_of(robot, 0), "carried": others}})
    return path


def test_a_ledger_of_many_deliveries_looks_at_no_record_twice(
    tmp_path: Path, counted: Counter[str]
) -> None:
    old, new = crowded(tmp_path), tmp_path / "new.possmap"
    assert outcomes(possmap.fuse([old], new, SETTINGS)) == [("fused", MANY, 0)]
    assert digest(new) == digest(old)
    with Grid(new) as grid:
        assert len(list(grid.ledger.came.events())) == MANY - 1
    counted.clear()
    (log,) = possmap.fuse([old], new, SETTINGS).logs
    assert (log.status, log.records_new, log.records_known) == ("known", 0, MANY)
    assert counted["compared"] <= 2 * MANY and counted["copied"] <= 2 * MANY


def test_a_ledger_whose_records_came_one_by_one_adds_them_up_once(
    tmp_path: Path, counted: Counter[str]
) -> None:
    old, new = crowded(tmp_path), tmp_path / "new.possmap"
    with closing(sqlite3.connect(old)) as database, database:
        database.execute("DELETE FROM part")
        database.execute(
            "INSERT INTO part SELECT NULL, 1, source, 1, source, NULL, NULL FROM again"
        )
        database.execute("UPDATE part SET first = 0, count = 3 WHERE first = 2")
        database.execute("DELETE FROM again")
    fresh = possmap.fuse([old], new, SETTINGS)
    assert outcomes(fresh) == [("fused", MANY, 0)] and digest(new) == digest(old)
    assert counted["compared"] <= 2 * MANY and counted["copied"] <= 2 * MANY
    with Grid(new) as grid:
        parts = [arrival.part for arrival in grid.ledger.arrivals()]
    assert [part.first for part in parts] == [0, *range(3, MANY)]


def test_strict_weighs_shared_records_once(tmp_path: Path) -> None:
    least = Budget(LEAST_MIB)
    assert least.batch_records * 2 < MANY * (MANY + 1) // 2
    other = tmp_path / "other.possmap"
    summary = fuse([str(crowded(tmp_path))], other, strict=True, budget=least)
    assert summary.records_new == MANY


def test_of_a_long_excursion_no_more_is_read_than_a_log_holds(
    tmp_path: Path, counted: Counter[str]
) -> None:
    grid = crowded(tmp_path)
    short = {f"s{number}": prefix(log_of("r1", x_number=number), 2) for number in range(20)}
    counted.clear()
    summary = possmap.fuse(written(tmp_path, **short), grid)
    assert outcomes(summary) == [("known", 0, 2)] * 20
    assert counted["rows"] <= 20 * 2


def test_in_a_grid_of_format_1_what_came_is_read_once_for_many_excursions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = scattered(tmp_path)
    counts: Counter[str] = Counter()
    monkeypatch.setattr(Arrivals, "events", counting(counts, "events", Arrivals.events))
    summary = possmap.fuse([crowd(tmp_path, "other")], grid)
    assert outcomes(summary) == [("fused", 0, MANY)]
    assert counts["events"] == 1
    with Grid(grid) as opened:
        again = [event for event in opened.ledger.came.events() if isinstance(event.what, Again)]
    assert len(again) == MANY


def test_forgetting_gives_an_old_grid_its_index_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = scattered(tmp_path)
    formats: list[bool] = []
    events = Arrivals.events

    def noted(came: Arrivals, name: tuple[str, str] | None = None) -> Any:
        formats.append(came.has_index)
        return events(came, name)

    monkeypatch.setattr(Arrivals, "events", noted)
    assert forget(grid, Target(brought_by="carrier.json")).records == MANY
    assert formats == [True] * (MANY + 1)


def test_many_bans_are_looked_up_not_asked_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(written(tmp_path, r1=log_of("r1")), grid, SETTINGS)
    with closing(sqlite3.connect(grid)) as database, database:
        database.executemany(
            "INSERT INTO forgotten VALUES (NULL, ?, NULL, NULL, NULL, 1, 1, ?, '0')",
            [(f"q{number}", AT) for number in range(1, MANY)],
        )
    asked: Counter[str] = Counter()
    monkeypatch.setattr(Forgotten, "bars", counting(asked, "asked", Forgotten.bars))
    (log,) = possmap.fuse([crowd(tmp_path, "carrier")], grid).logs
    assert (log.status, log.records_new, asked["asked"]) == ("fused", 1, 0)
    assert f"{MANY - 1} excursions left out: robot q1 was forgotten, {AT}; " in (log.note or "")
    assert (log.note or "").endswith(
        f"--robot q{MOST_NAMED} --recall lets it in again; "
        f"and {MANY - 1 - MOST_NAMED} more that possmap info lists"
    )


names = st.sampled_from("ab")
bans = st.lists(
    st.one_of(
        st.builds(Forgotten, names, names | st.none(), *[st.none()] * 2, *[st.just(0)] * 2,
                  st.text(max_size=2), st.just("")),
        st.builds(Forgotten, *[st.none()] * 2, names, names, *[st.just(0)] * 2,
                  st.text(max_size=2), st.just("")),
    ),
    max_size=6,
)  # fmt: skip


@given(bans, names, names, names)
def test_the_first_ban_that_bars_is_the_one_that_is_found(
    forgotten: list[Forgotten], robot: str, excursion: str, sha256: str
) -> None:
    barring = [one for one in forgotten if one.bars((robot, excursion), sha256)]
    assert Bans(forgotten).on((robot, excursion), sha256) is (barring[0] if barring else None)


class Source(int):
    """The number of a source that counts how often it is compared."""

    compared = 0

    def __eq__(self, other: object) -> bool:
        Source.compared += 1
        return int(self) == other

    __hash__ = int.__hash__


def event(source: int, end: int) -> Event:
    origin = Origin(f"{source}.json", f"{source}", 1)
    return Event(source, ("r", "a"), Again(end, origin, None), AT, "0")


def plainly(events: list[Event]) -> list[Event]:
    """Return what ``replayed`` must, by a look at all events for each."""
    found: list[Event] = []
    for one in events:
        known = max((before.what.end for before in found), default=-1)
        of_source = [before for before in found if before.source == one.source]
        what: Part | Again = Again(one.what.end, one.what.origin, None)
        if one.what.end > known:
            first = max(known, 0)
            what = Part(first, one.what.end - first, one.what.origin, None)
        elif any(before.what.end >= one.what.end for before in of_source):
            continue
        found = [
            before
            for before in found
            if before.source != one.source or isinstance(before.what, Part)
        ]
        found.append(one._replace(what=what))
    return found


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 6)), max_size=12))
def test_events_replayed_are_those_of_the_plain_way(came: list[tuple[int, int]]) -> None:
    events = [event(source, end) for source, end in came]
    assert replayed(events) == plainly(events)


def test_events_are_replayed_without_a_look_at_all_those_before() -> None:
    events = [event(Source(number), MANY - number) for number in range(MANY)]
    Source.compared = 0
    assert len(replayed(events)) == MANY
    assert Source.compared <= 10 * MANY


def test_beginnings_are_sent_with_one_copy_of_the_whole() -> None:
    records = tuple(Pose(seq, None, seq / 2, 1.0, 0.0) for seq in range(MANY))
    whole = Parcel(PartialMap("r1", "a", (("along", 0.1),), records, '{"x_a": 1}'))
    beginnings = [whole.beginning(count) for count in range(MANY + 1)]
    sent = pickle.dumps(beginnings)
    assert len(sent) < 3 * len(pickle.dumps(whole)) + 100 * MANY
    arrived = pickle.loads(sent)
    for count in (0, 1, MANY - 1, MANY):
        plain = Parcel(whole.version.prefix(count))
        for one in (beginnings[count], arrived[count]):
            assert (one, one.version.extra, one.terms) == (plain, '{"x_a": 1}', plain.terms)
            assert (one.count, one.span) == (count, plain.span)
            assert one.beginning(1) == Parcel(whole.version.prefix(min(count, 1)))
