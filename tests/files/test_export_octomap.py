"""OctoMap: the library reads back what the grid says, voxel by voxel."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pyoctomap  # type: ignore[import-untyped]
import pytest
from maps import cells_of, drawn_grid, write_grid

from possmap.core.lattice import Window
from possmap.errors import OutputError
from possmap.exports import octomap
from possmap.exports.export import export
from possmap.exports.job import Choices
from possmap.grid.grid import Grid

DRAWN = ["#####", "#.??#", "3.!.7"]
C = 0.5


def voxel(tree: Any, row: int, column: int, sheet: int = 0) -> float | None:
    """Return the probability of a voxel, or None if it is unknown."""
    place = [(column + 0.5) * C, (row + 0.5) * C, (sheet + 0.5) * C]
    node = tree.search(place)
    return None if node is None else float(node.getOccupancy())


def binary(path: Path) -> Any:
    tree = pyoctomap.OcTree(1.0)
    assert tree.readBinary(str(path))
    assert tree.getResolution() == C
    return tree


@pytest.mark.parametrize(("row", "column"), [(0, 0), (-2, -3), (254, -32768), (32765, 32763)])
def test_a_binary_tree_is_occupied_free_or_unknown(row: int, column: int, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN, row, column)
    export(grid, tmp_path / "site.bt")
    tree = binary(tmp_path / "site.bt")

    def letter(up: int, right: int) -> str:
        found = voxel(tree, row + up, column + right)
        return "?" if found is None else "#" if found > 0.5 else "."

    seen = ["".join(letter(up, right) for right in range(5)) for up in (2, 1, 0)]
    assert seen == ["#####", "#.??#", "?.?.#"]
    assert voxel(tree, row, column + 1, 1) is None and voxel(tree, row, column + 1, -1) is None


def test_a_full_tree_holds_the_probability(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN, -2, -3)
    export(grid, tmp_path / "site.ot", choices=Choices(base_rate=0.2))
    tree = pyoctomap.OcTree(1.0).read(str(tmp_path / "site.ot"))
    with Grid(grid) as opened:
        for row, column in cells_of(DRAWN, -2, -3):
            cell = Window(row, row + 1, column, column + 1)
            found, likely = voxel(tree, row, column), opened.view("probability", cell, 0.2)
            if opened.view("ignorance", cell)[0, 0] == 1:
                assert found is None
            else:
                assert found == pytest.approx(float(likely[0, 0]), abs=2e-5)


@pytest.mark.parametrize(
    ("suffix", "first"), [(".bt", "OcTree binary file"), (".ot", "OcTree file")]
)
def test_the_header_states_where_it_comes_from(suffix: str, first: str, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN)
    export(grid, tmp_path / f"site{suffix}")
    head = (tmp_path / f"site{suffix}").read_bytes().partition(b"\ndata\n")[0].decode().splitlines()
    assert head[0] == f"# Octomap {first}"
    with Grid(grid) as opened:
        assert f"# digest: {opened.digest()}" in head
    assert any(line.startswith("# frame: site") for line in head)


def test_a_tree_has_no_room_beyond_its_sixteen_levels(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["#"], 0, 32768)
    for suffix in (".bt", ".ot"):
        with pytest.raises(OutputError, match=r"32769 cells from \(0, 0\), expected at most 32768"):
            export(grid, tmp_path / f"site{suffix}")
        assert not (tmp_path / f"site{suffix}").exists()


def test_too_many_voxels_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(octomap, "MOST_VOXELS", 3)
    grid = write_grid(tmp_path / "site.possmap", cells_of(["##.", ".??"]))
    for suffix in (".bt", ".ot"):
        with pytest.raises(OutputError, match="more than 3 voxels, expected fewer; take a part"):
            export(grid, tmp_path / f"site{suffix}")
        export(grid, tmp_path / f"site{suffix}", (0, 0, 0.5, 1))


def test_thresholds_that_no_cell_meets_make_no_file(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["333"])
    with pytest.raises(OutputError, match="no cell is occupied or free by the thresholds given"):
        export(grid, tmp_path / "site.bt")
    export(grid, tmp_path / "site.bt", choices=Choices(occupied=0.25))
    assert voxel(binary(tmp_path / "site.bt"), 0, 1) == pytest.approx(0.97, abs=0.01)


def test_the_most_certain_cells_stay_as_certain(tmp_path: Path) -> None:
    """OctoMap's own limits, 0.12 and 0.97, would flatten them."""
    grid = drawn_grid(tmp_path / "site.possmap", ["#."])
    export(grid, tmp_path / "site.ot")
    tree = pyoctomap.OcTree(1.0).read(str(tmp_path / "site.ot"))
    wall, free = voxel(tree, 0, 0), voxel(tree, 0, 1)
    assert wall is not None and free is not None
    assert math.isclose(1 - wall, math.exp(-16), rel_tol=0.2)
    assert math.isclose(free, math.exp(-16), rel_tol=0.2)
