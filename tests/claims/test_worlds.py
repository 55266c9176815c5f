"""True buildings: what lies ahead is what is there, and generated offices are buildings."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as budget
from hypothesis import strategies as st
from numpy.typing import NDArray

from possmap.lab.simulate.floor_plan import Wall, sides, united
from possmap.lab.simulate.generate import CORRIDOR, DOOR, PASSAGE, ROOM, Office, office
from possmap.lab.simulate.mission_file import ENOUGH, wrong_with_home
from possmap.lab.simulate.world import World

NO_DROPS = np.empty((0, 4))
FINE = 0.01
"""How densely the brute-force answers sample a wall [m]."""

places = st.floats(-3, 3)
headings = st.floats(-math.pi, math.pi)


@st.composite
def walls(draw: st.DrawFn) -> Wall:
    x, y = draw(st.integers(-30, 30)) / 10, draw(st.integers(-30, 30)) / 10
    length = draw(st.integers(1, 40)) / 10
    return (x, y, x + length, y) if draw(st.booleans()) else (x, y, x, y + length)


worlds = st.lists(walls(), min_size=1, max_size=8).map(
    lambda drawn: World("drawn", np.array(drawn), NO_DROPS, (0.0, 0.0))
)


def points(world: World) -> NDArray[np.complex128]:
    """Return a dense sample of all walls."""
    pieces = []
    for x, y, x2, y2 in world.walls.tolist():
        count = math.ceil((x2 - x + y2 - y) / FINE) + 1
        pieces.append(np.linspace(complex(x, y), complex(x2, y2), count))
    return np.concatenate(pieces)


def sampled_ahead(world: World, here: complex, heading: float, half_width: float) -> float:
    """Return how far ahead the first sampled point in a strip lies; infinity without one."""
    seen = (points(world) - here) * np.exp(-1j * heading)
    in_strip = (np.abs(seen.imag) <= half_width) & (seen.real >= -FINE)
    return float(seen.real[in_strip].min(initial=math.inf))


@given(worlds, places, places, headings, st.floats(0.05, 0.3), st.floats(0.1, 5))
def test_what_lies_ahead_is_the_first_wall_that_a_strip_runs_into(
    world: World, x: float, y: float, heading: float, half_width: float, reach: float
) -> None:
    found = world.ahead(x, y, heading, half_width, reach)
    distance = found.distance if found else math.inf
    here = complex(x, y)
    late = sampled_ahead(world, here, heading, half_width - FINE)
    early = sampled_ahead(world, here, heading, half_width + FINE)
    if late <= reach - 2 * FINE:
        assert distance <= late + 2 * FINE
    assert early - 2 * FINE <= distance
    if found:
        assert 0 <= distance <= reach
        level = world.walls[:, 1] == world.walls[:, 3]
        alike = World("alike", world.walls[level == found.horizontal], NO_DROPS, world.home)
        assert alike.ahead(x, y, heading, half_width, reach) == found


@given(worlds, places, places, headings)
def test_a_ray_ends_where_it_crosses_the_first_wall(
    world: World, x: float, y: float, heading: float
) -> None:
    nearest = math.inf
    cos, sin = math.cos(heading), math.sin(heading)
    for x1, y1, x2, y2 in world.walls.tolist():
        level = y1 == y2
        rise = sin if level else cos
        assume(abs(rise) > 1e-3)  # no ray along a wall
        distance = (y1 - y if level else x1 - x) / rise
        hit = (
            (x + distance * cos - x1) / (x2 - x1)
            if level
            else (y + distance * sin - y1) / (y2 - y1)
        )
        assume(min(abs(hit), abs(hit - 1)) > 1e-6 and abs(distance) > 1e-6)  # nor past its very end
        if 0 < hit < 1 and distance > 0:
            nearest = min(nearest, distance)
    found = world.ahead(x, y, heading, 0.0, 20.0)
    assert (found.distance if found else math.inf) == pytest.approx(nearest)
    for share, seen in ((0.99, True), (1.01, False)):
        if nearest < math.inf:
            end = nearest * share
            assert world.sees(x, y, x + end * cos, y + end * sin) is seen


@given(worlds, places, places)
def test_clearance_is_the_distance_to_the_nearest_point_of_a_wall(
    world: World, x: float, y: float
) -> None:
    brute = float(np.abs(points(world) - complex(x, y)).min())
    assert brute - FINE <= world.clearance(x, y) <= brute + 1e-9


@given(worlds, st.lists(walls(), max_size=4))
def test_united_walls_cover_the_same_points_except_where_doors_are(
    world: World, doors: list[Wall]
) -> None:
    def covered(segments: list[Wall]) -> set[tuple[bool, int, int]]:
        """Return the pieces of 0.1 m of each line, whether level, at and from which tenth."""
        return {
            (y == y2, round(10 * (y if y == y2 else x)), tenth)
            for x, y, x2, y2 in segments
            for low, high in [(x, x2) if y == y2 else (y, y2)]
            for tenth in range(round(10 * low), round(10 * high))
        }

    drawn = [(x, y, x2, y2) for x, y, x2, y2 in world.walls.tolist()]
    one = [(x, y, x2, y2) for x, y, x2, y2 in united(drawn, doors).tolist()]
    assert covered(one) == covered(drawn) - covered(doors)
    assert united(one).tolist() == [list(wall) for wall in one], "no two pieces touch on a line"
    assert united(drawn[::-1], doors).tolist() == united(drawn, doors).tolist()


def reached(building: Office, body: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where a square body fits, and where it gets from home, on a grid of 0.1 m."""
    step = 0.1
    size_x, size_y = building.size
    xs, ys = np.arange(step / 2, size_x, step), np.arange(step / 2, size_y, step)
    fits = np.ones((len(xs), len(ys)), dtype=bool)
    for x, y, x2, y2 in [*building.walls.tolist(), *building.obstacles]:
        in_x = (xs > x - body / 2) & (xs < x2 + body / 2)
        in_y = (ys > y - body / 2) & (ys < y2 + body / 2)
        fits[np.ix_(in_x, in_y)] = False
    start = int(building.home[0] / step), int(building.home[1] / step)
    got, waiting = np.zeros_like(fits), deque([start])
    got[start] = True
    while waiting:
        i, j = waiting.popleft()
        for cell in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if fits[cell] and not got[cell]:
                got[cell] = True
                waiting.append(cell)
    return fits, got


