"""``possmap config``, and which setting holds when: the levels, and what a grid keeps (CLI.md)."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from commands import run
from teams import digest

import possmap

pytestmark = pytest.mark.default_profile

LOG: Any = {
    "possmap_log": 1,
    "robot": "r1",
    "excursion": "a",
    "records": [
        {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 2, "y": 0, "heading": 0},
    ],
}


def write(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def in_force(*args: object) -> dict[str, Any]:
    result = run("config", "--json", *args)
    assert (result.stderr, result.exit_code) == ("", 0)
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def fused(folder: Path, *args: object) -> Path:
    grid = folder / "site.possmap"
    result = run("fuse", write(folder / "a.json", LOG), "-g", grid, *args)
    assert result.exit_code == 0, result.stderr
    return grid


def turn_spreads(grid: Path) -> dict[str, float]:
    """Return ``turn_spread`` of the model in force of each robot's excursion."""
    with possmap.open_grid(grid) as opened:
        return {entry.robot: entry.model.turn_spread for entry in opened.ledger.entries()}


def test_each_level_beats_the_one_below(tmp_path: Path) -> None:
    text = "resolution: 0.1\nturn_spread: 1\nsensor: 0.01\n"
    config = ("--profile", "paper", "--config", write(tmp_path / "site.yaml", text))
    assert (in_force(*config)["resolution"], in_force(*config)["turn_spread"]) == (0.1, 1.0)
    flag = (*config, "--resolution", "0.2")
    assert (in_force(*flag)["resolution"], in_force(*flag)["sensor"]) == (0.2, 0.01)
    last = ("--set", "resolution=0.3", "--set", "sensor=0.5", "--set", "sensor=.25", *flag)
    found = in_force(*last)
    assert (found["resolution"], found["sensor"], found["turn_spread"]) == (0.3, 0.25, 1.0)


def test_what_is_printed_can_be_given_back(tmp_path: Path) -> None:
    given = ("--resolution", "1e-3", "--set", "robots.r.1:b.turn_bias=-2", "--set", "base_rate=.3")
    printed = run("config", *given).stdout
    assert run("config", "--config", write(tmp_path / "site.yaml", printed)).stdout == printed
    assert "resolution: 0.001                    # metres per cell\n" in printed
    assert 'robots:\n  "r.1:b": {turn_bias: -2.0}\n' in printed
    assert max(map(len, printed.splitlines())) <= 100


def test_a_logs_own_model_beats_them_all_unless_models_are_not_accepted(tmp_path: Path) -> None:
    logs = [
        write(tmp_path / "b.json", {**LOG, "robot": "r2", "model": {"turn_spread": 0.5}}),
        write(tmp_path / "c.json", {**LOG, "robot": "r3", "model": {"turn_bias": 1}}),
    ]
    robots = ("--set", "robots.r2.turn_spread=3", "--set", "robots.r3.turn_spread=4")
    for accept, expected in (("true", 0.5), ("false", 3.0)):
        grid = tmp_path / f"{accept}.possmap"
        run("fuse", *logs, "-g", grid, *robots, "--set", f"accept_models={accept}")
        assert turn_spreads(grid) == {"r2": expected, "r3": 4.0}


def test_a_grid_keeps_what_shapes_evidence_and_later_calls_need_none(tmp_path: Path) -> None:
    kept = {"resolution": 0.25, "free_along_walls": True, "turn_spread": 1.0}
    sets = [f"--set={name}={str(value).lower()}" for name, value in kept.items()]
    grid = fused(tmp_path, *sets, "--set", "limit_nesting=4", "--set", "base_rate=0.1")
    assert (
        run("fuse", write(tmp_path / "b.json", {**LOG, "robot": "r2"}), "-g", grid).exit_code == 0
    )
    assert turn_spreads(grid) == {"r1": 1.0, "r2": 1.0}
    found = in_force("-g", grid)
    assert found == {**in_force(), **kept}, "limits and the base rate belong to each call"
    assert run("fuse", tmp_path / "b.json", "-g", grid, *sets).exit_code == 0, "equal is no change"


