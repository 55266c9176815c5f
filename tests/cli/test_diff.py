"""``possmap diff``: two grids compared, and all that can be wrong with them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from commands import fused as fused_under
from commands import refused, run
from PIL import Image

import possmap

LOGS = sorted((Path(__file__).parents[2] / "data/json").iterdir())

# A robot without errors, 0.5 m cells: it drives from cell (0, 0) to (row 0, column 2) and sees a
# wall in row 2, columns -2 to 0. Later it tells of a bump on its own path, which contradicts it.
EXACT = {"along": 0, "across": 0, "turn_spread": 0}
RECORDS: list[dict[str, Any]] = [
    {"seq": 0, "kind": "pose", "x": 0.2, "y": 0.2, "heading": 0},
    {"seq": 1, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
    {"seq": 2, "kind": "wall", "x": -0.8, "y": 1.2, "x2": 0.2, "y2": 1.2},
    {"seq": 3, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
]
LATER: list[dict[str, Any]] = [
    {"seq": 4, "kind": "wall", "x": 0.7, "y": 0.2, "x2": 0.7, "y2": 0.2},
    {"seq": 5, "kind": "corner", "x": 1.7, "y": -0.2, "corner": "end"},
    {"seq": 6, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
]


def log(
    records: Sequence[dict[str, Any]], robot: str = "r1", model: dict[str, Any] = EXACT
) -> dict[str, Any]:
    names = {"possmap_log": 1, "robot": robot, "excursion": "a", "model": model}
    return {**names, "records": list(records)}


def fused(path: Path, *logs: dict[str, Any], settings: Sequence[str] = ()) -> Path:
    return fused_under(path, *logs, options=("--resolution", "0.5", *settings))


@pytest.fixture
def grids(tmp_path: Path) -> tuple[Path, Path]:
    """Return a grid, and another with more records and one more robot."""
    home = [{"seq": 0, "kind": "pose", "x": 5.2, "y": 0.2, "heading": 0}]
    a = fused(tmp_path / "a.possmap", log(RECORDS))
    return a, fused(tmp_path / "b.possmap", log(RECORDS + LATER), log(home, "r2"))


@pytest.fixture
def unread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no cell be read."""

    def fail(*_: object) -> None:
        raise AssertionError("a cell was read")

    monkeypatch.setattr("possmap.inspection.diff.changes_in_row", fail)


def test_two_grids_are_compared_line_by_line(grids: tuple[Path, Path]) -> None:
    a, b = grids
    result = run("diff", a, b)
    assert (result.stderr, result.exit_code) == ("", 0)
    assert result.stdout == (
        f"A             {a}\n"
        f"B             {b}\n"
        "digests       differ\n"
        "settings      none changed\n"
        "excursions    0 the same, 1 changed, 0 only in A, 1 only in B\n"
        "  r2 a: 1 record, only in B\n"
        "  r1 a: 4 -> 7 records\n"
        "records       4 in A, 8 in B\n"
        "known cells   7  100.00%  in A or B\n"
        "              6   85.71%  in A\n"
        "              7  100.00%  in B\n"
        "              6   85.71%  in both\n"
        "changed by       > 0.01    > 0.1    > 0.5     mean\n"
        "  belief         14.29%   14.29%    0.00%   0.0714\n"
        "  plausibility   14.29%   14.29%    0.00%   0.0714\n"
        "  point          14.29%   14.29%   14.29%   0.1429\n"
        "contested     1 became so, 0 no longer are\n"
        "largest       2\n"
        "  1  (1.750, -0.250) m: point 0.0000 -> 1.0000\n"
        "  2  (0.750, 0.250) m: belief 0.0000 -> 0.5000\n"
    )


def test_json_tells_the_same(grids: tuple[Path, Path]) -> None:
    a, b = grids
    found = json.loads(run("diff", a, b, "--json", "--largest", 1).stdout)
    sure = pytest.approx(1, abs=1e-6)
    one = {"over": {"0.01": 1, "0.1": 1, "0.5": 1}, "mean": pytest.approx(1 / 7, abs=1e-6)}
    half = {"over": {"0.01": 1, "0.1": 1, "0.5": 0}, "mean": pytest.approx(1 / 14, abs=1e-6)}
    digests = {}
    for side, path in (("a", a), ("b", b)):
        with possmap.open_grid(path) as grid:
            digests[side] = grid.digest()
    assert found == {
        "a": str(a),
        "b": str(b),
        "digests": digests,
        "equal": False,
        "settings": {},
        "records": {"a": 4, "b": 8},
        "excursions": {
            "equal": 0,
            "only_a": [],
            "only_b": [{"robot": "r2", "excursion": "a", "records": 1}],
            "changed": [
                {"robot": "r1", "excursion": "a", "records": {"a": 4, "b": 7}, "model": {}}
            ],
        },
        "cells": {
            "known": {"a": 6, "b": 7, "both": 6, "either": 7},
            "changed": {"belief": half, "plausibility": half, "point": one},
            "contested": {"became": 1, "ceased": 0},
            "largest": [{"x": 1.75, "y": -0.25, "quantity": "point", "a": 0, "b": sure}],
        },
        "picture": None,
    }


