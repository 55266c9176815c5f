"""Every format that was ever written stays readable; an older one is upgraded in one go."""

from __future__ import annotations

import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from teams import digest, fuse, write_logs
from versions import log_of

import possmap
from possmap.cli.main import main
from possmap.errors import GridError
from possmap.grid.database import FORMAT_VERSION
from possmap.grid.grid import Grid

FIXTURES = Path(__file__).parent / "fixtures"
DATA = Path(__file__).parents[2] / "data"
DIGESTS = {
    1: "8d88848c56586c4d23319b2293d6c5251838ea4cbe2cc00b6bdff674b013c6fc",
    2: "277ad06f1da2fce2dc85b351b1d040129914d1ddd311b0d94dc7b3a28619b42c",
}


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def copy_of(number: int, folder: Path) -> Path:
    return Path(shutil.copy(FIXTURES / f"format-{number}.possmap", folder / f"{number}.possmap"))


def ask(grid: Path, sql: str) -> list[tuple[object, ...]]:
    connection = sqlite3.connect(grid)
    found = connection.execute(sql).fetchall()
    connection.close()
    return found


def format_of(grid: Path) -> int:
    ((number,),) = ask(grid, "PRAGMA user_version")
    assert isinstance(number, int)
    return number


def test_there_is_a_file_of_every_format() -> None:
    assert list(DIGESTS) == list(range(1, FORMAT_VERSION + 1))
    for number in DIGESTS:
        assert format_of(FIXTURES / f"format-{number}.possmap") == number


@pytest.mark.parametrize("number", DIGESTS)
def test_a_file_of_any_format_is_read_and_not_changed(number: int, tmp_path: Path) -> None:
    grid = copy_of(number, tmp_path)
    before = grid.read_bytes()
    assert digest(grid) == DIGESTS[number]
    info = run("info", grid)
    assert f"digest      {DIGESTS[number]}\n" in info.stdout
    assert ("forgotten   robot r3, 2026-" in info.stdout) == (number > 1)
    assert run("info", grid, "--json").exit_code == 0
    assert "r2 b seq 19 (wall): wall 0.7910" in run("query", grid, 2.0, -2.4).stdout
    assert run("render", grid, "-o", tmp_path / "map.png").exit_code == 0
    assert run("export", grid, "-o", tmp_path / "map.npz").exit_code == 0
    assert run("fuse", grid, "-g", tmp_path / "new.possmap").exit_code == 0
    assert digest(tmp_path / "new.possmap") == DIGESTS[number]
    # What it knows to have come, byte by byte, brings nothing that is worth a note.
    assert run("fuse", DATA / "json/01-r2-a.json", "-g", grid).exit_code == 0
    with Grid(grid) as opened:
        faults = [*opened.soundness.structure(), *opened.soundness.tiles()]
        for identity in opened.ledger.identities():
            faults += opened.soundness.excursion(identity)
    assert faults == []
    assert grid.read_bytes() == before


def test_a_file_becomes_one_of_the_newest_format_when_something_is_written(tmp_path: Path) -> None:
    grid, new = copy_of(1, tmp_path), tmp_path / "new.possmap"
    logs = write_logs(tmp_path / "more", [log_of("r9")])
    fuse([*logs], grid, {})
    assert format_of(grid) == FORMAT_VERSION
    fuse([*sorted((DATA / "json").iterdir()), *logs], new, {})
    assert digest(grid) == digest(new)
    schema = "SELECT type, name, tbl_name, sql FROM sqlite_schema ORDER BY name"
    assert ask(grid, schema) == ask(new, schema)
    assert run("verify", grid, "--full").exit_code == 0


def test_an_upgrade_changes_no_digest(tmp_path: Path) -> None:
    grid = copy_of(1, tmp_path)
    # Known records from another file: all that is written is that it held them too.
    fuse([DATA / "jsonl/team.jsonl"], grid, {})
    assert (format_of(grid), digest(grid)) == (FORMAT_VERSION, DIGESTS[1])
    again = ask(grid, "SELECT count FROM again ORDER BY excursion")
    assert again == [(79,), (62,), (104,), (64,), (88,)]


def test_evidence_can_be_taken_out_of_an_old_file(tmp_path: Path) -> None:
    grid, new = copy_of(1, tmp_path), tmp_path / "new.possmap"
    assert run("forget", grid, "--brought-by", "04-r1-b.json").exit_code == 0
    fuse(sorted((DATA / "json").iterdir())[:3], new, {})
    assert (format_of(grid), digest(grid)) == (FORMAT_VERSION, digest(new))


def test_logs_fused_again_make_up_for_what_an_old_file_did_not_note(tmp_path: Path) -> None:
    grid, part = copy_of(1, tmp_path), tmp_path / "part.possmap"
    # The second log held all of r2's first excursion too, but brought nothing new of it.
    fuse([DATA / "json/02-r1-a.json"], grid, {})
    assert run("forget", grid, "--brought-by", "01-r2-a.json").exit_code == 0
    fuse(sorted((DATA / "json").iterdir())[1:], part, {})
    assert digest(grid) == digest(part)


def test_what_is_not_known_to_an_old_file_does_not_upgrade_it(tmp_path: Path) -> None:
    grid = copy_of(1, tmp_path)
    before = grid.read_bytes()
    for options in (("--robot", "r9"), ("--brought-by", "x.json"), ("--robot", "r3", "--recall")):
        assert run("forget", grid, *options).exit_code == 1
    assert grid.read_bytes() == before


KILLED = """
import os, signal, sys
from possmap.grid.grid import Grid
grid = Grid(sys.argv[1], write=True)
with grid.transaction():
    grid._database.execute("PRAGMA cache_size = 1")  # so that pages reach the file before COMMIT
    grid.upgrade()
    grid._database.execute("UPDATE cells SET data = randomblob(200000)")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_in_the_middle_of_an_upgrade_leaves_the_old_format(tmp_path: Path) -> None:
    grid = copy_of(1, tmp_path)
    before = grid.read_bytes()
    done = subprocess.run([sys.executable, "-c", KILLED, str(grid)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert grid.read_bytes() != before, "the file is half-written"
    assert digest(grid) == DIGESTS[1]
    assert (format_of(grid), grid.read_bytes()) == (1, before)


def test_a_writer_that_waited_notices_that_the_format_is_newer_now(tmp_path: Path) -> None:
    grid = copy_of(1, tmp_path)
    with Grid(grid, write=True) as writer, possmap.open_grid(grid) as reader:
        ask(grid, f"PRAGMA user_version = {FORMAT_VERSION + 1}")
        for access in (writer.transaction, reader.snapshot):
            with pytest.raises(GridError, match="is newer than this program reads"), access():
                pass
    assert format_of(grid) == FORMAT_VERSION + 1
