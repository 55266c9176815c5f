"""A grid file that is none, or no longer whole: one clear line, and not a byte changed."""

from __future__ import annotations

import json
import random
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner
from teams import digest, flat_settings, write_logs

import possmap
from possmap.cli.main import main
from possmap.grid import database


class Outcome(NamedTuple):
    """What a user sees of a command, and no exception that would keep a file open."""

    exit_code: int
    stdout: str
    stderr: str
    stray: str


def run(*args: object) -> Outcome:
    result = CliRunner().invoke(main, [str(arg) for arg in args])
    error = result.exception
    stray = "" if error is None or isinstance(error, SystemExit) else repr(error)
    return Outcome(result.exit_code, result.stdout, result.stderr, stray)


def bump(robot: str = "r1", x: float = 0.5, **more: Any) -> Any:
    """Return a log of a bump at (``x``, 0.2), seen from the origin."""
    pose = {"kind": "pose", "x": 0, "y": 0, "heading": 0, "error_x": 0.2, "error_y": 0.1}
    wall = {"seq": 1, "kind": "wall", "x": x, "y": 0.2, "x2": x, "y2": 0.2}
    records = [{"seq": 0, **pose}, wall, {"seq": 2, **pose}]
    return {"possmap_log": 1, "robot": robot, "excursion": "a", "records": records, **more}


@pytest.fixture(autouse=True)
def writers_do_not_wait_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "WAIT_S", 0.1)


def fused(folder: Path, *logs: Any, name: str = "site", **settings: Any) -> Path:
    grid = folder / f"{name}.possmap"
    summary = possmap.fuse(write_logs(folder / name, logs), grid, flat_settings(settings))
    assert summary.count("refused") == 0, [log.error for log in summary.logs]
    return grid


def on_all(grid: Path, folder: Path) -> dict[str, Outcome]:
    """Run every command on a grid: those that read it, and fuse with it as log and as target."""
    (log,) = write_logs(folder / "more", [bump("new")])
    out, new = folder / "out.npz", folder / "new.possmap"
    return {
        "info": run("info", grid),
        "query": run("query", grid, 0.5, 0.2),
        "export": run("export", grid, "-o", out, "--overwrite"),
        "config": run("config", "-g", grid),
        "fuse it": run("fuse", grid, "-g", new),
        "fuse into it": run("fuse", log, "-g", grid),
    }


def assert_refused_in_one_line(result: Outcome, grid: Path) -> None:
    assert not result.stray
    assert result.exit_code == 1
    assert result.stderr.startswith(f"possmap: {grid}: ") and result.stderr.count("\n") == 1
    assert result.stderr[:-1].isprintable()


