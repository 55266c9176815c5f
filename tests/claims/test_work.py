"""Work is bounded from above before any is done; what robots log stays far below the limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import Findings, Segment, Swath, findings
from possmap.core.lattice import tile_window
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import relevant, stamps
from possmap.core.records import Beam, PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import extent, pieces_of
from possmap.fusing.work import TILE_WORK, most_work, segment_work, tiles_of, works_of
from possmap.logs import Parcel
from possmap.settings.limits import Limits

SURE = ErrorModel(along=0, across=0, turn_spread=0, max_error=10_000)
LIMITS = Limits()

places = st.tuples(*[st.floats(-60, 60)] * 4)
halves = st.tuples(*[st.floats(0, 9)] * 4)


def segment(place: tuple[float, ...], half: tuple[float, ...], width: float = 0) -> Segment:
    rects = ErrorRectangle(*half[:2]), ErrorRectangle(*half[2:])
    x0, y0, x1, y1 = place
    return Segment(0, x0, y0, x1, y1, *rects, Swath(width, 2) if width else None)


@given(places, halves, st.sampled_from([0.05, 0.25]), st.floats(0.5, 9))
def test_no_segment_is_more_work_than_foretold(
    place: tuple[float, ...], half: tuple[float, ...], resolution: float, max_error: float
) -> None:
    one = segment(place, half)
    foretold = segment_work(one, 0, resolution, max_error)
    span = relevant(one, resolution, max_error)
    if span is None:
        assert foretold.of_file == 0
        return
    rows, columns = stamps(one, *span, resolution).reach(resolution)
    assert ((2 * rows + 1) * (2 * columns + 1)).sum() <= foretold.touches
    tiles = {key for key, _ in pieces_of(one, resolution, max_error)}
    assert len(tiles) <= foretold.tiles


@given(places, halves, st.sampled_from([0.0, 0.4]))
def test_lines_that_clip_and_bodies_that_sweep_count_in_every_cell_looked_at(
    place: tuple[float, ...], half: tuple[float, ...], width: float
) -> None:
    one = segment(place, half, width)
    seen = sum(
        extent(piece, 0.25).intersection(tile_window(key)).cells
        for key, piece in pieces_of(one, 0.25, 9.0)
    )
    plain, clipped = (segment_work(one, lines, 0.25, 9.0).touches for lines in (0, 100))
    assert clipped - plain >= 800 * seen
    assert not width or plain >= 256 * seen


@given(places, halves)
def test_of_a_small_record_the_cells_that_it_touches_are_what_counts(
    place: tuple[float, ...], half: tuple[float, ...]
) -> None:
    one = segment(place, half)
    foretold = segment_work(one, 0, 0.25, 9.0)
    assert foretold.of_record == foretold.cells
    span = relevant(one, 0.25, 9.0)
    if span is None:
        return
    laid = stamps(one, *span, 0.25)
    up, across = laid.reach(0.25)
    touched = np.zeros((600, 600), dtype=bool)  # ±75 m
    for row, column, rows, columns in zip(
        (laid.rows + 300).tolist(), (laid.columns + 300).tolist(), up.tolist(), across.tolist(),
        strict=True,
    ):  # fmt: skip
        touched[row - rows : row + rows + 1, column - columns : column + columns + 1] = True
    assert np.count_nonzero(touched) <= foretold.cells


def test_what_is_sure_counts_a_cell_a_stamp() -> None:
    diagonal = segment((0, 0, 30, 30), (0, 0, 0, 0))
    assert segment_work(diagonal, 0, 0.05, 1.0).of_record == 601


def excursion(*records: Record) -> PartialMap:
    return PartialMap("r", "a", (), records)


def exact(found: Findings, settings: EvidenceSettings) -> tuple[float, float]:
    """Return the work of the worst record, and of all as a file of its own."""
    works = works_of(found, settings).values()
    tiles = TILE_WORK * len(tiles_of(found, settings))
    worst = max((work.of_record for work in works), default=0)
    return worst, sum(work.of_file for work in works) + tiles


coordinates = st.floats(-200, 200)


@given(
    st.lists(st.tuples(st.integers(0, 2), *[coordinates] * 4, st.booleans()), max_size=8),
    st.builds(
        ErrorModel,
        scale=st.floats(0.2, 3),
        drift=st.floats(-5, 5),
        turn_bias=st.floats(-90, 90),
        max_error=st.floats(0.01, 9),
    ),
    st.floats(0, 5),
)
def test_no_excursion_is_more_work_than_its_label_lets_foresee(
    rows: list[tuple[int, float, float, float, float, bool]], model: ErrorModel, error: float
) -> None:
    records: list[Record] = [Pose(0, None, 0, 0, 0, error, error)]
    for kind, x, y, x2, y2, hit in rows:
        seq = len(records)
        if kind == 0:
            records.append(Wall(seq, None, x, y, x2, y2))
        elif kind == 1:
            records.append(Beam(seq, None, x, y, x2, y2, hit))
        else:
            records.append(Pose(seq, None, x, y, x2))
    records.append(Pose(len(records), None, 0, 0, 0))
    settings = EvidenceSettings(free_along_beams=True, free_along_walls=True)
    whole = excursion(*records)
    most = most_work(Parcel(whole).span, len(records), model, settings)
    record, file = exact(findings(whole, model, settings), settings)
    assert record <= most.of_record
    assert file <= most.of_excursion + TILE_WORK * most.tiles


def run(half: float, x: float, y: float) -> PartialMap:
    return excursion(Pose(0, None, 0, 0, 0, half, half), Pose(1, None, x, y, 0))


@pytest.mark.parametrize(("half", "y"), [(5, 0), (5, 1000), (20, 0), (20, 600)])
def test_a_kilometre_may_be_unsure_by_metres(half: float, y: float) -> None:
    settings = EvidenceSettings()
    record, file = exact(findings(run(half, 1000, y), SURE, settings), settings)
    assert record <= LIMITS.limit_record_cells and file <= LIMITS.limit_file_cells / 10


def seen_from_afar(walls: int) -> PartialMap:
    """Return a run of 200 m past so many walls."""
    seen = [Wall(n, None, 0, 5, 1, 5) for n in range(1, walls + 1)]
    return excursion(
        Pose(0, None, 0, 0, 0, 20, 20), *seen, Pose(walls + 1, None, 200, 200, 0)
    )  # fmt: skip


CLIPPING = EvidenceSettings(free_along_walls=True, clip_coobserved=True)
SWEEPING = EvidenceSettings(path_width=0.4)
GROWING = ErrorModel(along=1e5, across=0)


@pytest.mark.parametrize(
    ("whole", "model", "settings"),
    [
        (run(140, 280, 140), SURE, EvidenceSettings()),
        (run(0, 490_000, 490_000), SURE, EvidenceSettings()),
        (seen_from_afar(1000), SURE, CLIPPING),
        (run(20, 1000, 1000), SURE, SWEEPING),
        (run(0, 100, 0), GROWING, SWEEPING),
    ],
    ids=["stamps", "tiles", "lines", "bodies", "a-body-that-is-lost-in-one-step"],
)
def test_a_record_that_would_take_many_seconds_is_beyond_the_limit(
    whole: PartialMap, model: ErrorModel, settings: EvidenceSettings
) -> None:
    works = works_of(findings(whole, model, settings), settings).values()
    assert max(work.of_record for work in works) > LIMITS.limit_record_cells
    span = Parcel(whole).span
    most = most_work(span, len(whole.records), model, settings)
    assert most.of_record > LIMITS.limit_record_cells or math.isinf(most.of_record)
