"""``possmap query``: what is known of a point, and which records say so."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from commands import fused, run

# A robot that is ±0.5 m unsure of where it starts and certain of all else looks at one point,
# (-1.02, -0.52), in every way there is, and then drives through it. So each record says 0.5 of it.
POINT = {"x": -1.02, "y": -0.52}
THERE = {"x2": -1.02, "y2": -0.52}
HOME = {"x": 0.0, "y": 0.0}
BEYOND = {"x": -2.04, "y": -1.04}
LOOKED_AT: Any = {
    "possmap_log": 1,
    "robot": "r1",
    "excursion": "a",
    "model": {"along": 0, "across": 0, "turn_spread": 0},
    "records": [
        {"seq": 0, "kind": "pose", **HOME, "heading": 0, "error_x": 0.5, "error_y": 0.5},
        {"seq": 1, "kind": "wall", **POINT, **THERE},
        {"seq": 2, "kind": "corner", **POINT, "corner": "end"},
        {"seq": 3, "kind": "beam", **HOME, **THERE},
        {"seq": 4, "kind": "beam", **HOME, "x2": -2.04, "y2": -1.04, "hit": False},
        {"seq": 5, "kind": "meet", "peer": "r2", "peer_excursion": "a"},
        {"seq": 6, "kind": "pose", **HOME, "heading": 0},
        {"seq": 7, "kind": "pose", **BEYOND, "heading": 0},
        {"seq": 8, "kind": "wall", **POINT, **THERE},
    ],
}


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return fused(tmp_path / "site.possmap", LOOKED_AT, options=("--set", "free_along_beams=true"))


def test_a_point_is_told_with_every_view_and_every_kind_of_record(grid: Path) -> None:
    result = run("query", grid, -1.02, -0.52)
    # N = S(.5, .5), Π = .5, K = .75·.5; the wall that waits (seq 8) and the meeting say nothing.
    # The beam that hit denies walls up to 0.55 m short of its hit: 10 cells, .5·(1 - .5/.525).
    assert result.stdout == (
        "cell            row -11, column -21, centre (-1.025, -0.525) m\n"
        "wall            belief 0.6000, plausibility 0.8000: P(wall) between 0.6000 and 0.8000\n"
        "necessity       0.7500\n"
        "possibility     0.5000\n"
        "ignorance       0.2000\n"
        "contested       0.4000\n"
        "conflict        0.3750\n"
        "mass_wall       0.6000\n"
        "mass_free       0.2000\n"
        "mass_unknown    0.2000\n"
        "probability     0.6667\n"
        "pignistic       0.7000\n"
        "pignistic_logit 0.8473\n"
        "point           necessity 0.5000\n"
        "records         6\n"
        "  r1 a seq 1 (wall): wall 0.5000\n"
        "  r1 a seq 2 (corner): point 0.5000\n"
        "  r1 a seq 3 (beam): wall 0.5000\n"
        "  r1 a seq 4 (beam): free 0.5000\n"
        "  r1 a seq 7 (pose): free 0.5000\n"
        "  r1 a seq 3 (beam): free 0.0238\n"
    )
    assert (result.stderr, result.exit_code) == ("", 0)


def test_json_tells_the_same(grid: Path) -> None:
    found = json.loads(run("query", grid, "--json", "-1.02", "-0.52").stdout)
    views = found.pop("views")
    witnesses = found.pop("witnesses")
    assert found == {
        "row": -11,
        "column": -21,
        "x": pytest.approx(-1.025),
        "y": pytest.approx(-0.525),
        "contradicted": True,
    }
    assert views == pytest.approx(
        {
            "necessity": 0.75,
            "possibility": 0.5,
            "belief": 0.6,
            "plausibility": 0.8,
            "ignorance": 0.2,
            "contested": 0.4,
            "conflict": 0.375,
            "mass_wall": 0.6,
            "mass_free": 0.2,
            "mass_unknown": 0.2,
            "probability": 2 / 3,
            "pignistic": 0.7,
            "pignistic_logit": math.log(0.7 / 0.3),
            "points": 0.5,
        },
        abs=1e-4,
    )
    assert [(one["seq"], one["kind"], one["says"]) for one in witnesses] == [
        (1, "wall", "wall"),
        (2, "corner", "point"),
        (3, "beam", "wall"),
        (4, "beam", "free"),
        (7, "pose", "free"),
        (3, "beam", "free"),
    ]
    assert {one["value"] for one in witnesses[:-1]} == {32768 / 65535}
    assert {(one["robot"], one["excursion"]) for one in witnesses} == {("r1", "a")}


def test_the_strongest_record_comes_first(tmp_path: Path) -> None:
    log, grid = tmp_path / "a.json", tmp_path / "site.possmap"
    records = [
        {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0, "error_x": 0.5, "error_y": 0.5},
        {"seq": 1, "kind": "wall", "x": 0.26, "y": 0, "x2": 0.26, "y2": 0},
        {"seq": 2, "kind": "wall", "x": 0.01, "y": 0, "x2": 0.01, "y2": 0},
        {"seq": 3, "kind": "pose", "x": 0, "y": 0, "heading": 0},
    ]
    log.write_text(json.dumps({**LOOKED_AT, "records": records}))
    run("fuse", log, "-g", grid)
    lines = run("query", grid, 0, 0).stdout.splitlines()
    # Five cells away: 0.5·(1 - 0.25/0.525).
    assert lines[1:2] + lines[-2:] == [
        "wall            belief 0.6310, plausibility 1.0000: P(wall) between 0.6310 and 1.0000",
        "  r1 a seq 2 (wall): wall 0.5000",
        "  r1 a seq 1 (wall): wall 0.2619",
    ]


def test_where_nothing_was_seen_nothing_is_known(grid: Path) -> None:
    result = run("query", grid, "1e3", "-1e-3")
    assert result.stdout == (
        "cell            row -1, column 20000, centre (1000.025, -0.025) m\n"
        "wall            belief 0.0000, plausibility 1.0000: unknown\n"
        "necessity       0.0000\n"
        "possibility     1.0000\n"
        "ignorance       1.0000\n"
        "contested       0.0000\n"
        "conflict        0.0000\n"
        "mass_wall       0.0000\n"
        "mass_free       0.0000\n"
        "mass_unknown    1.0000\n"
        "probability     0.5000\n"
        "pignistic       0.5000\n"
        "pignistic_logit 0.0000\n"
        "point           necessity 0.0000\n"
        "records         none\n"
    )


def test_the_base_rate_is_the_probability_of_what_is_unknown(grid: Path) -> None:
    result = run("query", grid, 9, 9, "--base-rate", 0.2, "--json")
    assert json.loads(result.stdout)["views"]["probability"] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("x", "y", "cell"),
    [
        ("-1", "-.5", "row -10, column -20"),
        ("-1e0", "-5e-1", "row -10, column -20"),
        ("-0", "0.15", "row 3, column 0"),  # 0.15 / 0.05 = 2.9999999999999996
        ("1e6", "-1e6", "row -20000000, column 20000000"),
    ],
)
def test_negative_coordinates_need_no_tricks(x: str, y: str, cell: str, grid: Path) -> None:
    result = run("query", grid, x, y)
    assert result.stdout.startswith(f"cell            {cell}, centre (")
    assert result.exit_code == 0
    assert run("query", "--", grid, x, y).stdout == result.stdout


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (["1"], "Missing argument 'Y'"),
        (["1", "north"], "Invalid value for 'Y': 'north' is not a valid float"),
        (["nan", "1"], "Invalid value for 'X': found nan, expected metres within ±1e6"),
        (["1", "-1000001"], "Invalid value for 'Y': found -1000001.0, expected metres within ±1e6"),
        (["1", "inf"], "Invalid value for 'Y': found inf, expected metres within ±1e6"),
        (["1", "1", "--base-rate", "1"], "1.0 is not in the range 0<x<1"),
        (["1", "1", "1"], "extra argument (1)"),
        (["1", "1", "--jsn"], "No such option"),
    ],
)
def test_wrong_usage_ends_with_2(args: list[str], complaint: str, grid: Path) -> None:
    result = run("query", grid, *args)
    assert complaint in result.stderr.splitlines()[-1]
    assert (result.stdout, result.exit_code) == ("", 2)


def test_a_grid_that_does_not_exist_is_wrong_usage(tmp_path: Path) -> None:
    result = run("query", tmp_path / "no.possmap", 0, 0)
    assert "does not exist" in result.stderr and result.exit_code == 2


def test_an_empty_grid_is_unknown_everywhere(tmp_path: Path) -> None:
    log, grid = tmp_path / "a.json", tmp_path / "empty.possmap"
    log.write_text(json.dumps({**LOOKED_AT, "records": []}))
    assert run("fuse", log, "-g", grid).exit_code == 0
    lines = run("query", grid, 0, 0).stdout.splitlines()
    assert lines[1] == "wall            belief 0.0000, plausibility 1.0000: unknown"
    assert lines[-1] == "records         none"


def test_only_the_records_that_say_most_are_listed_and_the_rest_counted(grid: Path) -> None:
    lines = run("query", grid, -1.02, -0.52, "--top", 2).stdout.splitlines()
    assert lines[-4:] == [
        "records         6",
        "  r1 a seq 1 (wall): wall 0.5000",
        "  r1 a seq 2 (corner): point 0.5000",
        "  and 4 more, which say less",
    ]
    assert len(json.loads(run("query", grid, -1.02, -0.52, "--json").stdout)["witnesses"]) == 6
