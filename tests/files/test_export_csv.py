"""The CSV of cells: a line for each that holds evidence, and no other."""

from __future__ import annotations

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from maps import Pairs, drawn_grid, write_grid

from possmap.exports import arrays
from possmap.exports.export import export
from possmap.grid.grid import Grid

HEAD = ["row", "column", "x", "y", "necessity", "possibility", "belief", "plausibility",
        "points"]  # fmt: skip


def test_a_drawing_becomes_these_lines(tmp_path: Path) -> None:
    path = drawn_grid(tmp_path / "site.possmap", ["?#", ".?"], -2, -1)
    export(path, tmp_path / "site.csv")
    text = (tmp_path / "site.csv").read_text(encoding="utf-8")
    with Grid(path) as grid:
        assert f"# digest: {grid.digest()}\n" in text
    assert [line.split(": ")[0] for line in text.splitlines() if line.startswith("#")] == [
        "# possmap", "# digest", "# resolution", "# frame", "# origin", "# cells",
    ]  # fmt: skip
    assert text.partition("row,")[2].splitlines()[1:] == [
        "-2,-1,-0.25,-0.75,0,0,0,1.12535175e-07,0",
        "-1,0,0.25,-0.25,0.999999887,1,0.999999887,1,0",
    ]


values = st.integers(0, 65535).map(lambda level: level / 65535)
grids = st.dictionaries(
    st.tuples(st.integers(-3, 3), st.integers(-3, 3) | st.integers(254, 258)),
    st.tuples(values, values).filter(lambda pair: pair != (0.0, 1.0)),
    min_size=1,
    max_size=12,
)


@budget(max_examples=40, deadline=None)
@given(grids, st.sampled_from([1 << 19, 700, 40, 1]))
def test_the_lines_are_the_cells_in_order(cells: Pairs, at_once: int) -> None:
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        path = write_grid(Path(name) / "site.possmap", cells, 0.05)
        patch.setattr(arrays, "_AT_ONCE", at_once)
        export(path, Path(name) / "site.csv")
        with (Path(name) / "site.csv").open(encoding="utf-8") as stream:
            lines = list(csv.reader(line for line in stream if not line.startswith("#")))
        with Grid(path) as grid:
            window = grid.window
            assert window is not None
            views = [grid.view(name) for name in HEAD[4:]]
            centre_of = grid.lattice.centre_of
    assert lines[0] == HEAD
    read = [[float(number) for number in line] for line in lines[1:]]
    assert [(row, column) for row, column, *_ in read] == sorted(cells)
    for row, column, x, y, *values in read:
        assert (x, y) == pytest.approx(centre_of(int(row), int(column)), abs=1e-9)
        at = int(row) - window.row0, int(column) - window.column0
        assert values == pytest.approx([view[at] for view in views], abs=1e-8)
