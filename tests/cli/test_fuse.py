"""``possmap fuse``, as a user sees it (CLI.md): statuses, exit codes, and the grid afterwards."""

from __future__ import annotations

import gzip
import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from teams import digest

import possmap
from possmap.cli.main import main

EXACT = {"along": 0, "across": 0, "turn_spread": 0}  # a robot that makes no errors


def run(*args: object, stdin: bytes | None = None) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], input=stdin, catch_exceptions=False)


def log(robot: str = "r1", excursion: str = "a", wall_x: float = 0.33, **more: Any) -> Any:
    """One step of 0.2 m along +x, then a bump at (``wall_x``, 0.01)."""
    records = [
        {"seq": 0, "kind": "pose", "x": 0.01, "y": 0.01, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 0.21, "y": 0.01, "heading": 0},
        {"seq": 2, "kind": "wall", "x": wall_x, "y": 0.01, "x2": wall_x, "y2": 0.01},
        {"seq": 3, "kind": "pose", "x": 0.21, "y": 0.01, "heading": 0},
    ]
    whole = {"possmap_log": 1, "robot": robot, "excursion": excursion, "model": EXACT}
    return {**whole, "records": records, **more}


def write(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def lines_of(one: Any) -> bytes:
    header = {key: value for key, value in one.items() if key != "records"}
    return "".join(json.dumps(line) + "\n" for line in [header, *one["records"]]).encode()


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return tmp_path / "site.possmap"


def test_a_first_log_makes_the_grid(tmp_path: Path, grid: Path) -> None:
    result = run("fuse", write(tmp_path / "a.json", log()), "-g", grid)
    assert result.stdout == (
        f"{grid}: fused 1 log (4 new records), 0 known, 0 refused\n"
        "4 of 4 records on the map used; 0.0% of 6 cells contested\n"
    )
    assert (result.stderr, result.exit_code) == ("", 0)
    with possmap.open_grid(grid) as opened:
        walls = "".join("#" if n > 0.999 else "?" if n == 0 else "!" for n in opened.necessity()[0])
        free = "".join("?" if p == 1 else "." if p == 0 else "!" for p in opened.possibility()[0])
        assert opened.origin() == (0.0, 0.0)
    assert (walls, free) == ("??????#", ".....??")


def test_json_has_the_promised_shape(tmp_path: Path, grid: Path) -> None:
    path = write(tmp_path / "a.json", log(carried=[log("r2"), log("r2")]))
    result = run("fuse", path, "-g", grid, "--json")
    found = json.loads(result.stdout)
    seconds = found.pop("seconds")
    assert isinstance(seconds, float) and 0 <= seconds < 60
    one = {"path": str(path), "status": "fused", "records_new": 8, "records_known": 0}
    assert found == {
        "grid": str(grid),
        "logs": [{**one, "error": None}],
        "records_new": 8,
        "records_known": 0,
    }
    assert (result.stderr, result.exit_code) == ("", 0)


def test_what_is_known_already_is_told_and_leaves_the_file_alone(
    tmp_path: Path, grid: Path
) -> None:
    path = write(tmp_path / "a.json", log())
    run("fuse", path, "-g", grid)
    before = grid.read_bytes()
    result = run("fuse", path, "-g", grid)
    assert result.stdout == f"{grid}: fused 0 logs (0 new records), 1 known, 0 refused\n"
    assert (result.stderr, result.exit_code) == ("", 0)
    assert grid.read_bytes() == before
    again = json.loads(run("fuse", path, "-g", grid, "--json").stdout)
    assert again["logs"][0]["status"] == "known"
    assert (again["records_new"], again["records_known"]) == (0, 4)


def test_a_refused_log_changes_nothing_and_the_others_are_fused(tmp_path: Path, grid: Path) -> None:
    good, alone = write(tmp_path / "a.json", log()), tmp_path / "alone.possmap"
    bad = write(tmp_path / "b.json", '{"possmap_log": 1,\n "robot": 7}')
    result = run("fuse", bad, good, "-g", grid)
    assert result.exit_code == 1
    assert result.stdout == (
        f"{grid}: fused 1 log (4 new records), 0 known, 1 refused\n"
        "4 of 4 records on the map used; 0.0% of 6 cells contested\n"
    )
    assert result.stderr.startswith(f"possmap: {bad}:") and result.stderr.count("\n") == 1
    run("fuse", good, "-g", alone)
    assert digest(grid) == digest(alone)


def test_with_json_a_refused_log_has_its_error_and_stdout_nothing_else(
    tmp_path: Path, grid: Path
) -> None:
    bad = write(tmp_path / "b.json", "[]")
    result = run("fuse", bad, "-g", grid, "--json")
    (one,) = json.loads(result.stdout)["logs"]
    assert one["status"] == "refused" and one["error"].startswith(f"{bad}:1: ")
    assert result.stderr == f"possmap: {one['error']}\n"
    assert result.exit_code == 1
    assert not grid.exists(), "no grid is made for nothing"


def test_a_dry_run_tells_and_makes_no_file(tmp_path: Path, grid: Path) -> None:
    path = write(tmp_path / "a.json", log())
    result = run("fuse", path, "-g", grid, "--dry-run")
    assert result.stdout == (
        f"{grid}: would fuse 1 log (4 new records), 0 known, 0 refused\n"
        "4 of 4 records on the map used\n"
    )
    assert result.exit_code == 0
    assert list(tmp_path.iterdir()) == [path]


def test_a_dry_run_leaves_a_grid_alone_and_still_refuses(tmp_path: Path, grid: Path) -> None:
    run("fuse", write(tmp_path / "a.json", log()), "-g", grid)
    before = grid.read_bytes()
    more = write(tmp_path / "b.json", log("r2"))
    conflict = write(tmp_path / "c.json", log(wall_x=0.4))
    result = run("fuse", more, conflict, "-g", grid, "--dry-run", "--json")
    assert [one["status"] for one in json.loads(result.stdout)["logs"]] == ["fused", "refused"]
    assert result.exit_code == 1
    assert grid.read_bytes() == before


def test_strict_keeps_nothing_of_the_batch(tmp_path: Path, grid: Path) -> None:
    good, bad = write(tmp_path / "a.json", log()), write(tmp_path / "b.json", "{}")
    later = write(tmp_path / "c.json", log("r3"))
    result = run("fuse", good, bad, later, "-g", grid, "--strict", "--json")
    summary = json.loads(result.stdout)
    assert (result.exit_code, summary["records_new"]) == (1, 0)
    assert "fused" not in {one["status"] for one in summary["logs"]}
    assert not grid.exists()


def test_strict_leaves_a_known_grid_byte_for_byte(tmp_path: Path, grid: Path) -> None:
    run("fuse", write(tmp_path / "a.json", log()), "-g", grid)
    before = grid.read_bytes()
    good, bad = write(tmp_path / "b.json", log("r2")), write(tmp_path / "c.json", "{}")
    robots = ("--set", "robots.r9.turn_spread=1")
    assert run("fuse", good, bad, "-g", grid, "--strict", *robots).exit_code == 1
    assert grid.read_bytes() == before, "not even the entries of robots"


def test_strict_says_of_each_log_by_name_that_it_was_not_kept(tmp_path: Path, grid: Path) -> None:
    good, bad = write(tmp_path / "a.json", log()), write(tmp_path / "b.json", "{}")
    first, second = run("fuse", good, bad, "-g", grid, "--strict").stderr.splitlines()
    assert first.startswith(f"possmap: {good}: ")
    assert second.startswith(f"possmap: {bad}:")


def test_a_dash_reads_json_lines_from_stdin_plain_or_compressed(tmp_path: Path) -> None:
    plain, compressed, named = (tmp_path / f"{n}.possmap" for n in "abc")
    result = run("fuse", "-", "-g", plain, "--json", stdin=lines_of(log()))
    assert json.loads(result.stdout)["logs"][0]["path"] == "-"
    assert result.exit_code == 0
    run("fuse", "-", "-g", compressed, stdin=gzip.compress(lines_of(log())))
    run("fuse", write(tmp_path / "a.json", log()), "-g", named)
    assert digest(plain) == digest(compressed) == digest(named)


def test_stdin_is_named_in_messages(grid: Path) -> None:
    result = run("fuse", "-", "-g", grid, stdin=lines_of(log()) + b'{"seq": 1}\n')
    assert result.stderr.startswith("possmap: stdin:6: kind is missing")
    assert result.exit_code == 1


def test_a_line_cut_short_is_refused_unless_asked_for(tmp_path: Path, grid: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_bytes(lines_of(log())[:-9])
    refused = run("fuse", path, "-g", grid)
    advice = "--allow-truncated uses the whole lines before it"
    assert refused.stderr == f"possmap: {path}:5: the last line is cut short; {advice}\n"
    assert refused.exit_code == 1
    used = run("fuse", path, "-g", grid, "--allow-truncated")
    assert used.stdout == (
        f"{grid}: fused 1 log (3 new records), 0 known, 0 refused\n"
        "2 of 2 records on the map used; 0.0% of 5 cells contested\n"
    )
    assert used.stderr == f"possmap: {path}:5: the last line is cut short and was left out\n"
    assert used.exit_code == 0


def test_a_folder_stands_for_its_logs_by_name(tmp_path: Path, grid: Path) -> None:
    folder = tmp_path / "logs"
    (folder / "deeper.json").mkdir(parents=True)
    second = write(folder / "b.json", log(wall_x=0.4))  # disagrees with a, which comes first
    first = write(folder / "a.json", log())
    third = folder / "c.JSONL.gz"
    third.write_bytes(gzip.compress(lines_of(log("r3"))))
    write(folder / "notes.txt", "no log")
    result = run("fuse", folder, "-g", grid, "--json")
    found = [(one["path"], one["status"]) for one in json.loads(result.stdout)["logs"]]
    assert found == [(str(first), "fused"), (str(second), "refused"), (str(third), "fused")]
    assert result.exit_code == 1
    (message,) = result.stderr.splitlines()
    assert f"{first}:1" in message and str(second) in message, "both sources are named"
    assert "another outing needs another excursion name" in message


def test_an_empty_folder_is_refused(tmp_path: Path, grid: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    result = run("fuse", folder, "-g", grid)
    expected = "the folder holds no logs, expected files of .json, .jsonl, .ndjson, .csv"
    assert result.stderr == f"possmap: {folder}: {expected}\n"
    assert result.exit_code == 1 and not grid.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are text")
def test_a_log_whose_name_is_no_text_is_kept_with_its_bytes_spelt_out(
    tmp_path: Path, grid: Path
) -> None:
    odd = write(tmp_path / os.fsdecode(b"bad\xff.json"), log())
    assert run("fuse", odd, "-g", grid).exit_code == 0
    (excursion,) = json.loads(run("info", grid, "--json").stdout)["excursions"]
    assert excursion["parts"][0]["source"].endswith(r"bad\udcff.json")
    assert run("verify", grid).exit_code == 0


def test_another_grid_as_log_gives_its_evidence(tmp_path: Path, grid: Path) -> None:
    path = write(tmp_path / "a.json", log(carried=[log("r2", "x", 0.4)]))
    other, back = tmp_path / "other.possmap", tmp_path / "back.possmap"
    run("fuse", path, "-g", other)
    before = other.read_bytes()
    result = run("fuse", other, "-g", grid)
    assert result.stdout == (
        f"{grid}: fused 1 log (8 new records), 0 known, 0 refused\n"
        "8 of 8 records on the map used; 0.0% of 7 cells contested\n"
    )
    assert (digest(grid), other.read_bytes()) == (digest(other), before)
    known = run("fuse", path, "-g", grid)
    assert known.stdout == f"{grid}: fused 0 logs (0 new records), 1 known, 0 refused\n"
    run("fuse", grid, "-g", back)
    excursions = [json.loads(run("info", g, "--json").stdout)["excursions"] for g in (other, back)]
    for one in [one for all_of in excursions for one in all_of]:
        for part in one["parts"]:
            part.pop("fused_at")
    assert excursions[0] == excursions[1], "who carried it, and the first file's name, come along"


def test_a_grid_fused_into_itself_is_known(tmp_path: Path, grid: Path) -> None:
    run("fuse", write(tmp_path / "a.json", log()), "-g", grid)
    result = run("fuse", grid, "-g", grid)
    assert result.stdout == f"{grid}: fused 0 logs (0 new records), 1 known, 0 refused\n"
    assert result.exit_code == 0


def test_quiet_says_only_what_is_wrong(tmp_path: Path, grid: Path) -> None:
    good, bad = write(tmp_path / "a.json", log()), write(tmp_path / "b.json", "[]")
    result = run("-q", "fuse", good, bad, "-g", grid)
    assert (result.stdout, result.exit_code) == ("", 1)
    assert result.stderr.startswith(f"possmap: {bad}:1: ")
    assert grid.exists()


def test_the_grids_folder_must_exist(tmp_path: Path) -> None:
    path, nowhere = write(tmp_path / "a.json", log()), tmp_path / "no" / "site.possmap"
    result = run("fuse", path, "-g", nowhere)
    expected = f"possmap: {nowhere}: the folder {nowhere.parent} does not exist\n"
    assert (result.stderr, result.stdout, result.exit_code) == (expected, "", 1)


def test_a_name_too_long_for_a_file_is_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.json", log())
    result = CliRunner().invoke(main, ["fuse", str(path), "-g", str(tmp_path / ("a" * 300))])
    assert result.stderr.startswith("possmap: ") and result.stderr.count("\n") == 1
    assert result.exit_code == 1


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (["LOG"], "Missing option '-g' / '--grid'"),
        (["-g", "GRID"], "Missing argument 'LOG...'"),
        (["no.json", "-g", "GRID"], "Invalid value for 'LOG...': Path 'no.json' does not exist"),
        (["LOG", "-g", "FOLDER"], "is a directory"),
        (["LOG", "-g", "GRID", "--jobs", "0"], "0 is not in the range x>=1"),
        (["LOG", "-g", "GRID", "--set", "resolution"], "'resolution', expected KEY=VALUE"),
        (["LOG", "-g", "GRID", "--nope"], "No such option"),
    ],
)
def test_wrong_usage_ends_with_2(
    args: list[str], complaint: str, tmp_path: Path, grid: Path
) -> None:
    path = write(tmp_path / "a.json", log())
    known = {"LOG": path, "GRID": grid, "FOLDER": tmp_path}
    result = run("fuse", *(known.get(arg, arg) for arg in args))
    assert complaint in result.stderr.splitlines()[-1]
    assert (result.stdout, result.exit_code) == ("", 2)
    assert list(tmp_path.iterdir()) == [path]
