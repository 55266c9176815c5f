"""A bump is a wall of zero length: what no sensor sees, the switches touch (METHOD §5)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from troupes import NO_ERRORS, Bench, drive, excursions, shipped_world

from possmap.lab.simulate.body import Faults
from possmap.lab.simulate.world import World

SOUND = Faults(0.0, 0.0, 1.0)


def before(*walls: tuple[float, float, float, float]) -> Bench:
    """Return a robot without errors at (0, 0), heading +x, before these walls."""
    world = World("plain", np.array(walls), np.empty((0, 4)), (0.0, 0.0))
    return Bench(1, SOUND, world, **NO_ERRORS)


def told(bench: Bench) -> list[dict[str, Any]]:
    return bench.steering.book.own.records


@pytest.mark.parametrize("left", [0.06, -0.06])
def test_the_end_of_a_wall_beside_the_middle_is_touched_and_noted(left: float) -> None:
    bench = before((1.0, left, 3.0, left))
    bench.run(2.0)
    start, bump, touching, behind = (
        told(bench)[0],
        *told(bench)[-2:-1],
        *told(bench)[-3:-2],
        told(bench)[-1],
    )
    assert start["kind"] == "pose"
    assert touching["kind"] == "pose" and touching["x"] == pytest.approx(1.0 - 0.105, abs=1e-3)
    assert bump["kind"] == "wall" and bump["followed"] is False
    assert (
        (bump["x"], bump["y"]) == (bump["x2"], bump["y2"]) == pytest.approx((1.0, left), abs=1e-3)
    )
    assert behind["x"] == pytest.approx(1.0 - 0.105 - 0.12, abs=1e-3), "room to turn"
    assert behind["heading"] == 0.0
    assert bench.steering.bumped == math.copysign(1, left)
    assert bench.body.place.x == pytest.approx(behind["x"], abs=1e-3)


@pytest.mark.parametrize(
    "wall",
    [
        pytest.param((1.0, -2.0, 1.0, 2.0), id="across the way"),
        pytest.param((1.0, 0.05, 1.0, 2.0), id="from one side, seen by the sensor of that side"),
        pytest.param((1.0, 0.0, 3.0, 0.0), id="end-on before the front sensor"),
    ],
)
def test_what_the_sensors_see_is_not_touched(wall: tuple[float, float, float, float]) -> None:
    bench = before(wall)
    bench.run(2.0)
    assert bench.steering.bumped == 0
    assert bench.body.place.x == pytest.approx(1.0 - 0.105 - 0.12, abs=1e-3)
    assert not [one for one in told(bench) if one["kind"] == "wall" and one["x"] == one["x2"]]


def test_backing_off_ends_before_a_wall_behind() -> None:
    bench = before((0.3, 0.06, 3.0, 0.06), (-0.2, -2.0, -0.2, 2.0))
    bench.run(2.0)
    assert bench.steering.bumped == 1
    assert bench.body.place.x - 0.105 > -0.2


def test_robots_bump_in_real_missions_and_every_bump_is_on_a_wall() -> None:
    world, bumps = shipped_world("office"), 0
    mission = drive(world, robots=4, minutes=10, seed=3, exchange=False, **NO_ERRORS)
    for one in excursions(mission):
        for record in one.book.own.records:
            if record["kind"] == "wall" and (record["x"], record["y"]) == (
                record["x2"],
                record["y2"],
            ):
                bumps += 1
                assert world.clearance(record["x"], record["y"]) < 0.01
    assert bumps > 0