sizes = st.floats(5, 32)
seeds = st.integers(0, 2**32)


@budget(max_examples=25, deadline=None)
@given(sizes, sizes, seeds)
def test_a_body_of_30_cm_gets_everywhere_in_a_generated_office(
    size_x: float, size_y: float, seed: int
) -> None:
    building = office(size_x, size_y, np.random.default_rng(seed))
    fits, got = reached(building, 0.3)
    assert (got == fits).all()
    for x0, y0, x1, y1 in building.rooms:
        assert got[int(x0 * 10) : int(x1 * 10), int(y0 * 10) : int(y1 * 10)].any()


@pytest.mark.thorough
@budget(max_examples=40, deadline=None)
@given(st.floats(5, 60), st.floats(5, 60), seeds)
def test_a_generated_office_is_a_building(size_x: float, size_y: float, seed: int) -> None:
    building = office(size_x, size_y, np.random.default_rng(seed))
    world = World("office", building.walls, NO_DROPS, building.home)  # checks the right angles
    assert world.bounds == pytest.approx((0, 0, size_x, size_y), abs=1e-6)
    assert world.clearance(*building.home) >= CORRIDOR[0] / 2 - 0.01
    assert not wrong_with_home(world, 0.21, 0.15)
    assert len(building.doors) >= len(building.rooms) > 0
    for x0, y0, x1, y1 in building.rooms:
        assert ROOM[0] - 0.02 <= min(x1 - x0, y1 - y0)
        assert max(x1 - x0, y1 - y0) <= ROOM[1] + 0.02
    for x, y, x2, y2 in building.doors:
        assert DOOR[0] - 1e-6 <= x2 - x + y2 - y <= DOOR[1] + 1e-6
        assert world.clearance((x + x2) / 2, (y + y2) / 2) >= DOOR[0] / 2 - 1e-6, "a door is open"


@budget(max_examples=40, deadline=None)
@given(st.floats(5, 40), st.floats(5, 40), seeds)
def test_obstacles_touch_a_wall_or_leave_a_passage(size_x: float, size_y: float, seed: int) -> None:
    building = office(size_x, size_y, np.random.default_rng(seed))
    for number, (x0, y0, x1, y1) in enumerate(building.obstacles):
        (room,) = (
            room
            for room in building.rooms
            if room[0] <= x0 and x1 <= room[2] and room[1] <= y0 and y1 <= room[3]
        )
        for gap in (x0 - room[0], y0 - room[1], room[2] - x1, room[3] - y1):
            assert gap == 0 or gap >= PASSAGE - 0.011
        for other in building.obstacles[:number]:
            apart = max(other[0] - x1, x0 - other[2], other[1] - y1, y0 - other[3])
            same_room = room[0] <= other[0] < room[2] and room[1] <= other[1] < room[3]
            assert not same_room or apart >= PASSAGE - 1e-5


def test_one_seed_gives_one_office_and_another_another() -> None:
    first, again, other = (office(30, 20, np.random.default_rng(seed)) for seed in (4, 4, 5))
    assert first == again != other


def test_an_office_of_200_m_has_over_a_thousand_rooms() -> None:
    building = office(200, 200, np.random.default_rng(1))
    assert len(building.rooms) > 1000
    area = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in building.rooms)
    assert 0.6 < area / 200**2 < 0.9, "the rest is corridors"


def closet(width: float, door: float) -> World:
    """Return a closet within a large room, its door at the foot of its east side."""
    cupboard = united(sides((0.0, 0.0, width, 1.0)), [(width, 0.0, width, door)])
    outside = np.array(sides((-5.0, -5.0, 5.0, 5.0)))
    return World("closet", np.concatenate([cupboard, outside]), NO_DROPS, (0.5, 0.5))


def test_home_must_have_a_way_out_for_the_robot() -> None:
    def wrong(world: World) -> str:
        return wrong_with_home(world, 0.21, 0.15)

    assert not wrong(closet(1.0, 0.4))
    for door in (0.0, 0.1):
        assert closet(1.0, door).reachable(0.15, ENOUGH) < 1
        assert wrong(closet(1.0, door)).startswith("where walls enclose a robot")
    # No cupboard, but 5 % of the building is more.
    assert wrong(closet(2.9, 0.0)).endswith("expected 5 m2 or more")
    assert not wrong(World("room", np.array(sides((0.0, 0.0, 2.9, 1.0))), NO_DROPS, (0.5, 0.5)))
