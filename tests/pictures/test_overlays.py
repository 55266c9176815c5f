"""What is drawn over the cells stands where it should: home, points, tracks, the true walls."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from teams import fuse, write_logs

import possmap
from possmap.core.lattice import Window
from possmap.pictures import overlays, palettes
from possmap.pictures.overlays import Overlays
from possmap.pictures.raster import Raster
from possmap.pictures.render import Look, overlays_of, raster_of

DATA = Path(__file__).parents[2] / "data"
RESOLUTION = 0.1
GROUND = (200, 200, 200)
RASTERS = [
    Raster(Window(-30, 50, -70, 20), 1, 4),
    Raster(Window(-30, 51, -69, 21), 3, 1),
    Raster(Window(-300, 500, -700, 200), 1, 1),
]


def painted(what: Overlays, chosen: Raster) -> NDArray[np.int64]:
    """Return how far each pixel is from the plain ground."""
    image = Image.new("RGB", chosen.size, GROUND)
    overlays.paint(image, what, chosen, RESOLUTION)
    away: NDArray[np.int64] = np.abs(np.asarray(image).astype(np.int64) - GROUND).sum(axis=2)
    return away


def centre(changed: NDArray[np.int64]) -> tuple[float, float]:
    """Return x and y of the middle of what was painted [pixels]."""
    rows, columns = np.nonzero(changed)
    return (columns.min() + columns.max() + 1) / 2, (rows.min() + rows.max() + 1) / 2


@pytest.mark.parametrize("chosen", RASTERS)
@pytest.mark.parametrize("place", [(0.0, 0.0), (-3.25, 1.05), (-4.0, 2.9)])
def test_home_and_points_stand_at_their_places(chosen: Raster, place: tuple[float, float]) -> None:
    x, y = chosen.to_pixel(*place, RESOLUTION)
    for what in (Overlays(homes=[place]), Overlays(points=[(place, 0.9)])):
        at = centre(painted(what, chosen))
        assert at == pytest.approx((x, y), abs=1.01)


@pytest.mark.parametrize("chosen", RASTERS)
def test_true_walls_and_tracks_run_from_end_to_end(chosen: Raster) -> None:
    start, end = (-3.0, -1.0), (1.0, -1.0)
    lines = (
        Overlays(truth=[(*start, *end)]),
        Overlays(tracks=[("r1", [[start, end]])]),
    )
    for what in lines:
        rows, columns = np.nonzero(painted(what, chosen))
        x, y = chosen.to_pixel(*start, RESOLUTION)
        x2, _ = chosen.to_pixel(*end, RESOLUTION)
        assert (columns.min(), columns.max()) == pytest.approx((x, x2), abs=2)
        assert (rows.min() + rows.max() + 1) / 2 == pytest.approx(y, abs=1.01)
        assert rows.max() - rows.min() <= 3  # thin
        assert set(range(round(x) + 2, round(x2) - 2)) <= set(columns.tolist())  # continuous


def test_each_robot_has_a_colour_of_its_own() -> None:
    what = Overlays(tracks=[(f"r{number}", [[(0.0, 0.0), (1.0, 1.0)]]) for number in range(12)])
    colours = [colour for _, colour in what.robot_colours()]
    assert len(set(colours)) == 12


def test_tracks_are_told_from_walls_and_each_other() -> None:
    marks = [*(palettes.robot(k) for k in range(6)), palettes.TRUTH]
    for number, one in enumerate(marks):
        for other in marks[number + 1 :]:
            assert sum(abs(a - b) for a, b in zip(one, other, strict=True)) > 130, (one, other)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("over") / "site.possmap"
    possmap.fuse(DATA / "json", path)
    return path


def test_the_shipped_site_has_one_home_its_robots_and_its_true_walls(site: Path) -> None:
    look = Look(tracks=True, truth=DATA / "truth.json")
    with possmap.open_grid(site) as grid:
        found = overlays_of(grid, look, raster_of(grid, look))
    assert found.homes == [(0.0, 0.0)]
    assert [(robot, len(tracks)) for robot, tracks in found.tracks] == [
        ("r1", 2), ("r2", 2), ("r3", 1),
    ]  # fmt: skip
    walls = json.loads((DATA / "truth.json").read_text())["walls"]
    assert [list(wall) for wall in found.truth] == walls
    assert all(0 < certainty <= 1 for _, certainty in found.points) and len(found.points) > 20


def test_layers_are_not_painted_over_with_points_or_homes(site: Path) -> None:
    look = Look(layers=("necessity",))
    with possmap.open_grid(site) as grid:
        found = overlays_of(grid, look, raster_of(grid, look))
    assert found == Overlays()


def test_what_lies_outside_the_window_is_not_listed(site: Path) -> None:
    look = Look(window_m=(2.0, 2.0, 7.0, 6.0))
    with possmap.open_grid(site) as grid:
        found = overlays_of(grid, look, raster_of(grid, look))
    assert found.homes == []
    assert found.points and all(2 <= x <= 7 and 2 <= y <= 6 for (x, y), _ in found.points)


def test_of_points_in_one_pixel_the_most_certain_is_drawn(tmp_path: Path) -> None:
    def seen(robot: str, error: float, *corners: float) -> dict[str, object]:
        home = {"kind": "pose", "x": 0, "y": 0, "heading": 0, "error_x": error, "error_y": error}
        ends = [{"kind": "corner", "x": x, "y": 0.5, "corner": "end"} for x in corners]
        records = [{"seq": k, **one} for k, one in enumerate((home, *ends, home))]
        return {"possmap_log": 1, "robot": robot, "excursion": "a", "records": records}

    logs = [seen("r1", 0.5, 0.51), seen("r2", 0.3, 0.52), seen("r3", 0.4, 0.53, 0.9)]
    fuse(write_logs(tmp_path / "logs", logs), tmp_path / "g", {"resolution": 0.1})
    with possmap.open_grid(tmp_path / "g") as grid:
        found = overlays_of(grid, Look(), Raster(Window(-20, 20, -20, 20)))
    assert [(x, certainty) for (x, _), certainty in found.points] == [
        (0.52, pytest.approx(0.7)), (0.9, pytest.approx(0.6)),
    ]  # fmt: skip
