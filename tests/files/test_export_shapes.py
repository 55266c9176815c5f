"""Outlines of a grid: the same whether its tiles lie side by side or far apart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from maps import Pairs, cells_of, write_grid

from possmap.errors import OutputError
from possmap.exports.export import export
from possmap.exports.job import Choices, Job
from possmap.exports.outline import Polygon
from possmap.exports.outline import outlines as outlines_of
from possmap.grid.grid import Grid

# Beside and on the borders of tiles, with tiles left out between, below and above (0, 0).
places = st.sampled_from([-700, -600, -257, -256, -255, -1, 0, 1, 254, 255, 256, 257, 1000])
grids: st.SearchStrategy[Pairs] = st.dictionaries(
    st.tuples(places, places), st.just((1.0, 1.0)), min_size=1, max_size=14
)


def outlines(cells: Mapping[tuple[int, int], tuple[float, float]]) -> list[Polygon]:
    """Return the walls' outlines, on the lattice of the grid."""
    with TemporaryDirectory() as name:
        path = write_grid(Path(name) / "site.possmap", dict(cells))
        with Grid(path) as grid:
            window = grid.window
            assert window is not None
            job = Job(grid, window, None, (Path("site.svg"),), Choices())
            found = outlines_of(job, job.occupied)
            assert found == outlines_of(job, job.known)

    def moved(ring: list[tuple[int, int]]) -> list[tuple[int, int]]:
        return [(column + window.column0, row + window.row0) for column, row in ring]

    return [Polygon(moved(one.shell), [moved(hole) for hole in one.holes]) for one in found]


@budget(max_examples=25, deadline=None)
@given(grids)
def test_single_cells_lie_where_they_are(cells: Pairs) -> None:
    found = outlines(cells)
    area = 0
    for polygon in found:
        (x0, y0), *_ = polygon.shell
        assert (y0, x0) in cells, "a polygon begins at the lower left corner of a cell of it"
        for ring in (polygon.shell, *polygon.holes):
            for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1], strict=True):
                area += ax * by - ay * bx
    assert area == 2 * len(cells)


def test_a_room_across_four_tiles_is_one_outline_with_one_hole() -> None:
    drawn = ["####", "#..#", "#..#", "####"]
    walls = {place: pair for place, pair in cells_of(drawn, -2, 254).items() if pair == (1.0, 1.0)}
    far = dict.fromkeys(((5000, 9000), (5000, 9001)), (1.0, 1.0))
    assert outlines({**walls, **far}) == [
        Polygon(
            [(254, -2), (258, -2), (258, 2), (254, 2)],
            [[(255, -1), (255, 1), (257, 1), (257, -1)]],
        ),
        Polygon([(9000, 5000), (9002, 5000), (9002, 5001), (9000, 5001)], []),
    ]


def test_an_outline_that_is_too_jagged_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("possmap.exports.outline.MOST_SIDES", 7)
    grid = write_grid(tmp_path / "site.possmap", cells_of(["#?#"]))
    for suffix in (".svg", ".dxf", ".geojson"):
        with pytest.raises(
            OutputError, match=r"outlines of more than .* sides of cells, expected fewer"
        ):
            export(grid, tmp_path / f"site{suffix}")
    export(grid, tmp_path / "site.svg", (0, 0, 0.5, 0.5))
