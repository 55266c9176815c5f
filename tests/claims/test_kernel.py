"""The compiled kernel gives the plain one's integers (METHOD §2, §3)."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from possmap.core import kernel, plain_kernel
from possmap.core.clip import ClipLine, Clips
from possmap.core.evidence import Segment, Swath
from possmap.core.fusion import WEIGHT
from possmap.core.lattice import Window
from possmap.core.propagation import ErrorRectangle
from possmap.core.pyramid import relevant, segment_of, table_of

compiled_only = pytest.mark.skipif(not kernel.COMPILED, reason="no compiled kernel was built")

places = st.floats(-30, 30) | st.sampled_from([0.0, -0.05, 12.8, 0.15])
halves = st.floats(0, 1.3) | st.sampled_from([0.0, 1.0, 0.05])
resolutions = st.sampled_from([0.05, 0.1, 0.25, 1.0])
WINDOW = Window(-90, 110, -70, 131)


@st.composite
def segments(draw: st.DrawFn, swaths: bool = False) -> Segment:
    x, y = draw(places), draw(places)
    way = draw(st.sampled_from(["any", "point", "along x", "along y"]))
    x1 = x if way in ("point", "along y") else x + draw(st.floats(-8, 8))
    y1 = y if way in ("point", "along x") else y + draw(st.floats(-8, 8))
    rects = [ErrorRectangle(draw(halves), draw(halves)) for _ in range(2)]
    width = draw(st.sampled_from([0.0, 0.2]) | st.floats(0.01, 0.9)) if swaths else 0.0
    swath = Swath(width, draw(st.sampled_from([2.0, 2.236]))) if width else None
    return Segment(0, x, y, x1, y1, *rects, swath)


tables = st.builds(
    table_of, st.lists(segments(swaths=True), min_size=1, max_size=6), st.floats(0.3, 1.2)
)


@st.composite
def lines(draw: st.DrawFn) -> ClipLine:
    angle = draw(st.sampled_from([0.0, 0.5, 1.0, 1.5]) | st.floats(0, 2)) * math.pi
    offset = draw(st.sampled_from([0.0, 0.05, -1.0]) | st.floats(-8, 8))
    return ClipLine(math.cos(angle), math.sin(angle), offset, draw(st.booleans()))


clips = st.lists(st.lists(lines(), max_size=3).map(tuple), max_size=3)


@given(st.lists(segments(swaths=True), max_size=6), st.floats(0.3, 1.2))
def test_a_table_keeps_its_segments(some: list[Segment], max_error: float) -> None:
    assert [segment_of(row) for row in table_of(some, max_error)] == some


@compiled_only
@given(
    st.builds(table_of, st.lists(segments(swaths=True), max_size=5), st.floats(0.3, 1.2)),
    resolutions,
)
@settings(max_examples=150)
def test_compiled_and_plain_find_the_same_stamps_in_the_same_tiles(
    table: kernel.Floats, resolution: float
) -> None:
    assert kernel.touch(table, resolution).tolist() == (
        plain_kernel.touch(table, resolution).tolist()
    )


def pieces_of(table: kernel.Floats, resolution: float, clips: Clips) -> kernel.Ints:
    """Return a piece of each segment, two of them in a group, clipped by one after the other."""
    spans = [relevant(segment_of(row), resolution, float(row[8])) for row in table]
    rows = [
        (n, *span, n // 2, n % 2, n % (len(clips) + 1) - 1)
        for n, span in enumerate(spans)
        if span is not None
    ]
    return np.array(sorted(rows, key=lambda row: (row[3], -row[4])), dtype=np.int64).reshape(-1, 6)


@compiled_only
@given(tables, resolutions, clips, st.integers(1, 40), st.integers(1, 40))
@settings(max_examples=150)
def test_compiled_and_plain_raise_to_the_same_values(
    table: kernel.Floats, resolution: float, clips: Clips, rows: int, columns: int
) -> None:
    pieces = pieces_of(table, resolution, clips)
    for window in (WINDOW, Window(-5, rows - 5, -3, columns - 3)):
        found, expected = (np.full(window.shape, 77, dtype=np.uint16) for _ in range(2))
        kernel.raise_block(found, window, table, pieces, resolution, clips)
        plain_kernel.raise_block(expected, window, table, pieces, resolution, clips)
        assert np.array_equal(found, expected)


@compiled_only
@given(tables, resolutions, clips)
@settings(max_examples=150)
def test_compiled_and_plain_reinforce_by_the_same_weights(
    table: kernel.Floats, resolution: float, clips: Clips
) -> None:
    pieces = pieces_of(table, resolution, clips)
    found, expected = (np.full(WINDOW.shape, 5, dtype=np.int64) for _ in range(2))
    kernel.reinforce(found, WINDOW, table, pieces, resolution, WEIGHT, clips)
    plain_kernel.reinforce(expected, WINDOW, table, pieces, resolution, WEIGHT, clips)
    assert np.array_equal(found, expected)


@compiled_only
@pytest.mark.parametrize(
    ("cells", "segment", "clip"),
    [
        ((WINDOW.shape[0], WINDOW.shape[1] - 1), 0, -1),
        (WINDOW.shape, 1, -1),
        (WINDOW.shape, -1, -1),
        (WINDOW.shape, 0, 0),
    ],
)
def test_what_does_not_fit_is_refused_before_a_cell_is_written(
    cells: tuple[int, int], segment: int, clip: int
) -> None:
    rect = ErrorRectangle(0.3, 0.3)
    table = table_of([Segment(0, 1.0, 1.0, 2.0, 1.0, rect, rect)], 1.0)
    block = np.zeros(cells, dtype=np.uint16)
    with pytest.raises(ValueError, match=r"shape|a piece of no"):
        kernel.raise_block(
            block, WINDOW, table, np.array([[segment, 0, 5, 0, 0, clip]], dtype=np.int64), 0.05
        )
    assert not block.any()


@compiled_only
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_lies_on_no_lattice_is_refused(value: float) -> None:
    rect = ErrorRectangle(0.3, 0.3)
    table = table_of([Segment(0, 1.0, value, 2.0, 1.0, rect, rect)], 1.0)
    with pytest.raises(ValueError, match="on no lattice"):
        kernel.touch(table, 0.05)
    with pytest.raises(ValueError, match="on no lattice"):
        kernel.touch(np.zeros((1, 12), dtype=np.float32), 0.05)


def test_without_the_compiled_kernel_the_digest_is_the_same(tmp_path: Path) -> None:
    data = Path(__file__).parents[2] / "data" / "json"
    digests = set()
    for choice in ("numpy", ""):
        grid = tmp_path / f"site{choice}.possmap"
        environment = {**os.environ, "POSSMAP_KERNEL": choice}
        for command in (["-q", "fuse", str(data), "-g", str(grid)], ["info", str(grid), "--json"]):
            done = subprocess.run(
                [sys.executable, "-m", "possmap", *command],
                env=environment, check=True, capture_output=True, text=True,
            )  # fmt: skip
        digests.add(done.stdout.split('"digest": "')[1][:64])
    assert len(digests) == 1