def test_a_window_is_compared_alone(grids: tuple[Path, Path]) -> None:
    found = json.loads(run("diff", *grids, "--json", "--window=0,0,1,1").stdout)
    assert found["cells"]["known"] == {"a": 2, "b": 2, "both": 2, "either": 2}
    assert [(one["x"], one["y"]) for one in found["cells"]["largest"]] == [(0.75, 0.25)]
    nothing = run("diff", *grids, "--window=50,50,51,51")
    assert "known cells   0    0.00%  in A or B\n" in nothing.stdout
    assert nothing.stdout.endswith("largest       none\n") and nothing.exit_code == 0


@pytest.mark.usefixtures("unread")
def test_equal_digests_are_said_without_reading_a_cell(tmp_path: Path) -> None:
    one, other = log(RECORDS), log(RECORDS + LATER, "r2")
    a = fused(tmp_path / "a.possmap", one, other)
    b = fused(tmp_path / "b.possmap", other, one)
    for same in (a, b):
        assert run("diff", a, same).stdout == (
            f"A             {a}\nB             {same}\ndigests       equal: no cell differs\n"
        )
    found = json.loads(run("diff", a, b, "--json").stdout)
    assert found["equal"] and found["cells"] is None
    assert found["excursions"] == {"equal": 2, "only_a": [], "only_b": [], "changed": []}


def test_what_is_known_of_robots_may_differ_where_the_evidence_does_not(tmp_path: Path) -> None:
    a = fused(tmp_path / "a.possmap", log(RECORDS))
    b = fused(tmp_path / "b.possmap", log(RECORDS), settings=["--set", "robots.r9.turn_bias=2"])
    lines = run("diff", a, b).stdout.splitlines()
    assert lines[2:] == [
        "digests       equal: no cell differs",
        "settings      1 changed",
        "  robots.r9.turn_bias none -> 2.0",
    ]


def test_excursions_of_one_name_that_are_not_the_same_are_told_apart(tmp_path: Path) -> None:
    other = [*RECORDS[:2], {**RECORDS[2], "y": 1.7, "y2": 1.7}, *RECORDS[3:]]
    known = {**EXACT, "along": 0.01}
    a = fused(tmp_path / "a.possmap", *(log(RECORDS, f"r{k}") for k in range(4)))
    b = fused(
        tmp_path / "b.possmap", log(RECORDS, "r0"), log(other, "r1"),
        log(RECORDS, "r2", known), log(RECORDS + LATER, "r3", known),
    )  # fmt: skip
    lines = run("diff", a, b).stdout.splitlines()
    assert lines[4:8] == [
        "excursions    1 the same, 3 changed, 0 only in A, 0 only in B",
        "  r1 a: as many records, but others",
        "  r2 a: along 0.0 -> 0.01",
        "  r3 a: 4 -> 7 records, along 0.0 -> 0.01",
    ]


def test_a_change_that_many_excursions_share_is_said_once(tmp_path: Path) -> None:
    logs = [log(RECORDS, f"r{k}", {}) for k in range(4)]
    a = fused(tmp_path / "a.possmap", *logs)
    b = fused(tmp_path / "b.possmap", *logs, settings=["--set", "along=0.01"])
    lines = run("diff", a, b).stdout.splitlines()
    assert lines[3].startswith("settings      1 changed") and "along" in lines[4]
    assert lines[6] == lines[4].replace("  along", "  4 excursions: along")


def test_one_more_log_of_the_shipped_data(tmp_path: Path) -> None:
    before, after = tmp_path / "before.possmap", tmp_path / "after.possmap"
    possmap.fuse(LOGS[:3], before)
    possmap.fuse(LOGS, after)
    found = possmap.diff(before, after)
    assert not found.equal and not found.settings and not found.changed
    assert [(one.robot, one.excursion) for one in found.only_b] == [("r1", "b")]
    cells = found.cells
    assert cells is not None and cells.in_both == cells.in_a < cells.in_b == cells.in_either
    assert len(found.largest) == 5
    for one in found.largest:
        with possmap.open_grid(after) as grid:
            row, column = grid.lattice.cell_of(one.x, one.y)
            there = possmap.Window(row, row + 1, column, column + 1)
            view = "points" if one.quantity == "point" else one.quantity
            assert grid.view(view, there)[0, 0] == one.b


