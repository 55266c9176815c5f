"""``possmap export``: ``.npz`` of all evidence or of a window (CLI.md)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import fused, run

# A robot without errors, 0.5 m cells: it drives from cell (0, 0) to (row 0, column 2), sees a wall
# in row 2, columns -2 to 0, and a bump in (row -1, column 3).
LOG: Any = {
    "possmap_log": 1,
    "robot": "r1",
    "excursion": "a",
    "model": {"along": 0, "across": 0, "turn_spread": 0},
    "records": [
        {"seq": 0, "kind": "pose", "x": 0.2, "y": 0.2, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
        {"seq": 2, "kind": "wall", "x": -0.8, "y": 1.2, "x2": 0.2, "y2": 1.2},
        {"seq": 3, "kind": "wall", "x": 1.7, "y": -0.2, "x2": 1.7, "y2": -0.2},
        {"seq": 4, "kind": "pose", "x": 1.2, "y": 0.2, "heading": 0},
    ],
}
DRAWN = [  # the highest y first; a row more below
    "###???",
    "??????",
    "??...?",
    "?????#",
]


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return fused(tmp_path / "site.possmap", LOG, options=("--resolution", "0.5"))


def drawn(path: Path) -> list[str]:
    """Draw an .npz: # wall, . free, ? unknown; the highest y first."""
    with np.load(path) as arrays:
        pairs = np.stack([arrays["necessity"], arrays["possibility"]], axis=-1)

    def letter(necessity: float, possibility: float) -> str:
        letters = {(0.0, 1.0): "?", (1.0, 1.0): "#", (0.0, 0.0): "."}
        return letters[round(necessity, 3), round(possibility, 3)]

    return ["".join(letter(*map(float, pair)) for pair in row) for row in pairs[::-1]]


def test_all_evidence_is_written_and_no_cell_more(grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "site.npz"
    result = run("export", grid, "-o", out)
    assert result.stdout == f"{out}: 4 rows × 6 columns of 0.5 m, from (-1.00, -0.50)\n"
    assert (result.stderr, result.exit_code) == ("", 0)
    assert drawn(out) == DRAWN
    with np.load(out) as arrays:
        assert sorted(arrays) == [
            "belief", "necessity", "origin", "pignistic_logit", "plausibility", "possibility",
            "resolution",
        ]  # fmt: skip
        assert arrays["necessity"].dtype == arrays["possibility"].dtype == np.float32
        assert arrays["origin"].tolist() == [-1.0, -0.5]
        assert arrays["resolution"] == 0.5


def test_a_window_may_be_smaller_or_larger_and_outside_is_ignorance(
    grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / "site.npz"
    result = run("export", grid, "-o", out, "--window", "-1.5,-0.5,0.6,2")
    assert result.stdout == f"{out}: 5 rows × 5 columns of 0.5 m, from (-1.50, -0.50)\n"
    assert drawn(out) == ["?????", "?###?", "?????", "???..", "?????"]
    assert run("export", grid, "-o", out, "--window", "7,7,7.5,8", "--overwrite").exit_code == 0
    assert drawn(out) == ["?", "?"]


def test_quiet_prints_nothing(grid: Path, tmp_path: Path) -> None:
    result = run("-q", "export", grid, "-o", tmp_path / "site.npz")
    assert (result.output, result.exit_code) == ("", 0)
    assert drawn(tmp_path / "site.npz") == DRAWN


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("no/site.npz", "the folder {folder} does not exist"),
        ("site.npx", 'unknown suffix ".npx", did you mean ".npz"?'),
        (
            "site",
            'unknown suffix "", expected one of .npz, .yaml, .yml, .mcap, .geojson, .csv, '
            ".png, .svg, .dxf, .bt, .ot",
        ),
        (".", None),
        ("a" * 300 + ".npz", None),
    ],
)
def test_an_output_that_cannot_be_is_refused_in_one_line(
    name: str, complaint: str | None, grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / name
    before = sorted(tmp_path.iterdir())
    result = run("export", grid, "-o", out)
    assert result.stderr.startswith(f"possmap: {out}: ") and result.stderr.count("\n") == 1
    if complaint:
        assert result.stderr.endswith(complaint.format(folder=out.parent) + "\n")
    assert (result.stdout, result.exit_code) == ("", 1)
    assert sorted(tmp_path.iterdir()) == before


def test_an_empty_grid_is_refused_unless_a_window_is_named(tmp_path: Path) -> None:
    grid, log, out = tmp_path / "empty.possmap", tmp_path / "a.json", tmp_path / "site.npz"
    log.write_text(json.dumps({**LOG, "records": []}))
    run("fuse", log, "-g", grid)
    result = run("export", grid, "-o", out)
    expected = f"possmap: {grid}: holds no evidence, so there is nothing to show\n"
    assert (result.stderr, result.exit_code, out.exists()) == (expected, 1, False)
    assert run("export", grid, "-o", out, "--window", "0,0,0.1,0.1").exit_code == 0
    assert drawn(out) == ["??", "??"]


def test_more_than_a_thousand_million_cells_are_refused_with_advice(tmp_path: Path) -> None:
    grid, log, out = tmp_path / "far.possmap", tmp_path / "a.json", tmp_path / "site.npz"
    far = {"seq": 5, "kind": "wall", "x": 5e4, "y": 5e4, "x2": 5e4, "y2": 5e4}
    records = [*LOG["records"], far, {**LOG["records"][4], "seq": 6}]
    log.write_text(json.dumps({**LOG, "records": records}))
    run("fuse", log, "-g", grid, "--resolution", "0.5")
    result = run("export", grid, "-o", out)
    assert result.stderr == (
        f"possmap: {grid}: 100002 × 100003 cells, expected at most 10⁹; "
        "take a part of it: --window X0,Y0,X1,Y1\n"
    )
    assert (result.stdout, result.exit_code, out.exists()) == ("", 1, False)
    assert (
        run("export", grid, "-o", out, "--window", "49999.5,49999.5,50000.5,50001").exit_code == 0
    )
    assert drawn(out) == ["??", "?#", "??"]
    again = run("export", grid, "-o", out, "--overwrite", "--window", "-1e6,-1e6,1e6,1e6")
    assert "4000000 × 4000000 cells" in again.stderr and again.exit_code == 1
    assert drawn(out) == ["??", "?#", "??"]


@pytest.mark.parametrize(
    "window",
    [
        "0,0,1",
        "0,0,1,1,1",
        "a,b,c,d",
        "",
        "1,0,0,1",
        "0,0,0,1",
        "0,0,nan,1",
        "-inf,0,inf,1",
        "0,0,1e300,1",
    ],
)
def test_a_window_that_is_none_is_wrong_usage(window: str, grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "site.npz"
    result = run("export", grid, "-o", out, "--window", window)
    assert f"found '{window}', expected " in result.stderr
    assert (result.stdout, result.exit_code, out.exists()) == ("", 2, False)
