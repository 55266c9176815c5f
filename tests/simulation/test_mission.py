"""A mission: one seed one course of events, home and out again, and what ends an excursion."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from troupes import NO_ERRORS, drive, excursions, hall, logs_of, shipped_world

from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.robot import Excursion
from possmap.lab.simulate.run import log_text, truth
from possmap.lab.simulate.summary import host_knows, in_order, summarise


def alone(**settings: Any) -> Mission:
    """Return a mission of one robot without errors in a hall."""
    return drive(hall(6, 5), robots=1, **{"minutes": 12, "seed": 2, **NO_ERRORS, **settings})


def seconds(one: Excursion) -> float:
    return one.ended_at - one.track[0][0]


def test_one_seed_gives_one_course_of_events() -> None:
    def told(seed: int) -> tuple[Any, list[str]]:
        mission = drive(shipped_world("figure8"), robots=3, minutes=6, seed=seed)
        return truth(mission), [log_text(log) for log in logs_of(mission)]

    assert told(4) == told(4)
    assert told(4) != told(5)


def test_another_robot_does_not_change_the_faults_of_the_others() -> None:
    few, many = (drive(hall(6, 5), robots=n, minutes=1) for n in (2, 5))
    assert [r.faults for r in many.robots[:2]] == [r.faults for r in few.robots]
    models = [[r.excursions[0].book.own.model for r in m.robots[:2]] for m in (few, many)]
    assert models[0] == models[1], "nor how well they were calibrated"
    assert len({r.faults.turn_bias for r in many.robots}) == 5


def test_a_robot_goes_home_and_out_again() -> None:
    mission = alone(max_error=0.4, turn_noise=0.1)
    names = [one.excursion for one in excursions(mission)]
    assert len(names) > 2
    assert names == [f"r1-{number:02d}" for number in range(1, len(names) + 1)]
    for before, after in pairwise(excursions(mission)):
        assert after.track[0][0] == pytest.approx(before.ended_at + 60, abs=0.1)
    for one in excursions(mission):
        assert one.track[0][1:3] == list(mission.world.home)
        assert one.book.own.records[0]["kind"] == "pose", "it starts afresh"
        assert one.track[0][0] < 12 * 60


def test_an_empty_battery_leaves_it_behind() -> None:
    """In a corridor of 200 m, dead reckoning home takes as long as the way out, and a bit."""
    mission = drive(
        hall(200, 0.8), robots=1, minutes=30, seed=1, battery_minutes=0.5, reach=0.2,
        behaviours=("routine-left",), **NO_ERRORS,
    )  # fmt: skip
    fates = {one.fate for one in excursions(mission)}
    assert fates <= {"home", "lost"}
    for one in excursions(mission):
        assert seconds(one) < 60 * 0.5 + 10
        if one.fate == "lost":
            assert one.why == "battery empty"


def test_its_own_error_estimate_turns_it_home() -> None:
    long, short = (
        max(seconds(one) for one in excursions(alone(max_error=limit, turn_noise=0.1)))
        for limit in (2.0, 0.2)
    )
    assert short < long
    real = drive(shipped_world("figure8"), robots=1, minutes=12, seed=2, max_error=0.5)
    for one in excursions(real):
        assert one.book.belief.worst >= 0.5


def test_the_end_of_the_mission_turns_all_home() -> None:
    mission = drive(hall(6, 5), robots=3, minutes=2, **NO_ERRORS)
    assert all(one.track[0][0] < 120 for one in excursions(mission))
    assert all(one.ended_at < 120 + 60 for one in excursions(mission))
    assert len(list(excursions(mission))) == 3


def test_only_who_truly_ends_within_reach_is_collected() -> None:
    seen = set()
    for reach in (0.05, 2.0):
        mission = drive(shipped_world("figure8"), robots=3, minutes=12, seed=6, reach=reach)
        home = mission.world.home
        for one in excursions(mission):
            apart = math.dist(one.track[-1][1:3], home)
            if one.fate == "home":
                assert apart <= reach and one.why == ""
            else:
                assert one.why
                seen.add(one.why.split(" by ")[0])
    assert "missed home" in seen


@pytest.mark.thorough
def test_the_host_knows_of_the_lost_what_they_told_others() -> None:
    told = 0
    for seed in range(1, 9):
        mission = drive(shipped_world("figure8"), robots=4, minutes=12, seed=seed)
        ended = in_order(mission)
        known = host_knows(ended)
        by_log: dict[str, int] = {}
        for log in logs_of(mission):
            for part in [log, *log.get("carried", [])]:
                name = part["excursion"]
                by_log[name] = max(by_log.get(name, 0), len(part["records"]))
        assert known == by_log
        summary = summarise(mission)
        for one, outing in zip(ended, summary.excursions, strict=True):
            assert outing.known == known.get(one.excursion, 0) <= outing.records
            if one.fate == "home":
                assert outing.known == outing.records
        told += summary.records_known_of_lost
    assert told > 0


def test_behaviours_go_round_and_anxious_robots_turn_more() -> None:
    def turns_per_metre(behaviour: str) -> float:
        turns = metres = 0.0
        for seed in range(3):
            mission = drive(
                hall(30, 30), robots=1, minutes=6, seed=seed, behaviours=(behaviour,),
                max_error=1e6, **NO_ERRORS,
            )  # fmt: skip
            for one in excursions(mission):
                track = np.array(one.track)
                metres += float(np.hypot(*np.diff(track[:, 1:3], axis=0).T).sum())
                turns += float((np.abs(np.diff(track[:, 6])) > 40).sum())
        return turns / metres

    routine, normal, anxious = map(turns_per_metre, ("routine-left", "normal-left", "anxious-left"))
    assert routine < normal < anxious


def test_half_a_battery_turns_it_home() -> None:
    full = alone(max_error=1e6)
    small = alone(max_error=1e6, battery_minutes=4)
    assert seconds(next(excursions(full))) > 11 * 60
    assert 2 * 60 < seconds(next(excursions(small))) < 4 * 60
    assert all(one.fate == "home" for one in excursions(small))


def test_full_memory_turns_it_home() -> None:
    for one in excursions(alone(max_error=1e6, memory_bytes=24 * 200)):
        assert seconds(one) < 11 * 60
        assert len(one.book.own.records) > 100
    assert len(list(excursions(alone(max_error=1e6, memory_bytes=24 * 200)))) > 1
