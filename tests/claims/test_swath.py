"""The swath of a body: a path denies walls where the robot's body went, as far as that is sure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import Layer, Segment, Swath, findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import TileKey, Window, tile_window
from possmap.core.model import ErrorModel
from possmap.core.plan import by_tile, plan_excursion
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import FULL
from possmap.core.records import PartialMap, Pose
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import Piece, extent, pieces_of, stamp
from possmap.core.swath import sweep

C = 0.1
FACTOR = 2.236
WINDOW = Window(-40, 40, -40, 40)


def path(
    ends: tuple[float, float, float, float],
    halves: tuple[float, float, float, float],
    width: float = 0.3,
) -> Segment:
    rects = ErrorRectangle(*halves[:2]), ErrorRectangle(*halves[2:])
    return Segment(0, *ends, *rects, Swath(width, FACTOR))


def swept(segment: Segment, window: Window = WINDOW, max_error: float = 1.0) -> np.ndarray:
    block = np.zeros(window.shape, dtype=np.uint16)
    sweep(block, window, segment, C, max_error)
    return block / FULL


def test_a_robot_that_knows_its_place_clears_just_the_floor_under_its_body() -> None:
    found = swept(path((0.05, 0.05, 0.55, 0.05), (0, 0, 0, 0)), Window(-3, 4, -3, 9))
    assert ["".join(".#"[int(v == 1)] for v in row) for row in found[::-1]] == [
        "............",
        "............",
        "..########..",
        "..########..",
        "..########..",
        "............",
        "............",
    ]
    assert set(np.unique(found)) == {0.0, 1.0}


@pytest.mark.parametrize("half", [0.1, 0.3, 0.6, 0.9])
def test_beside_the_middle_of_a_long_run_the_normal_distribution_says_how_sure_it_is(
    half: float,
) -> None:
    found = swept(path((-3.95, 0.05, 3.95, 0.05), (0, half, 0, half)))[:, 40]
    sd = half / FACTOR

    def sure(d: float) -> float:
        upper, lower = (0.15 - d) / sd, (-0.15 - d) / sd
        return (math.erf(upper / math.sqrt(2)) - math.erf(lower / math.sqrt(2))) / 2

    for row in range(80):
        d = abs(row - 40) * C
        expected = sure(d) if d <= half + 0.15 + 1e-9 else 0.0
        assert found[row] == pytest.approx(expected, abs=2e-5), row


def test_the_surer_place_is_the_surer_floor_and_a_pyramid_would_have_claimed_more() -> None:
    sure, unsure = (swept(path((-2, 0.05, 2, 0.05), (h, h, h, h), width=0.15)) for h in (0.05, 0.4))
    assert sure[40, 40] > 0.99 > unsure[40, 40]
    plain = Segment(0, -2, 0.05, 2, 0.05, ErrorRectangle(0.4, 0.4), ErrorRectangle(0.4, 0.4))
    pyramid = np.zeros(WINDOW.shape, dtype=np.uint16)
    stamp(pyramid, WINDOW, Piece(plain, 0, 40), C, 1.0)
    assert pyramid[40, 40] / FULL > unsure[40, 40] > 0.2


coordinates = st.floats(-2.5, 2.5)
halves = st.floats(0, 1.2)
segments = st.builds(
    path,
    st.tuples(coordinates, coordinates, coordinates, coordinates),
    st.tuples(halves, halves, halves, halves),
    st.floats(0.01, 0.6),
)


@given(segments)
def test_nothing_is_denied_beyond_the_rectangle_and_the_body(segment: Segment) -> None:
    found = swept(segment)
    rows, columns = np.nonzero(found)
    one, other = segment.rect0, segment.rect1
    # The rectangle is taken where the path is nearest; grown by the larger end's it holds all.
    far_x = max(one.half_x, other.half_x) + max(one.half_y, other.half_y)
    far = far_x + max(segment.swath.width if segment.swath else 0, C) / 2 * math.sqrt(2) + 1e-6
    x, y = (columns - 40 + 0.5) * C, (rows - 40 + 0.5) * C
    assert (x >= min(segment.x0, segment.x1) - far).all()
    assert (x <= max(segment.x0, segment.x1) + far).all()
    assert (y >= min(segment.y0, segment.y1) - far).all()
    assert (y <= max(segment.y0, segment.y1) + far).all()


@given(segments)
def test_the_tiles_of_a_swath_hold_all_of_it_and_pieces_do_not_matter(segment: Segment) -> None:
    whole = swept(segment)
    laid = np.zeros(WINDOW.shape, dtype=np.uint16)
    for key, piece in pieces_of(segment, C, 1.0):
        part = tile_window(key).intersection(WINDOW)
        if part.cells:
            block = laid[part.slices_in(WINDOW)]
            stamp(block, part, piece, C, 1.0)
    assert (laid / FULL == whole).all()


@given(segments.filter(lambda one: math.hypot(one.x1 - one.x0, one.y1 - one.y0) > 0.1))
def test_it_is_the_same_driven_back(segment: Segment) -> None:
    back = path(
        (segment.x1, segment.y1, segment.x0, segment.y0),
        (*_halves(segment.rect1), *_halves(segment.rect0)),
        segment.swath.width if segment.swath else 0.0,
    )
    difference = np.abs(swept(segment) - swept(back))
    # But for cells on the very edge of what is said.
    assert np.quantile(difference, 0.99) <= 2e-5


def _halves(rect: ErrorRectangle) -> tuple[float, float]:
    return rect.half_x, rect.half_y


def test_from_max_error_on_nothing_is_said() -> None:
    assert not swept(path((-2, 0, 2, 0), (1.0, 0.2, 1.0, 0.2))).any()
    growing = swept(path((-3, 0.05, 3, 0.05), (0, 0, 1.2, 0)))
    assert growing[40, 12] > 0.9 and not growing[:, 40 + 25 :].any()


def test_a_long_diagonal_costs_what_it_touches() -> None:
    far = path((-1e4, -1e4, 1e4, 1e4), (0.1, 0.1, 0.1, 0.1))
    keys = [key for key, _ in pieces_of(far, C, 1.0)]
    assert len(set(keys)) < 4 * 2 * 1e4 / C / 256
    at_home = Piece(far, 99_990, 100_010)
    assert extent(at_home, C).cells < 60**2


def test_paths_are_set_by_path_width_alone() -> None:
    model = ErrorModel(along=0, across=0, turn_spread=0)
    log = PartialMap("r1", "a", (), (Pose(0, None, 0.05, 0.05, 0), Pose(1, None, 2.05, 0.05, 0)))
    denied = {}
    for width in (0.0, 0.5):
        settings = EvidenceSettings(resolution=C, path_width=width, model=model)
        _, works = by_tile([plan_excursion(findings(log, model, settings), 0, settings)])
        (work,) = (one for one in works if one.key == TileKey(0, 0))
        denied[width] = np.count_nonzero(fuse_tile(work, {}, settings)[Layer.FREE])
    assert denied[0.0] == 21, "only the path's own cells"
    assert denied[0.5] == 3 * 23, "and half a metre of floor, as far as it lies in this tile"