def other_database(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE phone (number TEXT)")
    connection.close()


NOT_GRIDS: dict[str, Callable[[Path], object]] = {
    "text": lambda path: path.write_text("robot,excursion\n" * 99),
    "random bytes": lambda path: path.write_bytes(random.Random(1).randbytes(5000)),
    "SQLite's name and no more": lambda path: path.write_bytes(b"SQLite format 3\0"),
    "random bytes after SQLite's name": lambda path: path.write_bytes(
        b"SQLite format 3\0" + random.Random(2).randbytes(5000)
    ),
    "another database": other_database,
}


@pytest.mark.parametrize("kind", NOT_GRIDS)
def test_what_is_no_grid_is_refused_and_left_alone(kind: str, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    NOT_GRIDS[kind](grid)
    before = grid.read_bytes()
    for result in on_all(grid, tmp_path).values():
        assert_refused_in_one_line(result, grid)
    assert grid.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["more", "site.possmap"]


def test_an_empty_file_is_no_grid_to_read_but_one_may_be_made_of_it(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    grid.touch()
    results = on_all(grid, tmp_path)
    assert results.pop("fuse into it").exit_code == 0, "what a run stopped early left behind"
    for result in results.values():
        assert_refused_in_one_line(result, grid)
    assert digest(grid) == digest(fused(tmp_path, bump("new"), name="fresh"))


def test_a_grid_cut_short_anywhere_is_refused_and_left_alone(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    whole = grid.read_bytes()
    for length in [*range(1, len(whole), 997), 15, 16, 99, 100, 4096, len(whole) - 1]:
        grid.write_bytes(whole[:length])
        for result in on_all(grid, tmp_path).values():
            assert_refused_in_one_line(result, grid)
        assert grid.read_bytes() == whole[:length]


def test_a_format_that_was_never_released_is_refused_by_number(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    change(grid, "PRAGMA user_version = 3")
    for result in on_all(grid, tmp_path).values():
        problem = "format 3 was never released, expected 4; fuse its logs into a new grid"
        assert (result.stderr, result.exit_code) == (f"possmap: {grid}: {problem}\n", 1)


def test_a_newer_format_is_refused_by_number(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    change(grid, "PRAGMA user_version = 5")
    before = grid.read_bytes()
    for result in on_all(grid, tmp_path).values():
        problem = "format 5 is newer than this program reads (4); install a newer possmap"
        assert (result.stderr, result.exit_code) == (f"possmap: {grid}: {problem}\n", 1)
    assert grid.read_bytes() == before


def change(grid: Path, sql: str, *values: object) -> None:
    with sqlite3.connect(grid) as connection:
        connection.execute(sql, values)
    connection.close()


BLOBS: dict[str, Callable[[bytes], object]] = {
    "nothing": lambda data: b"",
    "no cells": lambda data: data[:1],
    "an odd width": lambda data: b"\x03" + data[1:],
    "another width": lambda data: b"\x08" + data[1:],
    "cut short": lambda data: data[:-9],
    "without its checksum": lambda data: data[:-4],
    "with something behind it": lambda data: data + b"\0",
    "twice": lambda data: data + data[1:],
    "a bit flipped": lambda data: data[:9] + bytes([data[9] ^ 64]) + data[10:],
}


@pytest.mark.parametrize("kind", BLOBS)
def test_a_damaged_tile_is_refused_where_it_is_read(kind: str, tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    with sqlite3.connect(grid) as connection:
        (data,) = connection.execute("SELECT data FROM cells").fetchone()
        connection.execute("UPDATE cells SET data = ?", (BLOBS[kind](data),))
    connection.close()
    assert_only_readers_of_tiles_refuse(grid, tmp_path)
    verified = run("verify", grid)
    assert (verified.exit_code, verified.stray) == (1, "")
    assert f"possmap: {grid}: tile 0, 0, " in verified.stderr


def test_a_tile_whose_cells_are_gone_is_damaged_not_ignorance(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    change(grid, "DELETE FROM cells")
    assert_only_readers_of_tiles_refuse(grid, tmp_path)


def assert_only_readers_of_tiles_refuse(grid: Path, folder: Path) -> None:
    before = grid.read_bytes()
    results = on_all(grid, folder)
    assert results.pop("config").exit_code == 0, "it reads no cell"
    assert results.pop("fuse it").exit_code == 0, "its ledger is whole, and that is what is fused"
    for result in results.values():
        assert_refused_in_one_line(result, grid)
        assert "damaged: tile 0, 0: " in result.stderr
    assert grid.read_bytes() == before


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE excursion SET model = '{'",
        "UPDATE excursion SET model = '{\"acroRs\": 1}'",
        "UPDATE excursion SET model = '[]'",
        "UPDATE excursion SET model = '{\"scale\": -1}'",
        "UPDATE excursion SET own_model = '{'",
        "UPDATE record SET kind = 'pole'",
        "DELETE FROM setting WHERE name = 'drift'",
        "DELETE FROM setting WHERE name = 'resolution'",
        "UPDATE setting SET value = '{' WHERE name = 'drift'",
        "UPDATE setting SET value = '\"x\"' WHERE name = 'resolution'",
        "UPDATE setting SET value = '0' WHERE name = 'resolution'",
        "UPDATE setting SET value = '-1' WHERE name = 'scale'",
        "INSERT INTO setting VALUES ('robots.new.nope', '1')",
        "DROP TABLE arrival",
        "ALTER TABLE record RENAME COLUMN heading TO bearing",
    ],
)
def test_a_damaged_ledger_never_ends_in_a_traceback(sql: str, tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    change(grid, sql)
    before = grid.read_bytes()
    results = on_all(grid, tmp_path)
    unchanged = grid.read_bytes() == before
    refused = [name for name, result in results.items() if result.exit_code or result.stray]
    assert refused, "somebody notices"
    for name in refused:
        assert_refused_in_one_line(results[name], grid)
    assert unchanged or "fuse into it" not in refused


def test_a_reader_that_was_refused_holds_no_lock(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    change(grid, "UPDATE record SET kind = 'pole'")
    with pytest.raises(Exception, match="pole") as kept, possmap.open_grid(grid) as opened:
        opened.ledger.version(next(opened.ledger.entries()))
    connection = sqlite3.connect(grid, timeout=0.05, isolation_level=None)
    connection.execute("BEGIN EXCLUSIVE")
    connection.close()
    assert kept.tb is not None, "the error, with all that it refers to, still lives"


def test_single_bytes_that_changed_never_end_in_a_traceback(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump(), bump("r2", x=-7.0))
    whole = grid.read_bytes()
    rng = random.Random(3)
    stray: dict[str, str] = {}
    for _ in range(60):
        damaged = bytearray(whole)
        for _ in range(rng.choice([1, 8, 64])):
            damaged[rng.randrange(len(whole))] = rng.randrange(256)
        grid.write_bytes(damaged)
        for name, result in on_all(grid, tmp_path).items():
            if result.stray or len(result.stderr.splitlines()) > 1:
                stray[result.stray or result.stderr] = name
        (tmp_path / "new.possmap").unlink(missing_ok=True)
    assert not stray


KILLED = """
import os, signal, sys
from possmap.grid.grid import Grid
grid = Grid(sys.argv[1], write=True)
with grid.transaction():
    grid._database.execute("PRAGMA cache_size = 1")  # so that pages reach the file before COMMIT
    grid._database.execute("UPDATE record SET x = x + 1")
    grid._database.execute("UPDATE cells SET data = randomblob(200000)")
    grid._database.execute("DELETE FROM tile")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_while_writing(grid: Path) -> Path:
    """Kill a writer in the middle of a transaction, and return the journal that it leaves."""
    before = grid.read_bytes()
    done = subprocess.run([sys.executable, "-c", KILLED, str(grid)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert grid.read_bytes() != before, "the file is half-written"
    return grid.with_name(grid.name + "-journal")


@pytest.mark.parametrize("command", ["info", "query", "export", "config", "fuse it"])
def test_a_reader_rolls_back_what_a_killed_writer_left(command: str, tmp_path: Path) -> None:
    grid = fused(tmp_path, bump(), bump("r2"))
    before, known = grid.read_bytes(), digest(grid)
    journal = killed_while_writing(grid)
    assert journal.stat().st_size > 0
    args = {
        "info": ["info", grid],
        "query": ["query", grid, 0.5, 0.2],
        "export": ["export", grid, "-o", tmp_path / "out.npz"],
        "config": ["config", "-g", grid],
        "fuse it": ["fuse", grid, "-g", tmp_path / "new.possmap"],
    }
    result = run(*args[command])
    assert (result.stderr, result.exit_code) == ("", 0)
    assert not journal.exists()
    assert (grid.read_bytes(), digest(grid)) == (before, known)


def test_a_writer_goes_on_after_a_killed_one(tmp_path: Path) -> None:
    grid = fused(tmp_path, bump())
    killed_while_writing(grid)
    result = run("fuse", *write_logs(tmp_path / "more", [bump(), bump("r2")]), "-g", grid, "--json")
    assert [one["status"] for one in json.loads(result.stdout)["logs"]] == ["known", "fused"]
    assert digest(grid) == digest(fused(tmp_path, bump(), bump("r2"), name="whole"))