@pytest.mark.parametrize(
    ("args", "origin", "message"),
    [
        (
            ["--resolution", ".1"],
            "--resolution",
            "resolution, found 0.1, but {} was made with 0.25",
        ),
        (["--set", "sensor=1"], "--set", "sensor, found 1.0, but {} was made with 0.0"),
        (["--config", "CONFIG"], "CONFIG:2", "drift, found 1.0, but {} was made with 0.0"),
        (
            ["--profile", "paper"],
            "--profile paper",
            "resolution, found 0.05, but {} was made with 0.25",
        ),
        (
            ["--set", "independence=excursion"],
            "--set",
            "independence, found excursion, but {} was made with detection",
        ),
    ],
)
def test_a_differing_setting_is_refused_with_both_values(
    args: list[str], origin: str, message: str, tmp_path: Path
) -> None:
    grid = fused(tmp_path, "--profile", "paper", "--resolution", "0.25")
    before = grid.read_bytes()
    config = str(write(tmp_path / "site.yaml", "# mine\ndrift: 1\n"))
    args = [arg.replace("CONFIG", config) for arg in args]
    expected = f"possmap: {origin.replace('CONFIG', config)}: {message.format(grid)} and keeps it; "
    for command in (["fuse", tmp_path / "a.json", "-g", grid], ["config", "-g", grid]):
        result = run(*command, *args)
        assert result.stderr.startswith(expected) and result.stderr.count("\n") == 1
        assert (result.stdout, result.exit_code) == ("", 1)
    assert grid.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("sites", "resolution=0.1"),
        ("sites", "free_along_walls=false"),
        ("my sites", "resolution=0.1"),
    ],
)
def test_the_advice_in_a_refusal_can_be_followed(
    name: str, asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / name
    folder.mkdir()
    monkeypatch.chdir(folder)
    grid = fused(folder)
    refusal = run("fuse", "a.json", "-g", grid, "--set", asked)
    advice = shlex.split(refusal.stderr.partition("to fuse its logs anew: possmap ")[2])
    assert run(*advice).exit_code == 0
    assert run("fuse", "a.json", "-g", "there.possmap", "--set", asked).exit_code == 0
    assert digest(folder / "NEW.possmap") == digest(folder / "there.possmap")


def test_later_entries_of_robots_hold_for_excursions_not_yet_known(tmp_path: Path) -> None:
    grid = fused(tmp_path)
    later = {**LOG["records"][0], "seq": 2}
    longer = {**LOG, "records": [*LOG["records"], later]}
    again = write(tmp_path / "b.json", {**longer, "carried": [{**LOG, "excursion": "b"}]})
    result = run("fuse", again, "-g", grid, "--set", "robots.r1.turn_spread=0.5")
    assert (result.stderr, result.exit_code) == ("", 0)
    with possmap.open_grid(grid) as opened:
        spread = {one.excursion: one.model.turn_spread for one in opened.ledger.entries()}
    assert spread == {"a": 2.0, "b": 0.5}
    assert in_force("-g", grid)["robots"] == {"r1": {"turn_spread": 0.5}}
    run("fuse", again, "-g", grid, "--set", "robots.r1.turn_spread=0.75")
    assert in_force("-g", grid)["robots"] == {"r1": {"turn_spread": 0.75}}, "they may change"


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (
            ["--set", "resolutoin=1"],
            '--set: unknown setting "resolutoin", did you mean "resolution"?',
        ),
        (["--set", "zzz=1"], '--set: unknown setting "zzz"; possmap config lists the known ones'),
        (
            ["--set", "robots.r1.turn_spred=1"],
            '--set: unknown parameter "turn_spred" of robot r1, did you mean "turn_spread"?',
        ),
        (["--set", "robots=1"], "robots.NAME.PARAMETER"),
        (["--set", "robots.r1=1"], '"r1", expected robots.NAME.PARAMETER'),
        (["--set", "robots.r 1.drift=1"], 'found "r 1", expected robots.NAME.PARAMETER'),
        (["--set", "max_error=0"], '--set: max_error, found "0", expected a number > 0'),
        (["--set", "resolution=1_"], '--set: resolution, found "1_", expected a number'),
        (["--set", "free_along_walls=1"], 'found "1", expected true or false'),
        (["--set", "drift"], "'drift', expected KEY=VALUE"),
        (["--resolution", "x"], '--resolution: resolution, found "x", expected a number'),
        (["--profile", "bold"], "'bold' is not one of 'paper', 'robust'"),
        (["--config", "no.yaml"], "'no.yaml' does not exist"),
        (["extra"], "extra argument (extra)"),
    ],
)
def test_wrong_usage_ends_with_2(args: list[str], complaint: str) -> None:
    result = run("config", *args)
    assert complaint in "".join(result.stderr.splitlines()[-1:])
    assert (result.stdout, result.exit_code) == ("", 2)


