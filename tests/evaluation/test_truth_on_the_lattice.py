"""The truth laid on the map's lattice: cells of walls, distances, floor and solid insides."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from possmap.core.lattice import Window
from possmap.lab.evaluate.distance import disc, limit, reach_of, squared_distances
from possmap.lab.evaluate.raster import Segments, cells_of, extent_of
from possmap.lab.evaluate.regions import Regions
from possmap.lab.evaluate.true_map import TrueMap, true_map

maps = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def literal_cells(segments: Segments, resolution: float) -> set[tuple[int, int]]:
    """Return rows and columns of METHOD §2, stamp by stamp."""
    cells = set()
    for x0, y0, x1, y1 in segments.tolist():
        n = max(1, math.ceil(max(abs(x1 - x0), abs(y1 - y0)) / resolution - 1e-6))
        for k in range(n + 1):
            x, y = x0 + k / n * (x1 - x0), y0 + k / n * (y1 - y0)
            cells.add((math.floor(y / resolution + 1e-6), math.floor(x / resolution + 1e-6)))
    return cells


# Quarters of a metre lie on borders of cells: there rounding is to be found.
coordinates = st.floats(-3, 3) | st.integers(-12, 12).map(lambda k: k / 4)


@given(
    arrays(np.float64, st.tuples(st.integers(1, 5), st.just(4)), elements=coordinates),
    st.sampled_from([0.05, 0.1, 0.25, 0.5]),
    st.tuples(st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 40), st.integers(1, 40)),
)
def test_walls_become_cells_by_the_rule_of_segments(
    segments: Segments, resolution: float, box: tuple[int, int, int, int]
) -> None:
    row, column, rows, columns = box
    window = Window(row, row + rows, column, column + columns)
    found = np.argwhere(cells_of(segments, window, resolution)) + np.array([row, column])
    literal = literal_cells(segments, resolution)
    inside = {(r, c) for r, c in literal if row <= r < window.row1 and column <= c < window.column1}
    assert {(int(r), int(c)) for r, c in found} == inside
    extent = extent_of(segments, resolution)
    assert all(
        extent.row0 <= r < extent.row1 and extent.column0 <= c < extent.column1 for r, c in literal
    )


@given(maps, st.integers(1, 7))
def test_distances_are_exact_up_to_the_bound(walls: np.ndarray, reach: int) -> None:
    found = squared_distances(walls, reach)
    places = np.argwhere(walls)
    for row, column in np.ndindex(walls.shape):
        exact = min((int((row - r) ** 2 + (column - c) ** 2) for r, c in places), default=10**6)
        if exact <= reach**2:
            assert found[row, column] == exact
        else:
            assert found[row, column] > reach**2


def test_tolerances_hold_in_spite_of_rounding() -> None:
    assert reach_of(0.15, 0.05) == 3  # 0.15 / 0.05 = 2.9999999999999996
    assert limit(0.15, 0.05) >= 9 and limit(0.15, 0.05) < 10
    assert len(disc(0.05, 0.05)) == 5 and len(disc(0.04, 0.05)) == 1
    assert len(disc(0.1, 0.05)) == 13


def flooded(walls: np.ndarray, row: int, column: int) -> set[tuple[int, int]]:
    """Return what can be reached by sides, as one would with a bucket of paint."""
    found, todo = set(), [(row, column)]
    while todo:
        at = todo.pop()
        inside = 0 <= at[0] < walls.shape[0] and 0 <= at[1] < walls.shape[1]
        if inside and not walls[at] and at not in found:
            found.add(at)
            todo += [(at[0] + dr, at[1] + dc) for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))]
    return found


@given(maps, st.data())
def test_regions_are_what_a_flood_reaches(walls: np.ndarray, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, walls.shape[0] - 1))
    column = data.draw(st.integers(0, walls.shape[1] - 1))
    regions = Regions(walls)
    mine = regions.at(np.array([row]), np.array([column]))
    reached = flooded(walls, row, column)
    assert len(mine) == (0 if walls[row, column] else 1)
    painted = regions.painted(mine)
    assert {(int(r), int(c)) for r, c in np.argwhere(painted)} == reached
    at_border = any(
        r in (0, walls.shape[0] - 1) or c in (0, walls.shape[1] - 1) for r, c in reached
    )
    assert bool(np.isin(mine, regions.at_border()).any()) == at_border
    assert (regions.painted(regions.all()) == ~walls).all()


def drawn(picture: str, inside: list[tuple[float, float]]) -> tuple[TrueMap, list[str]]:
    """Return the true map of a drawing, 1 m a character, and floor and solid as drawn."""
    lines = picture.split()[::-1]
    walls = [
        [c + 0.5, r + 0.5, c + 0.5, r + 0.5]
        for r, line in enumerate(lines)
        for c, mark in enumerate(line)
        if mark == "#"
    ]
    window = Window(0, len(lines), 0, len(lines[0]))
    found = true_map(np.array(walls), np.array(inside).reshape(-1, 2), window, 1.0, 10**6)
    marks = np.full(window.shape, "?")
    marks[found.walls] = "#"
    if found.free is not None:
        marks[found.free] = "."
    marks[found.solid] = "x"
    return found, ["".join(line) for line in marks[::-1]]


PILLAR = """
    ?????????
    ?#######?
    ?#.....#?
    ?#.###.#?
    ?#.#x#.#?
    ?#.###.#?
    ?#.....#?
    ?#######?
    ?????????
"""


def test_a_pillars_inside_is_solid_and_the_world_outside_is_not() -> None:
    found, marks = drawn(PILLAR, [(2.5, 2.5)])
    assert marks == PILLAR.split()
    assert (found.free_cells, found.wall_cells) == (16, 24 + 8)


def test_where_walls_close_nothing_in_the_floor_is_not_known() -> None:
    found, _ = drawn(PILLAR.replace("#######", "###.###", 1), [(2.5, 2.5)])
    assert found.free is None and found.free_cells is None
    assert found.solid.sum() == 1, "but the pillar is closed"


@settings(max_examples=30)
@given(st.integers(1, 20))
def test_the_inside_of_a_wall_is_solid_if_it_is_thin(thickness: int) -> None:
    """Two rooms of 3 m, 5 cm a cell, and between them a wall that opens to the outside."""
    c, gap = 0.05, thickness * 0.05 + 0.05
    left = [[0, 0, 3, 0], [0, 3, 3, 3], [0, 0, 0, 3], [3, 0, 3, 3]]
    right = [[x + 3 + gap, y, x2 + 3 + gap, y2] for x, y, x2, y2 in left]
    window = Window(-5, 70, -5, 150)
    inside = np.array([[1, 1], [4 + gap, 1]])
    found = true_map(np.array(left + right, dtype=float), inside, window, c, 10**6)
    between = found.solid[window.slices_in(window)][5 + 30, 5 + 61 : 5 + 61 + thickness]
    assert between.all() == (thickness * c < 0.6 + c / 2)
    assert not found.solid[:, :5].any(), "the world outside is not solid"


def test_walls_beyond_the_window_count_for_distances_and_rectangles() -> None:
    walls = np.array([[-0.1, 0.0, -0.1, 1.0]])
    found = true_map(walls, np.empty((0, 2)), Window(0, 10, 0, 10), 0.05, 10**6)
    assert not found.walls.any() and found.wall_cells == 21
    assert found.near(found.squares, 0.1)[5, 0] and not found.near(found.squares, 0.05)[5, 0]
    one = np.array([5])
    zero = np.array([0])
    assert found.any_within(one, zero, zero, np.array([2]))[0]
    assert not found.any_within(one, zero, zero, np.array([1]))[0]
