"""What possmap asks of SQLite and of the disk, and files as an interrupted run may leave them."""

from __future__ import annotations

import re
import shutil
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from literal.teams import random_excursion
from teams import digest, write_logs

import possmap
from possmap.errors import GridError
from possmap.fusing.repair import repair
from possmap.grid import database, opening
from possmap.grid.database import Database
from possmap.grid.opening import check_file, journal_of

PACKAGE = Path(possmap.__file__).parent


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    """Write a few logs."""
    rng = np.random.default_rng(4)
    made = [{"possmap_log": 1, **random_excursion(rng, f"r{n}", "a")} for n in range(3)]
    return write_logs(tmp_path / "logs", made)


@pytest.fixture
def in_force(monkeypatch: pytest.MonkeyPatch) -> set[tuple[object, object]]:
    """Collect ``synchronous`` and ``journal_mode`` as they are whenever something is committed."""
    found: set[tuple[object, object]] = set()
    execute = Database.execute

    def watched(self: Database, sql: str, *values: object) -> int:
        if sql == "COMMIT":
            modes = self.one("PRAGMA synchronous"), self.one("PRAGMA journal_mode")
            found.add((modes[0] and modes[0][0], modes[1] and modes[1][0]))
        return execute(self, sql, *values)  # type: ignore[arg-type]

    monkeypatch.setattr(Database, "execute", watched)
    return found


EXTRA_AND_DELETE = {(3, "delete")}


def test_every_commit_is_synced_with_its_journal_and_their_folder(
    logs: list[Path], tmp_path: Path, in_force: set[tuple[object, object]]
) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(logs[:2], grid)
    assert in_force == EXTRA_AND_DELETE
    in_force.clear()
    possmap.fuse(logs[2:], grid)
    assert in_force == EXTRA_AND_DELETE
    in_force.clear()
    repair(grid, tmp_path / "repaired.possmap")
    assert in_force == EXTRA_AND_DELETE


def test_only_one_module_opens_grids() -> None:
    opening = re.compile(r"sqlite3\.connect\((?!\":memory:\")")
    modules = {path for path in PACKAGE.rglob("*.py") if opening.search(path.read_text())}
    recordings = PACKAGE / "lab/recordings"  # those are somebody else's
    assert {path for path in modules if recordings not in path.parents} == {Path(database.__file__)}


def test_a_grid_that_somebody_set_to_another_journal_is_set_back_by_the_next_fuse(
    logs: list[Path], tmp_path: Path, in_force: set[tuple[object, object]]
) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(logs[:2], grid)
    with closing(sqlite3.connect(grid)) as connection:
        assert connection.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
    in_force.clear()
    possmap.fuse(logs[2:], grid)
    assert in_force == EXTRA_AND_DELETE
    assert sorted(path.name for path in tmp_path.glob("site.possmap*")) == ["site.possmap"]


def test_a_first_run_killed_before_its_journal_was_synced_is_taken_over(
    logs: list[Path], tmp_path: Path
) -> None:
    undisturbed, grid = tmp_path / "undisturbed.possmap", tmp_path / "site.possmap"
    possmap.fuse(logs, undisturbed)
    grid.touch()
    journal_of(grid).write_bytes(bytes(512))  # SQLite rolls back no journal without a head
    assert possmap.fuse(logs, grid).count("fused") == len(logs)
    assert digest(grid) == digest(undisturbed)
    assert not journal_of(grid).exists()


@pytest.mark.parametrize("size", [0, 4096])
def test_a_reader_that_looks_while_another_commits_is_not_told_that_the_file_is_cut_short(
    size: int, logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(logs, grid)
    whole = grid.read_bytes()
    grid.write_bytes(whole[:size])  # the first pages are written, the others follow

    def commit_ends_before(look: Callable[[Path], Path]) -> Callable[[Path], Path]:
        def looked(path: Path) -> Path:
            grid.write_bytes(whole)
            return look(path)

        return looked

    monkeypatch.setattr(opening, "journal_of", commit_ends_before(journal_of))
    if size:
        assert check_file(grid, write=False)
    else:
        with pytest.raises(GridError, match="run it again"):
            check_file(grid, write=False)


def test_a_reader_whose_writer_was_killed_meanwhile_is_told_to_open_the_grid_again(
    logs: list[Path], tmp_path: Path
) -> None:
    grid, other = tmp_path / "site.possmap", tmp_path / "other.possmap"
    possmap.fuse(logs, grid)
    shutil.copy(grid, other)
    expected = digest(grid)
    with closing(sqlite3.connect(other, isolation_level=None)) as writer:
        writer.execute("PRAGMA cache_size = 1")  # so that pages reach the file before COMMIT
        writer.execute("BEGIN IMMEDIATE")
        writer.execute("UPDATE record SET x = x + 1")
        writer.execute("UPDATE cells SET data = randomblob(200000)")
        with possmap.open_grid(grid) as reader:
            for half_written, place in ((other, grid), (journal_of(other), journal_of(grid))):
                place.write_bytes(half_written.read_bytes())
            with pytest.raises(GridError, match="interrupted meanwhile; opening the grid again"):
                reader.digest()
    assert digest(grid) == expected


def test_a_writer_whose_changes_do_not_fit_into_its_cache_goes_on_while_others_read(
    logs: list[Path], tmp_path: Path
) -> None:
    grid = tmp_path / "site.possmap"
    possmap.fuse(logs, grid)
    writer = Database(grid, write=True)
    writer.execute("PRAGMA cache_size = -8")
    start = time.monotonic()
    with possmap.open_grid(grid) as reader, reader.snapshot():
        before = reader.digest()
        writer.execute("BEGIN IMMEDIATE")
        for _ in range(5):
            writer.execute("UPDATE cells SET data = randomblob(50000)")
        assert reader.digest() == before
    assert time.monotonic() - start < database.WAIT_S / 2, "SQLite waited at every statement"
    writer.execute("COMMIT")
    writer.close()


def test_the_journal_of_a_grid_that_was_replaced_cannot_harm_the_new_one(
    logs: list[Path], tmp_path: Path
) -> None:
    grid, target = tmp_path / "site.possmap", tmp_path / "target.possmap"
    possmap.fuse(logs, grid)
    journal_of(target).write_bytes(b"what an interrupted writer left")
    with pytest.raises(GridError, match=r"target\.possmap-journal"):
        repair(grid, target, overwrite=True)
    assert not target.exists()
