"""The ROS map: what map_server publishes of it is what the grid says, cell by cell."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import map_server
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from maps import PAIRS, Pairs, cells_of, drawn_grid, write_grid
from PIL import Image

from possmap.exports import job as export_job
from possmap.exports.export import export
from possmap.exports.job import MODES, Choices
from possmap.grid.grid import Grid
from possmap.lab.simulate.mission_file import read_mission
from possmap.truth.plans import read_ros_map

DRAWN = [
    "#####?",
    "#...#?",
    "#.!.##",
    "##?#?.",
]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("row", "column"), [(0, 0), (-2, -3), (254, 255), (-1000, 70000)])
def test_map_server_sees_what_is_drawn(mode: str, row: int, column: int, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN, row, column)
    out = tmp_path / "site.yaml"
    export(grid, out, choices=Choices(mode=mode))
    seen = map_server.load(out)
    # As strong for a wall as against it: unknown, or half of each.
    assert seen.letters() == [
        line.replace("!", "?" if mode == "trinary" else "%") for line in DRAWN
    ]
    assert seen.resolution == 0.5
    assert seen.origin == (column * 0.5, row * 0.5, 0.0)


def test_thresholds_decide_and_stand_in_the_comments(tmp_path: Path) -> None:
    grid = write_grid(
        tmp_path / "site.possmap",
        {(0, 0): (0.3, 1.0), (0, 1): (0.7, 1.0), (0, 2): (0.0, 0.3), (0, 3): (0.0, 0.7)},
    )
    out = tmp_path / "site.yaml"

    def seen(occupied: float, free: float) -> list[str]:
        export(grid, out, overwrite=True, choices=Choices(occupied=occupied, free=free))
        said = f"belief >= {occupied:g}, else free where plausibility <= {free:g}"
        assert said in out.read_text(encoding="utf-8")
        return map_server.load(out).letters()

    assert seen(0.5, 0.5) == ["?#.?"]
    assert seen(0.2, 0.8) == ["##.."]
    assert seen(0.9, 0.1) == ["????"]


def test_the_files_state_where_they_come_from(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN)
    export(grid, tmp_path / "site.yaml")
    with Grid(grid) as opened:
        digest = opened.digest()
    yaml_text = (tmp_path / "site.yaml").read_text(encoding="utf-8")
    image = (tmp_path / "site.pgm").read_bytes()
    for fact in (f"# digest: {digest}", "# possmap: ", "# resolution: 0.5 m", "# frame: site"):
        assert fact in yaml_text
        assert fact.encode() in image
    assert list(yaml.safe_load(yaml_text)) == [
        "image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh",
    ]  # fmt: skip


values = st.integers(0, 20).map(lambda level: level / 20)
grids = st.dictionaries(
    st.tuples(st.integers(-3, 3), st.integers(-3, 3)),
    st.tuples(values, values).filter(lambda pair: pair != (0.0, 1.0)),
    min_size=1,
)


@budget(max_examples=60, deadline=None)
@given(grids, st.sampled_from(MODES), values.filter(bool), values.filter(lambda v: v < 1))
def test_every_cell_comes_back_as_what_the_grid_says(
    cells: Pairs, mode: str, occupied: float, free: float
) -> None:
    with TemporaryDirectory() as name:
        path = write_grid(Path(name) / "site.possmap", cells)
        out = Path(name) / "site.yaml"
        export(path, out, choices=Choices(mode=mode, occupied=occupied, free=free))
        seen = map_server.load(out)
        with Grid(path) as grid:
            window = grid.window
            belief, plausibility, likely = (
                grid.view(name) for name in ("belief", "plausibility", "probability")
            )
            known = (grid.necessity() > 0) | (grid.possibility() < 1)
    assert window is not None and (seen.height, seen.width) == window.shape
    for at in np.ndindex(*window.shape):
        if belief[at] >= occupied:
            expected = 100
        elif plausibility[at] <= free:
            expected = 0
        elif mode == "trinary" or not known[at]:
            expected = -1
        else:
            expected = min(99, max(1, int(np.rint(100 * likely[at]))))
        assert seen.data[at[0]][at[1]] == expected


def test_scale_keeps_all_hundred_steps(tmp_path: Path) -> None:
    likely = np.arange(1, 100) / 100
    # N of 0 and Π = p/(1-p), or the other way round, have the probability p.
    cells = {
        (0, int(k)): (0.0, p / (1 - p)) if p < 0.5 else (1 - (1 - p) / p, 1.0)
        for k, p in enumerate(likely.tolist())
        if p != 0.5
    }
    grid = write_grid(tmp_path / "site.possmap", cells)
    for mode in ("scale", "raw"):
        export(grid, tmp_path / f"{mode}.yaml", choices=Choices(mode=mode, occupied=1, free=0))
        assert map_server.load(tmp_path / f"{mode}.yaml").data == [
            [-1 if percent == 50 else percent for percent in range(1, 100)]
        ]


def test_ros_1_sees_the_unknown_of_scale_too(tmp_path: Path) -> None:
    """It looks at transparency only after both thresholds."""
    grid = drawn_grid(tmp_path / "site.possmap", ["#?."])
    export(grid, tmp_path / "site.yaml", choices=Choices(mode="scale"))
    said = yaml.safe_load((tmp_path / "site.yaml").read_text(encoding="utf-8"))
    with Image.open(tmp_path / "site.png") as image:
        red, green, blue, opacity = image.convert("RGBA").getpixel((1, 0))  # type: ignore[misc]
    darkness = 1 - (red + green + blue) / 3 / 255
    assert opacity == 0 and said["free_thresh"] <= darkness <= said["occupied_thresh"]


@pytest.mark.parametrize("mode", ["trinary", "scale"])
@pytest.mark.parametrize(("row", "column"), [(0, 0), (-7, -151), (3, 40001)])
@pytest.mark.parametrize("resolution", [0.05, 0.5, 1 / 3])
def test_a_simulated_world_lines_up_to_the_cell(
    mode: str, row: int, column: int, resolution: float, tmp_path: Path
) -> None:
    cells = cells_of(DRAWN, row, column)
    path = write_grid(tmp_path / "site.possmap", cells, resolution)
    export(path, tmp_path / "site.yaml", choices=Choices(mode=mode))
    plan = read_ros_map(tmp_path / "site.yaml")
    with Grid(path) as grid:
        lattice, window = grid.lattice, grid.window
    assert window is not None and plan.free.shape == window.shape
    for (cell_row, cell_column), pair in cells.items():
        for inside in (0.01, 0.5, 0.99):
            x, y = (cell_column + inside) * resolution, (cell_row + inside) * resolution
            assert lattice.cell_of(x, y) == (cell_row, cell_column)
            assert plan.is_free(x, y) == (pair == PAIRS["."]), (cell_row, cell_column)


def test_bands_and_pieces_of_rows_give_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far: Pairs = {**cells_of(DRAWN, -2, -3), **cells_of(DRAWN, 300, 520)}
    grid = write_grid(tmp_path / "site.possmap", far)
    export(grid, tmp_path / "1.yaml")
    seen = map_server.load(tmp_path / "1.yaml")
    assert (seen.height, seen.width) == (306, 529)
    assert [line[:6] for line in seen.letters()[-4:]] == [x.replace("!", "?") for x in DRAWN]
    assert [line[-6:] for line in seen.letters()[:4]] == [x.replace("!", "?") for x in DRAWN]
    for most in (1000, 100):  # a row has 529 cells
        monkeypatch.setattr(export_job.bands, "__defaults__", (False, most))
        export(grid, tmp_path / "2.yaml", overwrite=True)
        assert (tmp_path / "2.pgm").read_bytes() == (tmp_path / "1.pgm").read_bytes()
        export(grid, tmp_path / "3.yaml", overwrite=True, choices=Choices(mode="scale"))
        data = map_server.load(tmp_path / "3.yaml").data
        assert [[-1 if one == 50 else one for one in row] for row in data] == seen.data


@pytest.mark.parametrize("name", ["a map", "#1", "yes", "a: b", "\"'", "Küche", "-", "1e3"])
def test_an_image_is_found_whatever_it_is_called(name: str, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["#."])
    export(grid, tmp_path / f"{name}.yaml")
    assert map_server.load(tmp_path / f"{name}.yaml").letters() == ["#."]


@pytest.mark.parametrize("resolution", [1e-6, 0.1, 1 / 3, 30.0])
def test_numbers_are_numbers_in_yaml(resolution: float, tmp_path: Path) -> None:
    """PyYAML takes 1e-06 for text."""
    grid = drawn_grid(tmp_path / "site.possmap", ["#."], -10, 7, resolution)
    export(grid, tmp_path / "site.yaml")
    seen = map_server.load(tmp_path / "site.yaml")
    assert seen.resolution == resolution
    assert math.dist(seen.origin[:2], (7 * resolution, -10 * resolution)) < 1e-3 * resolution


def test_a_mission_takes_the_map_as_its_world(tmp_path: Path) -> None:
    grid = drawn_grid(
        tmp_path / "site.possmap", ["#####", "#...#", "#...#", "#####"], -3, -151, 1.0
    )
    export(grid, tmp_path / "site.yaml")
    mission = tmp_path / "mission.yaml"
    mission.write_text("world: {map: site.yaml, home: [-148.5, -1]}")
    world = read_mission(mission, {}).world
    assert world.bounds == (-150, -2, -147, 0)
    assert {tuple(wall) for wall in world.walls.tolist()} == {
        (-150, -2, -147, -2), (-150, 0, -147, 0), (-150, -2, -150, 0), (-147, -2, -147, 0),
    }  # fmt: skip
