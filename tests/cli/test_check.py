"""``possmap check``: validates logs and says what is in them; changes nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main


def run(*args: object, stdin: bytes | None = None) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], input=stdin, catch_exceptions=False)


def log(**more: Any) -> Any:
    """4 m along +x, a left turn of 90°, a right turn of 180°, and two records that wait."""
    records = [
        {"seq": 0, "kind": "pose", "t": 1.5, "x": 0, "y": 0, "heading": 0},
        {"seq": 1, "kind": "pose", "t": 6.5, "x": 4, "y": 0, "heading": 0},
        {"seq": 2, "kind": "pose", "t": 8.5, "x": 4, "y": 0, "heading": 90},
        {"seq": 3, "kind": "pose", "x": 4, "y": 0, "heading": -90},
        {"seq": 4, "kind": "wall", "t": 11, "x": 4.1, "y": 0, "x2": 4.1, "y2": 1},
        {"seq": 5, "kind": "corner", "x": 4.1, "y": 1, "corner": "end"},
    ]
    return {"possmap_log": 1, "robot": "r1", "excursion": "a", "records": records, **more}


def write(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_log_is_described(tmp_path: Path) -> None:
    empty = {**log(robot="r2"), "records": []}
    result = run("check", write(tmp_path / "a.json", log(carried=[empty])))
    # 4 m at 1.25/120 along and 5.5/120 across; 270° at 2° per 45°.
    assert result.stdout == (
        f"{tmp_path / 'a.json'}\n"
        "  r1 a\n"
        "    records   6: 4 pose, 1 wall, 1 corner\n"
        "    track     4.00 m, 2 turns of 270° in all, 9.5 s\n"
        "    ends in   ±0.042 m in x, ±0.183 m in y, ±12.0°\n"
        "    waiting   2 records yield nothing until a pose follows\n"
        "  r2 a, carried by r1 a\n"
        "    records   0\n"
        "    track     0.00 m, 0 turns of 0° in all, no times\n"
        "4 of 4 records on the map used\n"
    )
    assert (result.stderr, result.exit_code) == ("", 0)


def test_json_tells_the_same(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log())
    result = run("check", path, "--json")
    assert json.loads(result.stdout) == {
        "logs": [
            {
                "path": str(path),
                "excursions": [
                    {
                        "robot": "r1",
                        "excursion": "a",
                        "carried_by": None,
                        "kinds": {"pose": 4, "wall": 1, "corner": 1},
                        "distance": 4.0,
                        "turns": 2,
                        "turned_deg": 270.0,
                        "seconds": 9.5,
                        "waiting": 2,
                        "fixes_ignored": 0,
                        "half_x": pytest.approx(4 * 1.25 / 120),
                        "half_y": pytest.approx(4 * 5.5 / 120),
                        "heading_half_deg": pytest.approx(12),
                    }
                ],
                "error": None,
                "note": None,
            }
        ]
    }


@pytest.mark.parametrize(
    ("settings", "half_y"),
    [
        (["--set", "across=0.1"], "0.400"),
        (["--set", "across=0.1", "--set", "robots.r1.across=0.2"], "0.800"),
        (["--set", "robots.r2.across=0.2"], "0.183"),
        (["--config", "CONFIG"], "1.200"),
        (["--config", "CONFIG", "--set", "across=0.1"], "0.400"),
    ],
)
def test_the_settings_decide_how_the_rectangle_grows(
    settings: list[str], half_y: str, tmp_path: Path
) -> None:
    config = write(tmp_path / "site.yaml", "across: 0.3\n")
    path = write(tmp_path / "a.json", log())
    args = [str(config) if arg == "CONFIG" else arg for arg in settings]
    assert f"±{half_y} m in y" in run("check", path, *args).stdout


def test_a_logs_own_model_beats_every_setting(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log(model={"across": 0.01}))
    settings = ("--set", "across=0.1", "--set", "robots.r1.across=0.2")
    assert "±0.040 m in y" in run("check", path, *settings).stdout
    refused = run("check", path, *settings, "--set", "accept_models=false")
    assert "±0.800 m in y" in refused.stdout


def test_one_of_a_thing_is_told_in_the_singular(tmp_path: Path) -> None:
    records = [*log()["records"][:3], log()["records"][4]]
    text = run("check", write(tmp_path / "a.json", log(records=records))).stdout
    assert "1 turn of 90°" in text
    assert "1 record yields nothing until a pose follows" in text


def test_refused_logs_are_told_on_stderr_and_the_others_described(tmp_path: Path) -> None:
    bad = write(tmp_path / "bad.json", log(robot="r 1"))
    good = write(tmp_path / "good.json", log())
    result = run("check", bad, good)
    expected = "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -"
    assert result.stderr == f'possmap: {bad}:1: robot: found "r 1", {expected}\n'
    assert result.stdout.startswith(f"{good}\n  r1 a\n")
    assert result.exit_code == 1


def test_logs_are_judged_against_each_other(tmp_path: Path) -> None:
    first = write(tmp_path / "a.json", log())
    other = log()
    other["records"][1]["x"] = 4.5
    second = write(tmp_path / "b.json", other)
    result = run("check", tmp_path)
    assert result.stderr == (
        f"possmap: {second}:1: excursion a of robot r1 disagrees with the version from "
        f"{first}:1: the records of seq 1 differ; another outing needs another excursion name\n"
    )
    assert result.exit_code == 1


def test_stdin_and_grids_are_checked_too(tmp_path: Path) -> None:
    one = log()
    header = {key: value for key, value in one.items() if key != "records"}
    lines = "".join(json.dumps(line) + "\n" for line in [header, *one["records"]]).encode()
    assert run("check", "-", stdin=lines).stdout.startswith("-\n  r1 a\n    records   6: ")
    grid = tmp_path / "site.possmap"
    run("fuse", write(tmp_path / "a.json", one), "-g", grid)
    assert run("check", grid).stdout.startswith(f"{grid}\n  r1 a\n    records   6: ")


def test_a_line_cut_short_is_refused_unless_asked_for(tmp_path: Path) -> None:
    header = '{"possmap_log": 1, "robot": "r1", "excursion": "a"}\n'
    path = write(tmp_path / "a.jsonl", header + '{"seq": 0, "ki')
    refused = run("check", path)
    assert refused.stderr.startswith(f"possmap: {path}:2: the last line is cut short; ")
    assert (refused.stdout, refused.exit_code) == ("", 1)
    used = run("check", path, "--allow-truncated", "--json")
    (one,) = json.loads(used.stdout)["logs"]
    assert one["note"] == f"{path}:2: the last line is cut short and was left out"
    assert used.stderr == f"possmap: {one['note']}\n"
    assert (one["excursions"][0]["kinds"], used.exit_code) == ({}, 0)


def test_checking_changes_nothing(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log())
    run("check", path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_record_beyond_the_limit_of_cells_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log())
    result = run("check", path, "--set", "limit_record_cells=50")
    assert result.stderr.startswith(f"possmap: {path}:1: seq 1 of excursion a of robot r1 takes ")
    assert result.stderr.endswith("expected at most 50 (setting limit_record_cells)\n")
    assert result.exit_code == 1


def test_cells_too_small_to_count_are_refused_in_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log())
    result = CliRunner().invoke(main, ["check", str(path), "--resolution", "1e-6"])
    assert result.stderr.startswith("possmap: ") and result.stderr.count("\n") == 1
    assert "expected" in result.stderr and result.exit_code == 1
    result = CliRunner().invoke(main, ["check", str(path), "--resolution", "1e-300"])
    assert 'found "1e-300", expected a number >= 1e-6' in result.stderr and result.exit_code == 2


def test_the_schema_is_printed_without_a_log() -> None:
    result = run("check", "--schema")
    schema = json.loads(result.stdout)
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert (result.stderr, result.exit_code) == ("", 0)


@pytest.mark.parametrize("args", [[], ["no.json"], ["--set", "across=x", "."]])
def test_wrong_usage_ends_with_2(args: list[str]) -> None:
    result = run("check", *args)
    assert (result.stdout, result.exit_code) == ("", 2)