def test_paper_and_robust_profile_of_the_same_logs(tmp_path: Path) -> None:
    paper, robust = tmp_path / "paper.possmap", tmp_path / "robust.possmap"
    for path, profile in ((paper, "paper"), (robust, "robust")):
        more = ("--profile", profile, "--set", "turn_noise=0.7")
        assert run("fuse", *LOGS, "-g", path, *more).exit_code == 0
    shown = run("diff", paper, robust).stdout
    assert "  estimator linear -> walls\n" in shown
    assert "excursions    5 the same, 0 changed, 0 only in A, 0 only in B\n" in shown
    found = json.loads(run("diff", paper, robust, "--json").stdout)
    changed = [len(values) for values in found["settings"].values()]
    assert changed == [2] * 10
    assert found["cells"]["contested"]["ceased"] > 0


def test_islands_at_the_ends_of_the_world(tmp_path: Path) -> None:
    far = [{**one, **{k: one[k] + 9e5 for k in ("x", "x2") if k in one}} for one in RECORDS]
    a, b = (fused(tmp_path / name, log(RECORDS)) for name in ("a.possmap", "b.possmap"))
    fused(b, log(far, "r2"))
    out = tmp_path / "d.png"
    result = run("diff", a, b, "--picture", out)
    assert "  1  (900000.250, 0.250) m: plausibility 1.0000 -> 0.0000\n" in result.stdout
    assert result.stdout.splitlines()[-1].startswith(f"{out}: ") and result.exit_code == 0


def test_empty_grids_have_nothing_to_compare_or_to_draw(tmp_path: Path) -> None:
    a = fused(tmp_path / "a.possmap", log([]))
    b = fused(tmp_path / "b.possmap", log([], "r2"))
    assert "known cells   0    0.00%  in A or B\n" in run("diff", a, b).stdout
    out = tmp_path / "d.png"
    said = refused(run("diff", a, b, "--picture", out))
    assert said == f"{out}: neither grid holds evidence, so there is nothing to show"
    assert not out.exists()


@pytest.mark.usefixtures("unread")
def test_different_resolutions_are_refused(grids: tuple[Path, Path], tmp_path: Path) -> None:
    a, _ = grids
    coarse = tmp_path / "coarse.possmap"
    possmap.fuse(LOGS[:1], coarse, {"resolution": 1})
    assert refused(run("diff", a, coarse)) == (
        f"{coarse}: resolution 1.0, where {a} has 0.5: their cells cannot be compared"
    )


def test_a_picture_is_drawn_and_its_size_said(grids: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "d.png"
    result = run("diff", *grids, "--picture", out)
    with Image.open(out) as image:
        assert result.stdout.endswith(f"{out}: {image.width} x {image.height} pixels\n")
        assert image.info["possmap:view"] == "difference"
    first = out.read_bytes()
    assert json.loads(run("diff", *grids, "--picture", out, "--overwrite", "--json").stdout)[
        "picture"
    ] == str(out)
    assert out.read_bytes() == first
    equal = run("-q", "diff", grids[0], grids[0], "--picture", out, "--overwrite")
    assert equal.stdout.endswith("no cell differs\n") and out.read_bytes() != first


@pytest.mark.usefixtures("unread")
@pytest.mark.parametrize(("name", "complaint"), [
    ("d.jpg", '{out}: unknown suffix ".jpg", expected .png'),
    ("d.png", "{out}: exists already; --overwrite replaces it"),
    ("no/d.png", "{out}: the folder {out.parent} does not exist"),
    ("folder.png", "{out}: is a folder, expected a file"),
])  # fmt: skip
def test_a_picture_that_cannot_be_written_is_refused_before_the_work(
    name: str, complaint: str, grids: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "d.png").write_text("precious")
    (tmp_path / "folder.png").mkdir()
    out = tmp_path / name
    assert refused(run("diff", *grids, "--picture", out)) == complaint.format(out=out)
    assert (tmp_path / "d.png").read_text() == "precious"


def test_no_grid_is_replaced_by_the_picture(grids: tuple[Path, Path], tmp_path: Path) -> None:
    a, b = grids
    named_so = b.rename(tmp_path / "b.png")
    said = refused(run("diff", a, named_so, "--picture", named_so, "--overwrite"))
    assert said == f"{named_so}: is the grid itself, expected another file"


def test_a_window_without_evidence_has_no_picture(grids: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "d.png"
    said = refused(run("diff", *grids, "--picture", out, "--window=50,50,51,51"))
    assert said == f"{out}: neither grid holds evidence in the window, so there is nothing to show"


@pytest.mark.parametrize(("args", "complaint"), [
    (["--overwrite"], "--overwrite belongs to --picture."),
    (["--largest", "-1"], "Invalid value for '--largest': -1 is not in the range 0<=x<=100."),
    (["--window", "1,0,0,1"], "Invalid value for '--window': "
     "found '1,0,0,1', expected X0 < X1 and Y0 < Y1"),
    (["third.possmap"], "Got unexpected extra argument (third.possmap)"),
])  # fmt: skip
def test_wrong_usage_ends_with_2(args: list[str], complaint: str, grids: tuple[Path, Path]) -> None:
    assert refused(run("diff", *grids, *args), 2) == complaint
