"""A grid file from anywhere runs nothing, never hangs, and is refused in one line."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main

DATA = Path(__file__).parents[2] / "data" / "json"
ENDLESS = "WITH RECURSIVE n (x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)"

HOSTILE = {
    "an endless view in place of the settings": (
        f"DROP TABLE setting; CREATE VIEW setting AS {ENDLESS} SELECT x AS name, x AS value FROM n",
        "the table setting is missing, or not as possmap made it",
    ),
    "an endless view in place of the records": (
        f"DROP TABLE record; CREATE VIEW record AS {ENDLESS} SELECT x AS excursion FROM n",
        "the table record is missing, or not as possmap made it",
    ),
    "a trigger that fires when somebody fuses": (
        "CREATE TRIGGER spy AFTER INSERT ON excursion BEGIN DELETE FROM tile; END",
        "the trigger spy is none of possmap's",
    ),
    "a trigger with a name that hides": (
        "CREATE TRIGGER sqlitexspy AFTER INSERT ON excursion BEGIN DELETE FROM tile; END",
        "the trigger sqlitexspy is none of possmap's",
    ),
    "a computed column": (
        "ALTER TABLE setting ADD COLUMN bomb AS (zeroblob(1000000000))",
        "the table setting is missing, or not as possmap made it",
    ),
    "an index over an expression": (
        "CREATE INDEX slow ON excursion (abs(id))",
        "the index slow is none of possmap's",
    ),
    "a name with codes for the terminal": (
        'CREATE VIEW "\x1b[2J" AS SELECT 1',
        "the view \\x1b[2J is none of possmap's",
    ),
    "a virtual table": (
        "CREATE VIRTUAL TABLE words USING fts5 (body)",
        "the table words is none of possmap's",
    ),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    grid = tmp_path_factory.mktemp("sound") / "site.possmap"
    assert run("-q", "fuse", str(DATA), "-g", str(grid)).exit_code == 0
    return grid


def run(*args: str) -> Result:
    return CliRunner().invoke(main, list(args), prog_name="possmap")


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_schema_that_is_not_possmaps_is_never_used(
    kind: str, sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(sound, "site.possmap")
    sql, fault = HOSTILE[kind]
    connection = sqlite3.connect("site.possmap")
    try:
        connection.executescript(sql)
    except sqlite3.OperationalError as error:  # not every SQLite has every module
        pytest.skip(str(error))
    finally:
        connection.close()
    before = Path("site.possmap").read_bytes()
    for command in (
        ["info", "site.possmap"],
        ["render", "site.possmap", "-o", "site.png"],
        ["query", "site.possmap", "0", "0"],
        ["export", "site.possmap", "-o", "site.npz"],
        ["verify", "site.possmap"],
        ["repair", "site.possmap", "-o", "new.possmap"],
        ["audit", "site.possmap"],
        ["fuse", str(DATA), "-g", "site.possmap"],
    ):
        result = run(*command)
        assert result.stderr == f"possmap: site.possmap: {fault}\n", command
        assert (result.stdout, result.exit_code) == ("", 1)
    result = run("fuse", "site.possmap", "-g", "new.possmap")
    assert f"possmap: site.possmap: {fault}\n" in result.stderr and result.exit_code == 1
    assert Path("site.possmap").read_bytes() == before
    assert [path.name for path in Path().iterdir()] == ["site.possmap"]


def test_tables_that_analyze_leaves_are_let_in(sound: Path, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    shutil.copy(sound, grid)
    connection = sqlite3.connect(grid)
    connection.execute("ANALYZE")
    connection.close()
    assert run("verify", str(grid)).exit_code == 0


def test_a_value_as_large_as_no_log_is_damage(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("possmap.grid.database._LARGEST", 2**20)
    grid = tmp_path / "site.possmap"
    shutil.copy(sound, grid)
    connection = sqlite3.connect(grid)
    connection.execute("UPDATE setting SET value = hex(zeroblob(1000000)) WHERE name = 'along'")
    connection.commit()
    connection.close()
    result = run("info", str(grid))
    assert result.stderr == f"possmap: {grid}: damaged: string or blob too big\n"
    assert result.exit_code == 1