def test_the_profile_robust_is_the_methods_and_leaves_the_rest_alone() -> None:
    robust = {
        "estimator": "walls",
        "orthogonal": True,
        "independence": "excursion",
        "free_fusion": "dempster",
        "certainty_power": 2.0,
        "pass_weight": 0.5,
        "free_along_walls": True,
        "free_along_beams": True,
        "clip_coobserved": True,
        "path_width": 0.15,
        "turn_noise": 0.7,
    }
    assert in_force("--profile", "robust") == {**in_force(), **robust}
    paper = in_force("--profile", "robust", "--set", "estimator=linear")
    assert paper["estimator"] == "linear", "--set beats --profile"


def test_robust_is_the_default_of_a_new_grid_and_an_old_one_keeps_its_own(tmp_path: Path) -> None:
    assert in_force() == in_force("--profile", "robust") != in_force("--profile", "paper")
    assert in_force("-g", fused(tmp_path))["estimator"] == "walls"
    paper = tmp_path / "paper.possmap"
    assert run("fuse", tmp_path / "a.json", "-g", paper, "--profile", "paper").exit_code == 0
    assert run("fuse", tmp_path / "a.json", "-g", paper).exit_code == 0
    assert in_force("-g", paper)["estimator"] == "linear"
    refused = run(
        "fuse", tmp_path / "a.json", "-g", tmp_path / "n", "--set", "independence=detection"
    )
    assert "expected 1 without independence: excursion" in refused.stderr
    assert (refused.exit_code, (tmp_path / "n").exists()) == (1, False)


def test_what_does_not_go_with_the_default_profile_is_told_of_it() -> None:
    assert run("config", "--set", "independence=detection").stderr == (
        "possmap: the default profile robust (--profile paper has no discounts): certainty_power, "
        "found 2.0, expected 1 without independence: excursion\n"
    )
    paper = in_force("--profile", "paper")
    assert paper["certainty_power"] == 1


def test_the_advice_repeats_all_that_was_asked_for(tmp_path: Path) -> None:
    grid = fused(tmp_path, "--profile", "paper")
    config = write(tmp_path / "my site.yaml", "drift: 1\n")
    asked = ["--profile", "robust", "--config", str(config), "--set", "sensor=0.1"]
    refusal = run("fuse", tmp_path / "a.json", "-g", grid, *asked)
    assert "(" in refusal.stderr and " more differ); to fuse its logs anew: " in refusal.stderr
    advice = shlex.split(refusal.stderr.partition("to fuse its logs anew: possmap ")[2])
    assert advice[:3] == ["fuse", str(grid), "-g"]
    assert sorted(advice[4:]) == sorted([*asked[:-1], "sensor=0.1"])
    new = tmp_path / "NEW.possmap"
    assert run(*[new if word == "NEW.possmap" else word for word in advice]).exit_code == 0
    assert run("fuse", tmp_path / "a.json", "-g", new, *asked).exit_code == 0, "no circle"


def test_an_entry_of_robots_beats_the_general_value_whatever_its_level(tmp_path: Path) -> None:
    config = write(tmp_path / "site.yaml", "robots:\n  r1: {turn_spread: 0.25}\n")
    grid = fused(tmp_path, "--config", config, "--set", "turn_spread=1")
    other = write(tmp_path / "b.json", {**LOG, "robot": "r2"})
    assert run("fuse", other, "-g", grid).exit_code == 0
    assert turn_spreads(grid) == {"r1": 0.25, "r2": 1.0}
