"""kill -9 in the middle of a batch, then the same command: the digest of an undisturbed run."""

from __future__ import annotations

import random
import shutil
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from literal.teams import random_excursion
from teams import digest, write_logs

import possmap

LOGS = 40
ROUNDS = 6
SETTINGS = ["--set", "transaction_records=60", "--set", "max_error=0.8", "--resolution", "0.05"]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Make a batch of logs whose fusion takes a second or two, in many transactions."""
    rng = np.random.default_rng(9)
    made = [
        {"possmap_log": 1, **random_excursion(rng, f"r{number}", "a")} for number in range(LOGS)
    ]
    return write_logs(tmp_path_factory.mktemp("crash") / "logs", made)


def command(folder: Path, grid: Path) -> list[str]:
    return [sys.executable, "-m", "possmap", "fuse", str(folder), "-g", str(grid), *SETTINGS]


def journal(grid: Path) -> Path:
    return grid.with_name(grid.name + "-journal")


def whole_logs_only(killed: Path, known: set[str], folder: Path) -> int:
    """Check that a grid is sound and holds whole logs; return how many.

    It looks at a copy: whoever opens the grid itself restores it, and that is what the same
    command must be able to do.
    """
    folder.mkdir(exist_ok=True)
    grid = folder / "site.possmap"
    for source, copy in ((killed, grid), (journal(killed), journal(grid))):
        copy.unlink(missing_ok=True)
        if source.exists():
            shutil.copy(source, copy)
    if not grid.exists() or not _has_schema(grid):
        return 0
    with possmap.open_grid(grid) as opened:
        found = {arrival.part.origin.name for arrival in opened.ledger.arrivals()}
        held = {entry.name: entry.records for entry in opened.ledger.entries()}
    with sqlite3.connect(grid) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
    assert found <= known
    assert len(held) == len(found)
    return len(found)


def _has_schema(grid: Path) -> bool:
    connection = sqlite3.connect(grid)
    try:
        return bool(connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0])
    finally:
        connection.close()


def test_killed_anywhere_the_same_command_completes_the_job(
    logs: list[Path], tmp_path: Path
) -> None:
    folder = logs[0].parent
    undisturbed = tmp_path / "undisturbed.possmap"
    start = time.monotonic()
    subprocess.run(command(folder, undisturbed), check=True, capture_output=True)
    seconds = time.monotonic() - start
    expected = digest(undisturbed)
    chance = random.Random(1)
    kills, partial, journals = 0, 0, 0
    for number in range(ROUNDS):
        grid = tmp_path / f"{number}.possmap"
        for _ in range(6):  # the same grid is killed again and again
            process = subprocess.Popen(
                command(folder, grid), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            time.sleep(chance.uniform(0.1, 0.95) * seconds)
            process.kill()
            kills += process.wait() == -9
            journals += journal(grid).exists()
            count = whole_logs_only(grid, {str(path) for path in logs}, tmp_path / "copy")
            partial += 0 < count < LOGS
        subprocess.run(command(folder, grid), check=True, capture_output=True)
        assert digest(grid) == expected
    assert kills >= ROUNDS
    assert partial > 0, "no kill fell into the middle of the batch"
    assert journals > 0, "no kill fell into a transaction"


KILL_AT = """
import os, signal, sys
from possmap.files.gridfile import database
from possmap.cli.main import main

count = int(sys.argv[1])
def guarded(method):
    def wrapper(self, sql, *values):
        global count
        count -= 1
        if count <= 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return method(self, sql, *values)
    return wrapper

for name in ("execute", "many"):
    setattr(database.Database, name, guarded(getattr(database.Database, name)))
main(sys.argv[2:])
"""


def test_killed_before_any_statement_the_grid_holds_whole_logs_only(
    logs: list[Path], tmp_path: Path
) -> None:
    script = tmp_path / "kill_at.py"
    script.write_text(KILL_AT)
    some = [str(path) for path in logs[:3]]
    arguments = ["fuse", *some, "-g"]
    undisturbed = tmp_path / "undisturbed.possmap"
    whole = [sys.executable, str(script), "1000000", *arguments, str(undisturbed), *SETTINGS]
    subprocess.run(whole, check=True, capture_output=True)
    expected = digest(undisturbed)
    statements = [1, 2, 5, 10, 17, 24, 31, 38, 45, 60, 80, 100]
    for count in statements:
        grid = tmp_path / f"{count}.possmap"
        killed = [sys.executable, str(script), str(count), *arguments, str(grid), *SETTINGS]
        code = subprocess.run(killed, capture_output=True, check=False).returncode
        assert code in (0, -9)
        whole_logs_only(grid, set(some), tmp_path / "copy")
        subprocess.run([*whole[:2], "1000000", *arguments, str(grid), *SETTINGS], check=True)
        assert digest(grid) == expected
