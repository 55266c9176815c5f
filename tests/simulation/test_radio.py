"""Meetings hand over beginnings of logs, and nothing is lost or invented on the way to the host."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from teams import fuse, write_logs
from troupes import NO_ERRORS, drive, excursions, hall, logs_of, shipped_world, true_places

from possmap.core.model import ErrorModel
from possmap.lab.simulate.body import Place
from possmap.lab.simulate.logbook import RECORD_BYTES, Logbook, Name, exchange
from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.summary import host_knows, in_order

pytestmark = pytest.mark.default_profile

CASES = [("figure8", 3, 1), ("figure8", 3, 7), ("maze", 4, 2), ("office", 8, 3)]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{case[2]}")
def mission(request: pytest.FixtureRequest) -> Mission:
    world, robots, seed = request.param
    driven = drive(shipped_world(world), robots=robots, minutes=12, seed=seed)
    assert driven.meetings
    return driven


def own_books(mission: Mission) -> dict[Name, Logbook]:
    return {one.book.name: one.book for one in excursions(mission)}


def test_what_a_robot_relays_is_a_beginning_of_what_its_author_wrote(mission: Mission) -> None:
    authors = own_books(mission)
    relayed = 0
    for log in logs_of(mission):
        for carried in log.get("carried", []):
            author = authors[carried["robot"], carried["excursion"]]
            records = carried["records"]
            assert records == author.own.records[: len(records)]
            assert carried.get("model", {}) == author.own.model
            relayed += len(records)
    assert relayed > 0


def test_all_logs_fuse_without_a_conflict(mission: Mission, tmp_path: Path) -> None:
    summary = fuse(write_logs(tmp_path, logs_of(mission)), tmp_path / "site.possmap", {})
    assert summary.records_new == sum(host_knows(in_order(mission)).values())


def test_robots_meet_within_range_and_line_of_sight(mission: Mission) -> None:
    settings = mission.settings
    for meeting in mission.meetings:
        at, to = (
            next(
                place[0]
                for one in excursions(mission)
                if one.robot == name
                for place in [true_places(one, settings.speed, np.array([meeting.time]))]
                if not math.isnan(place[0, 0])
            )
            for name in (meeting.robot, meeting.peer)
        )
        assert math.dist(at, to) <= settings.radio_range + 0.02
        assert mission.world.sees(*at, *to)


def test_a_transfer_fits_the_link_and_the_longest_stop(mission: Mission) -> None:
    settings = mission.settings
    most = settings.radio_rate * settings.radio_stop / RECORD_BYTES
    assert all(0 <= m.given + m.taken <= most for m in mission.meetings)


def test_both_stand_still_while_they_talk(mission: Mission) -> None:
    settings = mission.settings
    for meeting in mission.meetings:
        seconds = (meeting.given + meeting.taken) * RECORD_BYTES / settings.radio_rate
        for one in excursions(mission):
            if one.robot in (meeting.robot, meeting.peer):
                times = np.linspace(meeting.time + 0.01, meeting.time + seconds - 0.01, 20)
                places = true_places(one, settings.speed, times)
                moved = np.ptp(places, axis=0) if seconds > 0.1 else np.zeros(2)
                assert np.nan_to_num(moved).max() < 0.01, (meeting, one.excursion)


def test_both_note_the_meeting_and_how_far_they_know_each_other(mission: Mission) -> None:
    noted: dict[tuple[str, str, float], int | None] = {}
    for one in excursions(mission):
        for record in one.book.own.records:
            if record["kind"] == "meet":
                noted[one.robot, record["peer"], record["t"]] = record.get("upto")
                peer = record["peer"], record["peer_excursion"]
                if "upto" in record:
                    held = one.book.relayed[peer].records
                    assert record["upto"] in [r["seq"] for r in held]
                    (upto,) = (r for r in held if r["seq"] == record["upto"])
                    assert upto["t"] <= record["t"], "only what was written before"
    both = {(m.robot, m.peer, m.time) for m in mission.meetings}
    assert set(noted) == both | {(peer, robot, time) for robot, peer, time in both}


# One meeting, by hand.


def book(name: str, records: int) -> Logbook:
    """Return a log of so many poses."""
    written = Logbook((name, f"{name}-01"), {"turn_bias": 1.0}, ErrorModel())
    for number in range(records):
        written.pose(float(number), 0.1 * number, 0.0, 0.0)
    return written


def held(one: Logbook) -> dict[str, int]:
    return {name: len(h.records) for (name, _), h in sorted(one.relayed.items())}


LOTS = 10**6


def test_a_meeting_gives_all_if_time_and_memory_allow() -> None:
    one, other = book("r1", 50), book("r2", 20)
    assert exchange(one, other, LOTS, LOTS) == (50, 20)
    assert (held(one), held(other)) == ({"r2": 20}, {"r1": 50})
    assert exchange(one, other, LOTS, LOTS) == (0, 0), "nothing is sent twice"
    one.pose(60, 1, 0, 0)
    assert exchange(one, other, LOTS, LOTS) == (1, 0)
    assert other.relayed["r1", "r1-01"].records == one.own.records


def test_relayed_logs_are_handed_on_after_ones_own() -> None:
    one, other, third = book("r1", 10), book("r2", 10), book("r3", 10)
    exchange(one, other, LOTS, LOTS)
    assert exchange(other, third, 24 * (15 + 10), LOTS) == (15, 10)
    assert held(third) == {"r1": 5, "r2": 10}
    assert exchange(third, one, LOTS, LOTS) == (10, 5)
    assert held(one) == {"r2": 10, "r3": 10}, "nobody is sent his own log"
    assert held(third) == {"r1": 10, "r2": 10}


def test_the_link_limits_both_together_and_leaves_a_beginning() -> None:
    one, other = book("r1", 50), book("r2", 50)
    assert exchange(one, other, 24 * 30 + 23, LOTS) == (15, 15)
    assert other.relayed["r1", "r1-01"].records == one.own.records[:15]
    short, long = book("r3", 3), book("r4", 50)
    assert exchange(short, long, 24 * 30, LOTS) == (3, 27), "what one leaves the other uses"
    assert exchange(book("r5", 50), book("r6", 3), 24 * 30, LOTS) == (27, 3)
    assert exchange(book("r7", 9), book("r8", 9), 23, LOTS) == (0, 0)


def test_nobody_takes_more_than_its_memory_holds() -> None:
    one, other = book("r1", 50), book("r2", 50)
    assert exchange(one, other, LOTS, 24 * 60 + 5) == (10, 10)
    assert one.bytes == other.bytes == 24 * 60
    assert exchange(one, other, LOTS, 24 * 40) == (0, 0)


# A whole mission.


def two_in_a_hall(**settings: Any) -> Mission:
    return drive(hall(4, 4), robots=2, minutes=5, **{"seed": 3, **NO_ERRORS, **settings})


def test_without_exchange_nothing_is_handed_over() -> None:
    for settings in ({"exchange": False}, {"radio_loss": 1.0}, {"radio_range": 0.0}):
        silent = two_in_a_hall(**settings)
        assert not silent.meetings
        assert all("carried" not in one.book.as_log() for one in excursions(silent))
    assert two_in_a_hall().meetings


# Who yields.


def yielding(at: Place, to: Place) -> tuple[float, float]:
    """Return for how long each of two running robots is made to stop [s]."""
    mission = Mission(hall(4, 4), MissionSettings(robots=2))
    stopped: dict[str, float] = {}
    one, other = (
        SimpleNamespace(robot=SimpleNamespace(name=name), motion=SimpleNamespace(moves=True))
        for name in ("r1", "r2")
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            mission, "_stop", lambda acting, hold: stopped.update({acting.robot.name: hold})
        )
        mission._give_way(one, other, at, to)  # type: ignore[arg-type]
    return stopped.get("r1", 0.0), stopped.get("r2", 0.0)


def place(x: float, y: float, heading_deg: float) -> Place:
    return Place(x, y, math.radians(heading_deg))


def test_the_one_from_the_right_goes_first() -> None:
    eastward, from_the_right = place(0, 0, 0), place(0.35, -0.35, 90)
    mine, its = yielding(eastward, from_the_right)
    assert mine > 0 and its == 0
    its, mine = yielding(from_the_right, eastward)
    assert mine > 0 and its == 0, "whoever comes first in the list"
    from_the_left = place(0.35, 0.35, -90)
    mine, its = yielding(eastward, from_the_left)
    assert mine == 0 and its > 0


def test_head_on_both_stop_for_times_of_their_own() -> None:
    mine, its = yielding(place(0, 0, 0), place(0.5, 0.0, 180))
    assert mine > 0 and its > 0 and mine != its
