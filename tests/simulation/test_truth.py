"""What truly happens is possible, and logs tell what truly happened, errors apart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from teams import fuse, write_logs
from troupes import (
    NO_ERRORS,
    Floats,
    along_track,
    drive,
    excursions,
    hall,
    logs_of,
    shipped_world,
    true_places,
)

import possmap
from possmap.core.model import ErrorModel
from possmap.lab.simulate.logbook import Logbook
from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.robot import Excursion
from possmap.lab.simulate.world import World
from possmap.logs import read_log
from possmap.settings.limits import Limits

BODY = 0.075
"""Half the width of a body [m]."""
REAL = [("figure8", 3, 4), ("maze", 3, 5), ("drops", 4, 1), ("office", 6, 2)]


@pytest.fixture(scope="module")
def sound() -> Mission:
    """Return a mission without any errors in the world of Figure 8."""
    return drive(shipped_world("figure8"), robots=3, minutes=12, seed=3, **NO_ERRORS)


@pytest.fixture(scope="module", params=REAL, ids=lambda case: case[0])
def real(request: pytest.FixtureRequest) -> Mission:
    """Return a mission of real robots in a shipped world."""
    world, robots, seed = request.param
    return drive(shipped_world(world), robots=robots, minutes=12, seed=seed)


def vertices(world: World) -> Floats:
    """Return all wall ends and crossings."""
    walls = world.walls
    level = walls[walls[:, 1] == walls[:, 3]]
    upright = walls[walls[:, 0] == walls[:, 2]]
    crossings = [
        (up[0], flat[1]) for flat, up in itertools.product(level, upright)
        if flat[0] <= up[0] <= flat[2] and up[1] <= flat[1] <= up[3]
    ]  # fmt: skip
    return np.concatenate([walls[:, :2], walls[:, 2:], np.array(crossings).reshape(-1, 2)])


def records(one: Excursion, kind: str) -> list[dict[str, Any]]:
    return [record for record in one.book.own.records if record["kind"] == kind]


def runs(one: Excursion) -> Iterator[tuple[dict[str, Any], dict[str, Any], list[dict[str, Any]]]]:
    """Yield consecutive poses, and what was recorded between them."""
    before, between = None, []
    for record in one.book.own.records:
        if record["kind"] != "pose":
            between.append(record)
            continue
        if before is not None:
            yield before, record, between
        before, between = record, []


def test_a_robot_without_errors_believes_where_it_is(sound: Mission) -> None:
    for one in excursions(sound):
        track = np.array(one.track)
        assert np.abs(track[:, 1:3] - track[:, 4:6]).max() < 0.005
        off = (track[:, 3] - track[:, 6] + 180) % 360 - 180
        assert np.abs(off).max() < 0.1


def test_robots_without_errors_bring_home_the_true_map(sound: Mission, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    exact = {"accept_models": False, "along": 0.0, "across": 0.0, "turn_spread": 0.0}
    fuse(write_logs(tmp_path / "logs", logs_of(sound)), grid, exact)
    with possmap.open_grid(grid) as opened:
        necessity, possibility = opened.necessity(), opened.possibility()
        (x0, y0), size = opened.origin(), opened.resolution
    wall_cells = np.argwhere(necessity > 0.5)
    assert len(wall_cells) > 500
    for row, column in wall_cells:
        x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
        assert sound.world.clearance(x, y) <= 1.5 * size, (x, y)
    found = 0
    walls = sound.world.walls.tolist()
    places = np.concatenate([along_track([[0, *w[:2]], [1, *w[2:]]], 0.05) for w in walls])
    for x, y in places:
        row, column = math.floor((y - y0) / size), math.floor((x - x0) / size)
        near = necessity[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        found += bool((near > 0.5).any())
    assert found > 0.5 * len(places), "most of the building is in the map"
    free = np.argwhere(possibility < 0.5)
    assert len(free) > 500
    for row, column in free:
        x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
        assert sound.world.clearance(x, y) > 0, "nobody drove on a wall"


def test_corners_lie_at_true_corners_and_ends(sound: Mission) -> None:
    true = vertices(sound.world)
    kinds = set()
    for one in excursions(sound):
        for corner in records(one, "corner"):
            apart = np.hypot(*(true - (corner["x"], corner["y"])).T)
            assert apart.min() < 0.2, corner
            kinds.add(corner["corner"])
    assert kinds == {"concave", "convex", "end"}


def test_a_followed_run_really_went_beside_a_wall(sound: Mission) -> None:
    followed = 0
    for one in excursions(sound):
        place_at = {row[0]: row[1:3] for row in one.track}
        for before, after, between in runs(one):
            walls = [r for r in between if r["kind"] == "wall" and r["followed"]]
            if not walls:
                continue
            followed += 1
            assert before["heading"] % 90 == after["heading"] % 90 == 0
            x, y = place_at[after["t"]]
            assert min(sound.world.clearance( *place_at[before["t"]]),
                       sound.world.clearance( x, y)) < 0.6  # fmt: skip
            for wall in walls:
                assert sound.world.clearance(wall["x"], wall["y"]) < 0.05
                across = wall["x"] == wall["x2"] or wall["y"] == wall["y2"]
                assert across, "parallel to an axis, as all walls are"
    assert followed > 50


def test_one_wall_gives_one_record_per_run() -> None:
    """In a bare hall nothing hides a part of a wall, so it is seen in one piece."""
    mission = drive(hall(7, 5), robots=1, minutes=10, **NO_ERRORS)
    seen = 0
    for one in excursions(mission):
        for before, after, between in runs(one):
            if (before["x"], before["y"]) == (after["x"], after["y"]):
                continue
            of = [
                nearest_wall(mission.world, (r["x"] + r["x2"]) / 2, (r["y"] + r["y2"]) / 2)
                for r in between
                if r["kind"] == "wall" and (r["x"], r["y"]) != (r["x2"], r["y2"])
            ]
            assert len(of) == len(set(of))
            seen += len(of)
    assert seen > 50


def nearest_wall(world: World, x: float, y: float) -> int:
    low, high = world.walls[:, :2], world.walls[:, 2:]
    away = np.maximum(0.0, np.maximum(low - (x, y), (x, y) - high))
    return int(np.argmin(np.hypot(*away.T)))


def test_no_track_comes_nearer_to_a_wall_than_half_a_body(real: Mission) -> None:
    x0, y0, x1, y1 = real.world.bounds
    for one in excursions(real):
        for x, y in along_track(one.track, 0.05):
            assert x0 < x < x1 and y0 < y < y1
            assert real.world.clearance(x, y) >= BODY


def test_no_track_crosses_a_wall(real: Mission) -> None:
    for one in excursions(real):
        for before, after in pairwise(one.track):
            if before[1:3] != after[1:3]:
                assert real.world.sees(*before[1:3], *after[1:3]), (one.excursion, before, after)


def test_robots_do_not_drive_through_each_other(real: Mission) -> None:
    """Bodies are 0.21 m x 0.15 m; at home robots start from one place, one after the other."""
    times = np.arange(0, 60 * 14, 0.05)
    tracks = [(one, true_places(one, 0.6, times)) for one in excursions(real)]
    for (one, at), (other, to) in combinations(tracks, 2):
        if one.robot == other.robot:
            continue
        apart = np.hypot(*(at - to).T)
        from_home = np.minimum(*(np.hypot(*(p - real.world.home).T) for p in (at, to)))
        near = (apart < 0.15) & (from_home > 0.7)
        assert not near.any(), (one.excursion, other.excursion, times[near][:1])


def test_a_robot_turns_away_from_a_drop_and_logs_no_wall_there() -> None:
    world = hall(9, 7, drops=((1, 1, 3, 6), (6, 2.5, 8, 4.5)))
    mission = drive(world, robots=2, minutes=10, seed=5, **NO_ERRORS)
    nearest = math.inf
    for one in excursions(mission):
        for x, y in along_track(one.track, 0.02):
            for x0, y0, x1, y1 in world.drops:
                apart = math.hypot(max(0.0, x0 - x, x - x1), max(0.0, y0 - y, y - y1))
                assert apart > 0
                nearest = min(nearest, apart)
        for wall in records(one, "wall"):
            assert world.clearance(wall["x"], wall["y"]) < 0.05
    assert nearest < 0.3, "the test would say nothing if nobody came near"


def test_logs_are_valid_and_rounded(real: Mission, tmp_path: Path) -> None:
    paths = write_logs(tmp_path, [one.book.as_log() for one in excursions(real)])
    for path, one in zip(paths, excursions(real), strict=True):
        delivery = read_log(path, Limits()).deliveries[0]
        assert len(delivery.version.records) == len(one.book.own.records)
        for record in one.book.own.records:
            for key in ("x", "y", "x2", "y2"):
                if key in record:
                    assert record[key] == round(record[key], 4)
            for key in ("heading", "t"):
                if key in record:
                    assert record[key] == round(record[key], 2)
            zeros = [value for value in record.values() if value == 0 and value is not False]
            assert all(math.copysign(1, zero) == 1 for zero in zeros), "no -0.0"
        assert [r["seq"] for r in one.book.own.records] == list(range(len(one.book.own.records)))


def test_the_host_knows_where_a_robot_was_as_well_as_its_error_says(real: Mission) -> None:
    """The paper's linear bound holds nearly always: lining up is never claimed in vain."""
    inside = total = 0
    for one in excursions(real):
        own = one.book.own.model
        book = Logbook(one.book.name, own, ErrorModel().with_own(own))
        rows = iter(one.track)
        for record in one.book.own.records:
            fields = {key: value for key, value in record.items() if key not in ("seq", "kind")}
            if record["kind"] == "pose":
                book.pose(fields["t"], fields["x"], fields["y"], fields["heading"])
                row, belief = next(rows), book.belief
                x, y = belief.corrected.place
                box = belief.error.rectangle
                apart_x, apart_y = abs(row[1] - x) - box.half_x, abs(row[2] - y) - box.half_y
                inside += max(apart_x, apart_y) <= 1e-3
                total += 1
            elif record["kind"] == "wall":
                book.wall(*(fields[key] for key in ("t", "x", "y", "x2", "y2", "followed")))
    assert inside / total > 0.95
