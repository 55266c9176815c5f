"""``possmap evaluate``: a grid against the truth, and truths that are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run
from PIL import Image

DATA = Path(__file__).parents[2] / "data"

# A robot without any error goes round a room of 2 × 2 m, along three of its walls.
SURE = {"along": 0, "across": 0, "turn_spread": 0}
ROOM = [[0, 0, 2, 0], [2, 0, 2, 2], [2, 2, 0, 2], [0, 2, 0, 0]]
PLACES = [(0.2, 0.2), (1.8, 0.2), (1.8, 1.8), (0.2, 1.8)]
LOG: dict[str, Any] = {
    "possmap_log": 1,
    "robot": "r1",
    "excursion": "a",
    "model": SURE,
    "records": [{"seq": 0, "kind": "pose", "t": 0, "x": 0.2, "y": 0.2, "heading": 0}],
}
for side in range(3):
    x, y, x2, y2 = ROOM[side]
    (to_x, to_y), heading = PLACES[side + 1], 90 * side
    LOG["records"] += [
        {"seq": 2 * side + 1, "kind": "wall", "x": x, "y": y, "x2": x2, "y2": y2},
        {
            "seq": 2 * side + 2,
            "kind": "pose",
            "t": side + 1,
            "x": to_x,
            "y": to_y,
            "heading": heading,
        },
    ]
TRUTH: dict[str, Any] = {
    "possmap_truth": 1,
    "walls": ROOM,
    "home": [0.2, 0.2],
    "robots": [
        {
            "robot": "r1",
            "excursion": "a",
            "track": [[t, x, y, 0, x, y, 0] for t, (x, y) in enumerate(PLACES)],
        }
    ],
    "meetings": [],
}


def fused(folder: Path, log: dict[str, Any] = LOG, *options: object, name: str = "site") -> Path:
    path = folder / "log.json"
    path.write_text(json.dumps(log))
    grid = folder / f"{name}.possmap"
    result = run("fuse", path, "-g", grid, "--set", "max_error=0.5", *options)
    assert result.exit_code == 0, result.output
    return grid


def written(folder: Path, truth: dict[str, Any], name: str = "truth.json") -> Path:
    path = folder / name
    path.write_text(json.dumps(truth))
    return path


def judged(grid: Path, truth: Path, *options: object) -> dict[str, Any]:
    result = run("evaluate", grid, "--truth", truth, "--json", *options)
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def test_a_robot_without_errors_draws_the_truth_and_is_told_so(tmp_path: Path) -> None:
    """Of 41 + 40 + 40 + 39 wall cells it saw three sides, and nothing else."""
    found = judged(fused(tmp_path), written(tmp_path, TRUTH))
    assert (found["wall_cells"], found["base_rate"]) == (121, 0.5)
    # No run was free, so the baselines' floors are all else that anybody touched.
    for name in ("possmap", "bayes", "bayes-smeared"):
        of = found["methods"][name]
        assert (of["auc"], of["f1_5cm"], of["f1_15cm"], of["precision_15cm"]) == (1, 1, 1, 1), name
        assert (of["recall_15cm"], of["dangerous_free"]) == (1, 0)
    ours = found["methods"]["possmap"]
    assert ours["brier"] == pytest.approx(0.25 * (1 - 121 / found["mask_cells"]))
    assert (ours["contradicted"], ours["mean_conflict"]) == (0, 0)
    low, high = ours["lower_validity"]
    assert (low["from"], low["to"], low["cells"]) == (0, 0, found["mask_cells"] - 121)
    assert high == {
        "from": 0.9, "to": 1.0, "cells": 121, "mean": pytest.approx(1, abs=1e-6),
        "wall": 1.0, "wall_10cm": 1.0, "wall_30cm": 1.0, "wall_local": 1.0,
    }  # fmt: skip
    assert found["rectangles"] == {
        "coverage": 1.0, "mean_half_width": 0.0, "poses": 4,
    }  # fmt: skip
    assert found["explored"]["wall"] == pytest.approx(121 / 160)
    assert found["explored"]["free"] == 0
    assert found["reference"]["true_pose_f1_15cm"] == 1
    assert 0 < found["reference"]["all_wall_f1_15cm"] < 1
    assert found["notes"] == []


def test_the_keys_are_those_of_the_contract(tmp_path: Path) -> None:
    found = judged(fused(tmp_path), written(tmp_path, TRUTH))
    assert {"mask_cells", "wall_cells", "base_rate", "methods", "rectangles"} <= set(found)
    every = {
        "auc", "f1_5cm", "f1_15cm", "precision_15cm", "recall_15cm", "brier", "log_score",
        "dangerous_free", "called_free",
    }  # fmt: skip
    for method in found["methods"].values():
        assert every <= set(method)
    ours = {
        "auc_necessity", "sharpness", "contested", "contradicted", "mean_conflict",
        "lower_validity", "upper_validity",
    }  # fmt: skip
    assert ours <= set(found["methods"]["possmap"])
    assert list(found["methods"]) == ["possmap", "bayes", "bayes-smeared"]


def test_a_map_half_a_metre_off_is_told_to_be_wrong(tmp_path: Path) -> None:
    """The truth says where robots truly were; the frame check must not save the map."""
    truth = json.loads(json.dumps(TRUTH))
    for wall in truth["walls"]:
        wall[0] += 0.5
        wall[2] += 0.5
    truth["home"][0] += 0.5
    for row in truth["robots"][0]["track"]:
        row[1] += 0.5
    found = judged(fused(tmp_path), written(tmp_path, truth))
    assert found["rectangles"]["coverage"] == 0
    assert found["methods"]["possmap"]["f1_5cm"] < 1
    top = found["methods"]["possmap"]["lower_validity"][-1]
    assert top["wall_local"] < 0.9 < top["mean"]
    assert found["reference"]["true_pose_f1_15cm"] > 0.95


def test_the_shipped_example_reads_as_a_report(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    assert run("fuse", DATA / "json", "-g", grid).exit_code == 0
    result = run("evaluate", grid, "--truth", DATA / "truth.json")
    lines = result.stdout.splitlines()
    assert result.stderr == "" and max(map(len, lines)) <= 125
    assert lines[0].startswith("judged on ") and lines[2].split()[0] == "AUC"
    assert [line.split()[0] for line in lines[3:6]] == ["possmap", "bayes", "bayes-smeared"]
    assert lines[6].startswith("for scale: calling every cell wall has F1 15cm 0.")
    assert any(line.startswith("  rectangles hold the true place at ") for line in lines)


def test_several_grids_are_judged_on_one_mask(tmp_path: Path) -> None:
    first, truth = fused(tmp_path), written(tmp_path, TRUTH)
    other = fused(tmp_path, LOG, "--profile", "robust", name="robust")
    found = judged(first, truth, "--beside", other, "--beside", first)
    assert list(found["methods"]) == ["possmap", "robust", "site", "bayes", "bayes-smeared"]
    assert found["methods"]["site"] == found["methods"]["possmap"]
    coarse = fused(tmp_path, LOG, "--resolution", "0.1", name="coarse")
    result = run("evaluate", first, "--truth", truth, "--beside", coarse)
    assert (result.exit_code, result.stderr) == (
        1, f"possmap: {coarse}: 0.1 m per cell, expected 0.05 as in {first}\n",
    )  # fmt: skip


def test_walls_alone_and_plans_are_truths_too(tmp_path: Path) -> None:
    """What they do not know is null, and said on stderr."""
    grid = fused(tmp_path)
    bare = written(tmp_path, {"possmap_truth": 1, "walls": ROOM}, "walls.json")
    result = run("evaluate", grid, "--truth", bare, "--json")
    said = "no true tracks: no rectangles, and no score at true poses"
    assert (result.exit_code, result.stderr) == (0, f"note: {said}\n")
    by_walls = json.loads(result.stdout)
    assert by_walls["rectangles"] == {
        "coverage": None, "mean_half_width": None, "poses": 0,
    }  # fmt: skip
    assert by_walls["reference"]["true_pose_f1_15cm"] is None
    assert by_walls["notes"] == [said]
    plan = np.zeros((60, 60), dtype=np.uint8)
    plan[10:50, 10:50] = 255
    Image.fromarray(plan).save(tmp_path / "plan.png")
    image = ("--truth-resolution", 0.05, "--truth-origin=-0.5,-0.5")
    by_image = judged(grid, tmp_path / "plan.png", *image)
    Image.fromarray(plan).save(tmp_path / "plan.pgm")
    (tmp_path / "map.yaml").write_text(
        "image: plan.pgm\nresolution: 0.05\norigin: [-0.5, -0.5, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    by_map = judged(grid, tmp_path / "map.yaml")
    for found in (by_walls, by_image, by_map):
        assert found["methods"]["possmap"]["f1_5cm"] == 1


def test_a_window_narrows_what_is_judged(tmp_path: Path) -> None:
    grid, truth = fused(tmp_path), written(tmp_path, TRUTH)
    some = judged(grid, truth, "--window", "0,-0.1,1,0.1")
    assert some["wall_cells"] == 20
    result = run("evaluate", grid, "--truth", truth, "--window", "50,50,60,60")
    assert (result.exit_code, result.stderr) == (
        1, f"possmap: {grid}: no cell to judge: there is no evidence in the window\n",
    )  # fmt: skip


def test_a_selection_judges_some_excursions_alone(tmp_path: Path) -> None:
    alone = judged(fused(tmp_path), written(tmp_path, TRUTH))
    other = json.loads(json.dumps(LOG)) | {"excursion": "b"}
    other["records"] = other["records"][:3]
    grid = fused(tmp_path, other)
    both = judged(grid, tmp_path / "truth.json")
    assert both["notes"] == ["1 of 2 excursions match no true track by their times"]
    one = judged(grid, tmp_path / "truth.json", "--excursions", "a*")
    assert one["methods"] == alone["methods"] and one["notes"] == []


def without_times(log: dict[str, Any]) -> dict[str, Any]:
    records = [{k: v for k, v in record.items() if k != "t"} for record in log["records"]]
    return {**log, "records": records}


def test_logs_without_times_are_judged_by_their_walls_alone(tmp_path: Path) -> None:
    grid = fused(tmp_path, without_times(LOG))
    result = run("evaluate", grid, "--truth", written(tmp_path, TRUTH), "--json")
    assert result.stderr == (
        "note: no pose matches a true track by robot, excursion and time: "
        "no rectangles, and no score at true poses\n"
    )
    assert json.loads(result.stdout)["rectangles"]["poses"] == 0


def refusal(grid: Path, truth: Path, *options: object) -> str:
    result = run("evaluate", grid, "--truth", truth, *options)
    assert (result.exit_code, result.stdout) == (1, ""), result.output
    assert result.stderr.startswith("possmap: ") and result.stderr.count("\n") == 1
    return result.stderr.removeprefix("possmap: ").rstrip("\n")


def walls_only(walls: list[Any]) -> dict[str, Any]:
    return {"possmap_truth": 1, "walls": walls}


def test_a_truth_of_another_frame_is_refused(tmp_path: Path) -> None:
    grid = fused(tmp_path)
    for walls in ([[100, 0, 100, 5]], [[v * 10 for v in wall] for wall in ROOM[1:3]]):
        truth = written(tmp_path, walls_only(walls), "far.json")
        assert refusal(grid, truth) == (
            f"{truth}: 3 of 3 walls lie near none of its walls, as seen by robots that knew their "
            "place: is it of another frame or resolution?"
        )
    across = [*ROOM, [1, -1, 1, 3], [-1, 1, 3, 1]]
    truth = written(tmp_path, walls_only(across), "across.json")
    assert refusal(grid, truth) == (
        f"{truth}: 3 of 3 runs by robots that knew their place go through its walls: "
        "is it of another frame or resolution?"
    )


@pytest.mark.parametrize(("scale", "shift", "astray"), [(1, 5, 3), (10, 1, 1)])
def test_walls_of_another_frame_than_their_own_tracks_are_refused(
    scale: float, shift: float, astray: int, tmp_path: Path
) -> None:
    walls = [[scale * value + shift for value in wall] for wall in ROOM]
    path = written(tmp_path, {**TRUTH, "walls": walls})
    assert refusal(fused(tmp_path), path) == (
        f"{path}: {astray} of 3 walls lie near none of its walls, as seen from its tracks: "
        "is it of another frame or resolution?"
    )


def test_a_truth_of_other_logs_is_refused(tmp_path: Path) -> None:
    truth = json.loads(json.dumps(TRUTH))
    for row in truth["robots"][0]["track"]:
        row[4] += 1
    path = written(tmp_path, truth)
    assert refusal(fused(tmp_path), path) == (
        f"{path}: excursion a of r1 believed itself 1.00 m from where the log has it, "
        "expected the logs' own truth"
    )


def test_a_truth_of_tracks_alone_judges_the_rectangles(tmp_path: Path) -> None:
    grid, captured = fused(tmp_path), json.loads(json.dumps(TRUTH | {"walls": []}))
    captured["robots"][0]["track"][1][1] += 0.3  # 0.3 m from where it was sure to be
    truth = written(tmp_path, captured)
    result = run("evaluate", grid, "--truth", truth)
    assert (result.exit_code, result.stdout) == (
        0, "possmap: rectangles hold the true place at 75.0% of 4 poses, mean half-width 0.00 m\n"
    )  # fmt: skip
    assert result.stderr == "note: the truth has no walls: only error rectangles are judged\n"
    told = judged(grid, truth)
    assert told["rectangles"]["coverage"] == 0.75 and told["methods"] == {}
    assert "leave --picture out" in refusal(grid, truth, "--picture", tmp_path / "out.png")
    captured["robots"][0]["robot"] = "r2"
    assert "no pose matches a track of it" in refusal(grid, written(tmp_path, captured))


BROKEN: list[tuple[dict[str, Any], str]] = [
    ({"possmap_truth": 2}, "possmap_truth: is missing or not 1, expected a truth file"),
    ({"walls": 3}, "walls: found 3, expected a list"),
    ({"walls": [], "robots": []}, "found no walls, expected some"),
    ({"walls": [[0, 0, 1]]}, "walls[0]: found [0, 0, 1], expected [x, y, x2, y2]"),
    ({"walls": [[0, 0, 1, 1e9]]}, "walls[0]: found 1000000000.0, expected a number within ±1e6"),
    ({"home": [1]}, "home: found [1], expected [x, y]"),
    ({"robots": {}}, "robots: found {}, expected a list"),
    ({"robots": [3]}, "robots[0]: found 3, expected an object"),
    (
        {"robots": [{"robot": "", "excursion": "a", "track": []}]},
        'robots[0].robot: found "", expected 1 to 64 characters of A-Z a-z 0-9 . _ : -',
    ),
    (
        {"robots": [{"robot": "r1", "excursion": "a", "track": [[0, 0, 0, "x", 0, 0, 0]]}]},
        'robots[0].track[0]: found "x", expected a number',
    ),
    (
        {"robots": [{"robot": "r1", "excursion": "a", "track": [[0]]}]},
        "robots[0].track[0]: found [0], expected "
        "[t, x, y, heading, believed_x, believed_y, believed_heading]",
    ),
]


@pytest.mark.parametrize(("wrong", "problem"), BROKEN, ids=lambda value: str(value)[:30])
def test_a_broken_truth_is_refused_with_its_place(
    wrong: dict[str, Any], problem: str, tmp_path: Path
) -> None:
    truth = written(tmp_path, TRUTH | wrong)
    assert refusal(fused(tmp_path), truth) == f"{truth}: {problem}"


def test_an_image_needs_a_resolution_and_nothing_else_takes_one(tmp_path: Path) -> None:
    grid, image = fused(tmp_path), tmp_path / "plan.png"
    Image.new("L", (9, 9), 255).save(image)
    assert refusal(grid, image) == (
        f"{image}: an image has no resolution, expected --truth-resolution METRES per pixel"
    )
    truth = written(tmp_path, TRUTH)
    assert refusal(grid, truth, "--truth-resolution", "0.05") == (
        f"--truth-resolution, which only the image of a floor plan needs: {truth}"
    )
    (tmp_path / "odd.png").write_text("no image")
    assert "not an image" in refusal(grid, tmp_path / "odd.png", "--truth-resolution", "0.05")


def test_a_grid_that_says_nothing_cannot_be_judged(tmp_path: Path) -> None:
    alone = {**LOG, "records": LOG["records"][:1]}
    grid = fused(tmp_path, alone)
    assert refusal(grid, written(tmp_path, TRUTH)) == (
        f"{grid}: holds no evidence, so nothing to judge"
    )


def test_too_large_a_window_is_refused_with_advice(tmp_path: Path) -> None:
    far = json.loads(json.dumps(LOG))
    far["records"] += [{"seq": 90, "kind": "pose", "x": 900_000, "y": 900_000, "heading": 0}]
    grid = fused(tmp_path, far, "--resolution", "5")
    said = refusal(grid, written(tmp_path, TRUTH))
    assert "cells to judge at once, expected at most 10000000" in said
    assert said.endswith("judge a part with --window X0,Y0,X1,Y1")
    small = fused(tmp_path, far, "--resolution", "5", name="small")
    assert judged(small, written(tmp_path, TRUTH), "--window", "-5,-5,5,5")["wall_cells"]


def test_wrong_usage_is_told_apart(tmp_path: Path) -> None:
    grid, truth = fused(tmp_path), written(tmp_path, TRUTH)
    for args in (
        (grid,),
        (grid, "--truth", tmp_path / "none.json"),
        (grid, "--truth", truth, "--truth-origin", "1"),
        (grid, "--truth", truth, "--base-rate", "1"),
        (grid, "--truth", truth, "--window", "1,1,0,0"),
    ):
        assert run("evaluate", *args).exit_code == 2


def test_the_report_is_drawn_and_its_path_is_checked_before_the_work(tmp_path: Path) -> None:
    grid, truth, out = fused(tmp_path), written(tmp_path, TRUTH), tmp_path / "report.png"
    assert run("evaluate", grid, "--truth", truth, "--picture", out).exit_code == 0
    digest = json.loads(run("info", grid, "--json").stdout)["digest"]
    with Image.open(out) as drawn:
        assert drawn.info["possmap:digest"] == digest
        assert min(drawn.size) > 1000
    assert (
        refusal(grid, truth, "--picture", out) == f"{out}: exists already; --overwrite replaces it"
    )
    assert run("evaluate", grid, "--truth", truth, "--picture", out, "--overwrite").exit_code == 0
    wrong = tmp_path / "report.jpg"
    assert refusal(grid, truth, "--picture", wrong) == (
        f'{wrong}: unknown suffix ".jpg", expected .png'
    )
    assert refusal(grid, truth, "--picture", tmp_path / "no" / "r.png") == (
        f"{tmp_path}/no/r.png: the folder {tmp_path}/no does not exist"
    )
