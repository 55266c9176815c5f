"""GeoJSON, SVG and DXF: tracks, walls and corners lie where the ledger has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maps import drawn_grid
from PIL import Image, ImageDraw
from teams import fuse, write_logs

from possmap.core.evidence import Geometry
from possmap.core.propagation import ErrorRectangle
from possmap.exports.export import export
from possmap.exports.geojson import swept
from possmap.exports.job import Choices
from possmap.grid.grid import Grid

MODEL = {"along": 0.01, "across": 0.02, "turn_spread": 0}
LOGS: list[dict[str, Any]] = [
    {
        "possmap_log": 1,
        "robot": "r1",
        "excursion": "a",
        "model": MODEL,
        "records": [
            {"seq": 0, "t": 0.5, "kind": "pose", "x": 0, "y": 0, "heading": 0},
            {"seq": 1, "kind": "wall", "x": 0.2, "y": 0.5, "x2": 2, "y2": 0.5, "followed": False},
            {"seq": 2, "kind": "corner", "x": 2, "y": 0.5, "corner": "convex"},
            {"seq": 3, "t": 9, "kind": "pose", "x": 2, "y": 0, "heading": 0},
            {"seq": 4, "kind": "wall", "x": 2.3, "y": 0, "x2": 2.3, "y2": 0},
            {"seq": 5, "kind": "pose", "x": 2, "y": 0, "heading": 90},
            {"seq": 6, "kind": "pose", "x": 2, "y": -1.5, "heading": 90},
        ],
    },
    {
        "possmap_log": 1,
        "robot": "r:2",
        "excursion": "b",
        "model": {"along": 0, "across": 0, "turn_spread": 0},
        "records": [
            {"seq": 0, "kind": "pose", "x": 10, "y": 10, "heading": 0},
            {"seq": 1, "kind": "wall", "x": 10, "y": 11, "x2": 12, "y2": 11},
            {"seq": 2, "kind": "pose", "x": 12, "y": 10, "heading": 0},
        ],
    },
]
CELL = 0.1


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    path = tmp_path / "site.possmap"
    fuse(write_logs(tmp_path / "logs", LOGS), path, {"resolution": CELL})
    return path


def features(grid: Path, window: tuple[float, float, float, float] | None = None) -> Any:
    """Export GeoJSON, and return its features by kind."""
    out = grid.with_suffix(".geojson")
    export(grid, out, window, overwrite=True)
    found: dict[str, list[Any]] = {}
    for feature in json.loads(out.read_text(encoding="ascii"))["features"]:
        found.setdefault(feature["properties"]["kind"], []).append(feature)
    return found


def near(expected: Any) -> Any:
    return pytest.approx(expected, abs=1e-9)


def test_tracks_walls_and_corners_are_those_of_the_ledger(grid: Path) -> None:
    found = features(grid)
    track, other = found["track"]
    assert track["geometry"]["type"] == "LineString"
    points = [(0, 0), (2, 0), (2, 0), (2, -1.5)]
    assert [tuple(point) for point in track["geometry"]["coordinates"]] == points
    said = track["properties"]
    assert (said["robot"], said["excursion"], said["seq"]) == ("r1", "a", [0, 3, 5, 6])
    assert said["t"] == [0.5, 9, None, None]
    assert said["half_x"] == near([0, 0.02, 0.02, 0.05]) and said["half_y"][3] == near(0.055)
    assert (other["properties"]["robot"], other["properties"]["excursion"]) == ("r:2", "b")

    wall, bump, followed = found["wall"]
    assert wall["geometry"]["coordinates"] == [[0.2, 0.5], [2.0, 0.5]]
    assert wall["properties"] == {
        "kind": "wall", "robot": "r1", "excursion": "a", "seq": 1, "t": None, "followed": False,
        "half_x": near(0.002), "half_y": near(0.004), "half_x2": near(0.02),
        "half_y2": near(0.04),
    }  # fmt: skip
    assert bump["geometry"] == {"type": "Point", "coordinates": [2.3, 0.0]}
    assert followed["properties"]["followed"] is True

    (corner,) = found["corner"]
    assert corner["geometry"] == {"type": "Point", "coordinates": [2.0, 0.5]}
    assert corner["properties"]["corner"] == "convex"


def test_a_walls_error_is_the_hull_of_the_rectangles_at_its_ends(grid: Path) -> None:
    slanted, bump = features(grid)["wall_error"]  # a robot without errors has no area
    (ring,) = slanted["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    corners = [
        (0.198, 0.496),
        (1.98, 0.46),
        (2.02, 0.46),
        (2.02, 0.54),
        (1.98, 0.54),
        (0.198, 0.504),
    ]
    assert [tuple(corner) for corner in ring[:-1]] == [near(corner) for corner in corners]
    assert len(bump["geometry"]["coordinates"][0]) == 5
    assert slanted["properties"]["seq"] == 1


def test_the_outline_covers_what_is_known_and_nothing_else(grid: Path) -> None:
    (outline,) = features(grid)["outline"]
    with Grid(grid) as opened:
        window = opened.window
        assert window is not None
        known = (opened.necessity() > 0) | (opened.possibility() < 1) | (opened.points() > 0)
    x0, y0 = window.column0 * CELL, window.row0 * CELL
    # Each cell drawn as 4 × 4 pixels, of which the inner ones are looked at.
    rows, columns = known.shape
    image = Image.new("1", (4 * columns, 4 * rows))
    draw = ImageDraw.Draw(image)
    for polygon in outline["geometry"]["coordinates"]:
        for index, ring in enumerate(polygon):
            corners = [((x - x0) / CELL * 4 - 0.5, (y - y0) / CELL * 4 - 0.5) for x, y in ring]
            draw.polygon(corners, fill=int(index == 0))
    assert (np.asarray(image)[2::4, 2::4] == known).all()
    assert outline["properties"]["parts"] == len(outline["geometry"]["coordinates"]) == 4


def test_a_window_takes_walls_one_by_one_and_tracks_whole(grid: Path) -> None:
    found = features(grid, (1.9, -0.2, 2.2, 0.2))
    assert [wall["properties"]["seq"] for wall in found.get("wall", [])] == []
    assert [track["properties"]["robot"] for track in found["track"]] == ["r1"]
    assert len(found["track"][0]["geometry"]["coordinates"]) == 4
    assert "corner" not in found
    found = features(grid, (1.5, 0.3, 2.5, 0.6))
    assert [wall["properties"]["seq"] for wall in found["wall"]] == [1]
    assert len(found["corner"]) == 1


def test_geojson_states_where_it_comes_from_and_that_it_lies_nowhere_on_earth(grid: Path) -> None:
    out = grid.with_suffix(".geojson")
    export(grid, out)
    head = json.loads(out.read_text(encoding="ascii"))
    assert head["type"] == "FeatureCollection"
    assert head["crs"]["properties"]["name"] == 'LOCAL_CS["possmap site",UNIT["metre",1]]'
    with Grid(grid) as opened:
        assert head["possmap"]["digest"] == opened.digest()
    assert set(head["possmap"]) == {
        "possmap", "digest", "resolution", "frame", "origin", "cells",
    }  # fmt: skip


halves = st.floats(0, 3)
places = st.floats(-5, 5)


@given(places, places, halves, halves, places, places, halves, halves, st.floats(0, 1))
def test_the_swept_area_holds_every_rectangle_on_the_way(
    x: float, y: float, hx: float, hy: float, x2: float, y2: float, hx2: float, hy2: float,
    share: float,
) -> None:  # fmt: skip
    ring = swept(Geometry(x, y, ErrorRectangle(hx, hy), x2, y2, ErrorRectangle(hx2, hy2)))
    centre = x + share * (x2 - x), y + share * (y2 - y)
    half = hx + share * (hx2 - hx), hy + share * (hy2 - hy)
    if len(ring) < 3:
        return
    for sign_x in (-1, 1):
        for sign_y in (-1, 1):
            px, py = centre[0] + sign_x * half[0], centre[1] + sign_y * half[1]
            for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1], strict=True):
                left = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
                assert left >= -1e-9 * (1 + math.dist((ax, ay), (bx, by)))


SVG = "{http://www.w3.org/2000/svg}"


def svg(grid: Path, **choices: Any) -> ElementTree.Element:
    out = grid.with_suffix(".svg")
    export(grid, out, overwrite=True, choices=Choices(**choices))
    return ElementTree.fromstring(out.read_text(encoding="utf-8"))


def layer(root: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    (group,) = [one for one in root.findall(f"{SVG}g") if one.get("id") == name]
    return group.findall(f"{SVG}path")


def subpaths(element: ElementTree.Element) -> list[list[tuple[float, float]]]:
    text = element.get("d")
    assert text is not None and re.fullmatch(r"[MLz0-9. -]+", text)
    return [
        [(float(x), float(y)) for x, y in (point.split() for point in part.rstrip("z").split("L"))]
        for part in text.split("M")[1:]
    ]


def test_a_drawing_is_to_scale_and_upside_up(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["##..", "#???"], -2, -4)
    root = svg(grid)
    assert (root.get("width"), root.get("height")) == ("20mm", "10mm")
    assert root.get("viewBox") == "0 0 2 1"
    (walls,) = layer(root, "walls")
    assert subpaths(walls) == [[(0, 1), (0.5, 1), (0.5, 0.5), (1, 0.5), (1, 0), (0, 0)]]
    (known,) = layer(root, "known")
    assert sorted(subpaths(known)[0])[-1] == (2, 0.5)
    description = root.findtext(f"{SVG}desc")
    assert description is not None
    with Grid(grid) as opened:
        assert f"digest: {opened.digest()}" in description
    assert "origin: -2.0, -1.0 m" in description and "0.5 or more" in description


def test_holes_are_drawn_as_holes(tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["###", "#.#", "###"])
    (walls,) = layer(svg(grid), "walls")
    assert [len(ring) for ring in subpaths(walls)] == [4, 4]


def test_tracks_and_sightings_are_layers_of_their_own(grid: Path) -> None:
    root = svg(grid)
    with Grid(grid) as opened:
        x0, y0 = opened.origin()
        rows, _ = opened.window.shape if opened.window else (0, 0)
    top = y0 + rows * CELL
    first, second = layer(root, "tracks")
    assert subpaths(first)[0][-1] == near((2 - x0, top + 1.5))
    assert second.findtext(f"{SVG}title") == "r:2 b"
    assert subpaths(layer(root, "sightings")[0])[0] == [
        near((0.2 - x0, top - 0.5)), near((2 - x0, top - 0.5)),
    ]  # fmt: skip
    assert len(layer(root, "sightings")) == 3


@pytest.mark.parametrize("read", [lambda root: layer(root, "walls")])
def test_the_threshold_decides_what_is_wall(
    read: Callable[[ElementTree.Element], list[ElementTree.Element]], tmp_path: Path
) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", ["3?7"])
    assert [len(read(svg(grid, occupied=t))) for t in (0.2, 0.5, 0.9)] == [2, 1, 0]


def test_a_cad_program_finds_layers_units_and_places(grid: Path) -> None:
    from ezdxf.filemanagement import readfile

    out = grid.with_suffix(".dxf")
    export(grid, out)
    drawing = readfile(out)
    assert not drawing.audit().has_errors
    assert drawing.units == 6  # metres
    facts = dict(drawing.header.custom_vars.properties)
    with Grid(grid) as opened:
        assert facts["possmap digest"] == opened.digest()
    assert facts["possmap frame"].startswith("site: ")
    by_layer: dict[str, list[Any]] = {}
    for entity in drawing.modelspace():
        by_layer.setdefault(entity.dxf.layer, []).append(entity)
    assert [len(by_layer[name]) for name in ("SIGHTINGS", "TRACKS", "CORNERS")] == [3, 2, 1]
    line, bump, _ = by_layer["SIGHTINGS"]
    assert (*line.dxf.start, *line.dxf.end) == near((0.2, 0.5, 0, 2, 0.5, 0))
    assert (bump.dxftype(), tuple(bump.dxf.location)) == ("POINT", near((2.3, 0, 0)))
    assert list(by_layer["TRACKS"][0].get_points("xy")) == [(0, 0), (2, 0), (2, 0), (2, -1.5)]


def test_walls_in_cad_are_closed_lines_around_the_cells(tmp_path: Path) -> None:
    from ezdxf.filemanagement import readfile

    grid = drawn_grid(tmp_path / "site.possmap", ["###", "#.#", "###"], -3, -4)
    out = tmp_path / "site.dxf"
    export(grid, out)
    shell, hole = readfile(out).modelspace().query("LWPOLYLINE")
    assert shell.closed and hole.closed  # type: ignore[attr-defined]
    assert list(shell.get_points("xy")) == [  # type: ignore[attr-defined]
        (-2, -1.5), (-0.5, -1.5), (-0.5, 0), (-2, 0),
    ]  # fmt: skip
    assert sorted(hole.get_points("xy"))[0] == (-1.5, -1)  # type: ignore[attr-defined]


def test_a_cad_program_opens_a_site_far_from_the_origin_on_all_of_it(tmp_path: Path) -> None:
    from ezdxf.filemanagement import readfile

    grid = drawn_grid(tmp_path / "site.possmap", ["##.", "#.?"], 1_082_200, 896_420)
    out = tmp_path / "site.dxf"
    export(grid, out)
    drawing = readfile(out)
    low, high = (448210, 541100), (448211.5, 541101)
    assert drawing.header["$EXTMIN"][:2] == low and drawing.header["$EXTMAX"][:2] == high
    (view,) = drawing.viewports.get("*Active")
    assert tuple(view.dxf.center)[:2] == (448210.75, 541100.5) and 1.5 < view.dxf.height < 2
    assert drawing.header["$PDSIZE"] / view.dxf.height >= 0.01  # points are seen, not single pixels
