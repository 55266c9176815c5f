"""Work is bounded from above before any is done; what robots log stays far below the limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import Segment, Swath, findings
from possmap.core.lattice import tile_window
from possmap.core.model import ErrorModel
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import relevant, stamps, table_of
from possmap.core.records import PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.stamping import extent, pieces_of
from possmap.fusing.layout import BY_BODY, BY_LINE, segment_works, works_of
from possmap.settings.limits import Limits

SURE = ErrorModel(along=0, across=0, turn_spread=0, max_error=10_000)
LIMITS = Limits()

places = st.tuples(*[st.floats(-60, 60)] * 4)
halves = st.tuples(*[st.floats(0, 9)] * 4)


def segment(place: tuple[float, ...], half: tuple[float, ...], width: float = 0) -> Segment:
    rects = ErrorRectangle(*half[:2]), ErrorRectangle(*half[2:])
    x0, y0, x1, y1 = place
    return Segment(0, x0, y0, x1, y1, *rects, Swath(width, 2) if width else None)


def work(one: Segment, resolution: float, max_error: float, lines: int = 0) -> float:
    table = table_of([one], max_error)
    return float(segment_works(table, np.array([float(lines)]), resolution)[0])


@given(places, halves, st.sampled_from([0.05, 0.25]), st.floats(0.5, 9))
def test_no_segment_is_more_work_than_foretold(
    place: tuple[float, ...], half: tuple[float, ...], resolution: float, max_error: float
) -> None:
    one = segment(place, half)
    foretold = work(one, resolution, max_error)
    span = relevant(one, resolution, max_error)
    if span is None:
        return
    rows, columns = stamps(one, *span, resolution).reach(resolution)
    assert ((2 * rows + 1) * (2 * columns + 1)).sum() <= foretold


@given(places, halves, st.sampled_from([0.0, 0.4]))
def test_lines_that_clip_and_bodies_that_sweep_count_in_every_cell_looked_at(
    place: tuple[float, ...], half: tuple[float, ...], width: float
) -> None:
    one = segment(place, half, width)
    seen = sum(
        extent(piece, 0.25).intersection(tile_window(key)).cells
        for key, piece in pieces_of(one, 0.25, 9.0)
    )
    plain, clipped = (work(one, 0.25, 9.0, lines) for lines in (0, 100))
    assert clipped - plain >= 100 * BY_LINE * seen
    assert not width or plain >= BY_BODY * seen


def run(half: float, x: float, y: float) -> PartialMap:
    return excursion(Pose(0, None, 0, 0, 0, half, half), Pose(1, None, x, y, 0))


def excursion(*records: Record) -> PartialMap:
    return PartialMap("r", "a", (), records)


@pytest.mark.parametrize(("half", "y"), [(5, 0), (5, 1000), (20, 0), (20, 600)])
def test_a_kilometre_may_be_unsure_by_metres(half: float, y: float) -> None:
    settings = EvidenceSettings()
    works = works_of(findings(run(half, 1000, y), SURE, settings), settings.resolution)
    assert max(works.values()) <= LIMITS.limit_record_cells
    assert sum(works.values()) <= LIMITS.limit_file_cells / 10


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
        (seen_from_afar(5000), SURE, CLIPPING),
        (run(40, 1000, 1000), SURE, SWEEPING),
        (run(0, 100, 0), GROWING, SWEEPING),
    ],
    ids=["stamps", "tiles", "lines", "bodies", "a-body-that-is-lost-in-one-step"],
)
def test_a_record_that_would_take_many_seconds_is_beyond_the_limit(
    whole: PartialMap, model: ErrorModel, settings: EvidenceSettings
) -> None:
    works = works_of(findings(whole, model, settings), settings.resolution)
    assert max(works.values()) > LIMITS.limit_record_cells
