"""The pyramid of one position: the closed form is what the paper passes on cell by cell (§4.1)."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from literal.cell_to_cell import pyramid_cell_to_cell

from possmap.core.evidence import Segment
from possmap.core.lattice import TileKey, Window
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import FULL, Values, table_of
from possmap.core.stamping import Piece, extent, pieces_of, stamp
from possmap.fusing.layout import segment_works

halves = st.floats(0, 1.2)
resolutions = st.sampled_from([0.05, 0.1, 0.25])


def stamped(segment: Segment, window: Window, resolution: float, max_error: float) -> Values:
    block = np.zeros(window.shape, dtype=np.uint16)
    for piece in {found for _, found in pieces_of(segment, resolution, max_error)}:
        stamp(block, window, piece, resolution, max_error)
    return block


def point(x: float, y: float, half_x: float, half_y: float) -> Segment:
    rect = ErrorRectangle(half_x, half_y)
    return Segment(0, x, y, x, y, rect, rect)


@given(halves, halves, resolutions)
def test_the_closed_form_is_the_cell_to_cell_propagation(
    half_x: float, half_y: float, resolution: float
) -> None:
    expected = pyramid_cell_to_cell(half_x, half_y, resolution, 1.0)
    window = Window(-30, 31, -30, 31)
    segment = point(resolution / 2, resolution / 2, half_x, half_y)
    found = stamped(segment, window, resolution, 1.0)
    for (columns, rows), value in expected.items():
        assert abs(found[rows + 30, columns + 30] / FULL - value) <= 0.51 / FULL
    assert np.count_nonzero(found) <= len(expected)


def test_no_error_is_certainty_in_one_cell_and_too_large_an_error_is_nothing() -> None:
    window = Window(-2, 3, -2, 3)
    sure = stamped(point(0.05, 0.05, 0, 0), window, 0.1, 1.0)
    assert sure.sum() == FULL and sure[2, 2] == FULL
    assert not stamped(point(0.05, 0.05, 1.0, 0), window, 0.1, 1.0).any()


def drawn(block: Values) -> list[str]:
    """Draw tenths of certainty, the highest y first; '.' is nothing."""
    tenths = np.floor(block[::-1] / FULL * 10 + 0.5).astype(int)
    return ["".join("." if t == 0 else "X" if t == 10 else str(t) for t in row) for row in tenths]


def test_a_pyramid_is_a_pyramid() -> None:
    block = stamped(point(0.55, 0.35, 0.25, 0.15), Window(0, 7, 0, 11), 0.1, 1.0)
    assert drawn(block) == [
        "...........",
        "...........",
        "...34443...",
        "...35753...",
        "...34443...",
        "...........",
        "...........",
    ]


@given(
    st.tuples(*[st.floats(-3, 3)] * 4),
    st.tuples(*[halves] * 4),
    resolutions,
)
def test_tiles_and_extents_hold_every_cell_that_a_segment_touches(
    places: tuple[float, ...], half: tuple[float, ...], resolution: float
) -> None:
    segment = Segment(0, *places, ErrorRectangle(*half[:2]), ErrorRectangle(*half[2:]))  # type: ignore[arg-type, misc]
    everywhere = Window(-120, 120, -120, 120)
    whole = stamped(segment, everywhere, resolution, 1.0)
    found = list(pieces_of(segment, resolution, 1.0))
    again = np.zeros_like(whole)
    for _, piece in found:
        region = extent(piece, resolution).intersection(everywhere)
        stamp(again[region.slices_in(everywhere)], region, piece, resolution, 1.0)
    assert np.array_equal(whole, again)
    (work,) = segment_works(table_of([segment], 1.0), np.zeros(1), resolution)
    assert np.count_nonzero(whole) <= work


@given(st.tuples(*[halves] * 4), st.integers(0, 60), st.integers(1, 60))
def test_a_segment_stamped_in_parts_is_the_segment(
    half: tuple[float, ...], cut: int, more: int
) -> None:
    rects = ErrorRectangle(*half[:2]), ErrorRectangle(*half[2:])
    n = cut + more
    segment = Segment(0, 0.0, 0.0, n * 0.05, n * 0.02, *rects)
    window = Window(-30, 60, -30, 160)
    whole, parts = (np.zeros(window.shape, dtype=np.uint16) for _ in range(2))
    stamp(whole, window, Piece(segment, 0, n), 0.05, 1.0)
    stamp(parts, window, Piece(segment, 0, cut), 0.05, 1.0)
    stamp(parts, window, Piece(segment, cut, n), 0.05, 1.0)
    assert np.array_equal(whole, parts)


@given(st.tuples(*[st.floats(0, 0.9)] * 2), st.tuples(*[st.floats(1, 1e40)] * 2), st.booleans())
def test_a_rectangle_that_outgrows_the_largest_error_touches_no_tile_more(
    small: tuple[float, ...], large: tuple[float, ...], shrinks: bool
) -> None:
    """Error models may be absurd; at 1e40 m the tiles would be too many to look at."""
    rects = [ErrorRectangle(*small), ErrorRectangle(*large)]
    segment = Segment(0, 5.0, 5.0, 5.0, 5.2, *(reversed(rects) if shrinks else rects))
    assert {key for key, _ in pieces_of(segment, 0.05, 1.0)} <= {TileKey(0, 0)}
    # On the way down from 1e40 m, doubles forget what it goes down to.
    assert shrinks or stamped(segment, Window(0, 200, 0, 200), 0.05, 1.0).any()
