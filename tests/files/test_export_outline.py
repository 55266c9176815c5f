"""Outlines: polygons cover exactly the cells that are marked, and are what GIS calls valid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from possmap.core.lattice import Window
from possmap.exports import outline
from possmap.exports.job import Marks
from possmap.exports.outline import Polygon, Ring
from possmap.exports.outline import polygons as outlines_of

masks = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=9))


def marks(drawn: Sequence[str]) -> Marks:
    """Return the marks of a drawing, the highest row first."""
    return np.array([[mark == "#" for mark in line] for line in reversed(drawn)])


def area(ring: Ring) -> float:
    """Return the signed area: above 0 if anticlockwise."""
    pairs = zip(ring, ring[1:] + ring[:1], strict=True)
    return sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairs) / 2


def inside(ring: Ring, shape: tuple[int, ...]) -> Marks:
    """Return which cells lie inside a ring: left of them is an odd number of borders."""
    found = np.zeros(shape, dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(ring, ring[1:] + ring[:1], strict=True):
        assert (x0 == x1) != (y0 == y1), "borders run along the lattice, and have a length"
        if x0 == x1:
            found[min(y0, y1) : max(y0, y1), x0:] ^= True
    return found


def pieces(mask: Marks) -> list[Marks]:
    """Return the parts that hang together by their sides, by flooding."""
    left, found = mask.copy(), []
    while left.any():
        part = np.zeros_like(mask)
        part.flat[np.flatnonzero(left)[0]] = True
        while True:
            grown = part.copy()
            grown[1:] |= part[:-1]
            grown[:-1] |= part[1:]
            grown[:, 1:] |= part[:, :-1]
            grown[:, :-1] |= part[:, 1:]
            grown &= mask
            if (grown == part).all():
                break
            part = grown
        found.append(part)
        left &= ~part
    return found


def cut(mask: Marks, rows: int, columns: int) -> Iterator[tuple[Window, Marks]]:
    """Yield a map in tiles, but for those without a mark; its first cell lies at (-5, 7)."""
    for row in range(0, mask.shape[0], rows):
        for column in range(0, mask.shape[1], columns):
            piece = mask[row : row + rows, column : column + columns]
            if piece.any():
                yield Window(row - 5, row - 5 + len(piece), column + 7,
                             column + 7 + piece.shape[1]), piece  # fmt: skip


def polygons(mask: Marks, rows: int = 9, columns: int = 9) -> list[Polygon]:
    origin = Window(-5, mask.shape[0] - 5, 7, mask.shape[1] + 7)
    return outlines_of(origin, cut(mask, rows, columns))


@budget(max_examples=150, deadline=None)
@given(masks, st.integers(1, 9), st.integers(1, 9))
def test_polygons_are_the_parts_of_a_map_that_hang_together(
    mask: Marks, rows: int, columns: int
) -> None:
    found = polygons(mask, rows, columns)
    assert found == polygons(mask), "pieces do not matter"
    covered = []
    for polygon in found:
        cells = inside(polygon.shell, mask.shape)
        for hole in polygon.holes:
            gap = inside(hole, mask.shape)
            assert (cells & gap == gap).all(), "a hole lies in its shell, and no other"
            cells &= ~gap
        covered.append(cells)
        for ring in (polygon.shell, *polygon.holes):
            assert len(set(ring)) == len(ring), "no ring meets itself"
        assert area(polygon.shell) > 0, "shells run anticlockwise"
        assert all(area(hole) < 0 for hole in polygon.holes)
    expected = pieces(mask)
    assert len(covered) == len(expected)
    for part in expected:
        assert any((part == cells).all() for cells in covered)


def test_a_corner_is_written_once_and_straight_borders_have_none_between() -> None:
    drawn = ["####", "#..#", "####"]
    assert polygons(marks(drawn)) == [
        Polygon(shell=[(0, 0), (4, 0), (4, 3), (0, 3)], holes=[[(1, 1), (1, 2), (3, 2), (3, 1)]])
    ]


def test_cells_that_touch_at_a_corner_are_two_polygons() -> None:
    assert polygons(marks([".#", "#."])) == [
        Polygon(shell=[(0, 0), (1, 0), (1, 1), (0, 1)], holes=[]),
        Polygon(shell=[(1, 1), (2, 1), (2, 2), (1, 2)], holes=[]),
    ]


def test_a_hole_that_touches_the_outside_at_a_corner_stays_a_hole() -> None:
    (found,) = polygons(marks([".###", "#.##", "####"]))
    assert [sorted(hole) for hole in found.holes] == [[(1, 1), (1, 2), (2, 1), (2, 2)]]
    assert area(found.shell) == 11


def test_outlines_too_long_for_memory_are_noticed_before_it_is_full(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outline, "MOST_SIDES", 10)
    assert len(polygons(marks(["####"]))) == 1
    read = []

    def rows() -> Iterator[tuple[Window, Marks]]:
        for row in range(100):
            read.append(row)
            yield Window(row, row + 1, 0, 4), marks(["#.#."])

    with pytest.raises(OverflowError, match="outlines of more than 10 sides"):
        outlines_of(Window(0, 100, 0, 4), rows())
    assert len(read) < 5
