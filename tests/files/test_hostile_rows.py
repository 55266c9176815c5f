"""A value that no possmap wrote is refused in one line, whichever command comes upon it."""

from __future__ import annotations

import random
import shutil
import sqlite3
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main

DATA = Path(__file__).parents[2] / "data" / "json"
INFO = ["info", "g.possmap"]
JSON = ["info", "g.possmap", "--json"]
QUERY = ["query", "g.possmap", "1", "1"]
AUDIT = ["audit", "g.possmap"]
VERIFY = ["verify", "g.possmap"]
RENDER = ["render", "g.possmap", "-o", "o.png"]
GEOJSON = ["export", "g.possmap", "-o", "o.geojson"]
CSV = ["export", "g.possmap", "-o", "o.csv"]
DIFF = ["diff", "g.possmap", "sound.possmap"]
BACK = ["diff", "sound.possmap", "g.possmap"]
FUSE = ["fuse", str(DATA), "-g", "g.possmap"]
AS_LOG = ["fuse", "g.possmap", "-g", "new.possmap"]
ROBOT = ["forget", "g.possmap", "--robot", "r1"]
FILE = ["forget", "g.possmap", "--brought-by", "01-r2-a.json"]
READING = (INFO, JSON, QUERY, AUDIT, VERIFY, RENDER, GEOJSON, CSV, DIFF, BACK)

DEEP = "'" + "[" * 5000 + "'"
FIRST = "WHERE id = 1"
FIFTH = "WHERE excursion = 1 AND number = 5"

HOSTILE = {
    "a setting nested too deeply": (
        f"UPDATE setting SET value = {DEEP} WHERE name = 'along'",
        (*READING, FUSE, AS_LOG, ROBOT),
        "setting 'along'",
    ),
    "a model nested too deeply": (
        f"UPDATE excursion SET model = {DEEP} {FIRST}",
        (INFO, AUDIT, QUERY, GEOJSON),
        "JSON nested too deeply",
    ),
    "a model with a parameter that there is not": (
        f"""UPDATE excursion SET model = '{{"self": 1}}' {FIRST}""",
        (INFO, AUDIT, QUERY),
        'unknown parameter "self"',
    ),
    "an own model that is a list": (
        f"UPDATE excursion SET own_model = '[1]' {FIRST}",
        (AUDIT, GEOJSON, AS_LOG),
        "model, found [1], expected an object",
    ),
    "an own model that is a text": (
        f"""UPDATE excursion SET own_model = '"x"' {FIRST}""",
        (AUDIT, GEOJSON, AS_LOG),
        'model, found "x", expected an object',
    ),
    "an own model that is a number": (
        f"UPDATE excursion SET own_model = '1e6' {FIRST}",
        (AUDIT, GEOJSON, AS_LOG),
        "model, found 1000000.0, expected an object",
    ),
    "a file's size that is bytes": (
        "UPDATE source SET size = x'00'",
        (INFO, JSON, AS_LOG),
        "found a bytes, expected a int",
    ),
    "a carrier without an excursion": (
        f"UPDATE part SET carrier_robot = 'x' {FIRST}",
        (INFO, JSON, AS_LOG),
        "found a NoneType, expected a str",
    ),
    "a delivery of a negative number of records": (
        f"UPDATE part SET count = -7 {FIRST}",
        (INFO, JSON, AS_LOG),
        "found -7, expected at least 0",
    ),
    "a delivery of more records than can be counted": (
        "UPDATE part SET count = 9223372036854775807",
        (INFO, JSON, AS_LOG, FILE),
        "found 9223372036854775807, expected at most 2^53 - 1",
    ),
    "a part of an excursion that is a text": (
        f"UPDATE part SET excursion = 'meet' {FIRST}",
        (FILE,),
        "what a file brought: found a str, expected a int",
    ),
    "a touched tile of an excursion that is a text": (
        "UPDATE touched SET excursion = 'meet' WHERE excursion = 3",
        (ROBOT,),
        "found a str, expected a int",
    ),
    "a column beyond every lattice": (
        f'UPDATE tile SET "column" = 9223372036854775807 {FIRST}',
        (INFO, RENDER, CSV, DIFF, BACK),
        "expected it within ±2^53",
    ),
    "a column before every lattice": (
        f'UPDATE tile SET "column" = -9223372036854775808 {FIRST}',
        (INFO, RENDER, CSV, DIFF, BACK),
        "expected it within ±2^53",
    ),
    "a column that is a text": (
        f"""UPDATE tile SET "column" = 'null' {FIRST}""",
        (INFO, RENDER, CSV, DIFF, BACK),
        "found a str, expected a int",
    ),
    "a column that is bytes": (
        f"""UPDATE tile SET "column" = x'fffe' {FIRST}""",
        (INFO, RENDER, CSV),
        "found a bytes, expected a int",
    ),
    "a column that is a number without an end": (
        f"""UPDATE tile SET "column" = '{"9" * 5000}' {FIRST}""",
        (INFO, RENDER, CSV),
        "found a float, expected a int",
    ),
    "a row that is a fraction": (
        f"UPDATE tile SET row = 1.5 {FIRST}",
        (INFO, RENDER, CSV, DIFF, BACK),
        "the place of a tile: found a float, expected a int",
    ),
    "a row that is a text": (
        f"UPDATE tile SET row = 'x' {FIRST}",
        (INFO, RENDER, CSV, DIFF, BACK),
        "the place of a tile: found a str, expected a int",
    ),
    "bounds that are outside the tile": (
        "UPDATE tile SET row0 = -9223372036854775808",
        (INFO, RENDER, CSV),
        "the bounds of a tile: ",
    ),
    "a place that is infinite": (
        f"UPDATE record SET x = 9e999 {FIFTH}",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "x, found inf, expected a number within ±1e6",
    ),
    "a place where no log may say so": (
        "UPDATE record SET y = -1000001.0 WHERE excursion = 1 AND kind = 'pose'",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "y, found -1000001.0, expected a number within ±1e6",
    ),
    "headings that are infinite": (
        "UPDATE record SET heading = -9e999 WHERE excursion = 1 AND kind = 'pose'",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "heading, found -inf, expected a number within ±1e6",
    ),
    "errors that are negative": (
        "UPDATE record SET error_x = -1.0 WHERE excursion = 1 AND kind = 'pose'",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "error_x, found -1.0, expected a half-width >= 0",
    ),
    "a time that is infinite": (
        "UPDATE record SET t = 9e999 WHERE excursion = 1",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "t, found inf, expected a finite number",
    ),
    "a seq before the first": (
        "UPDATE record SET seq = -1 WHERE excursion = 1",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "seq, found -1, expected 0 to 2^53 - 1",
    ),
    "a kind that there is not": (
        f"UPDATE record SET kind = 'beam' || char(27) {FIFTH}",
        (AUDIT, GEOJSON, AS_LOG),
        'found the kind "beam\\u001b"',
    ),
    "a corrected place that is infinite": (
        "UPDATE record SET map_x2 = 9e999 WHERE excursion = 1 AND map_x IS NOT NULL",
        (GEOJSON,),
        "found inf, expected a number within ±1e15",
    ),
    "a record with a number of its own": (
        f"UPDATE record SET number = 100000 {FIFTH}",
        (QUERY, AUDIT, GEOJSON, AS_LOG),
        "its records are not numbered one by one",
    ),
    "less than nothing forgotten": (
        "INSERT INTO forgotten VALUES (1, 'r9', NULL, NULL, NULL, -1, 0, '2026', '1')",
        (INFO, JSON),
        "what was forgotten: found -1, expected at least 0",
    ),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    grid = tmp_path_factory.mktemp("sound") / "site.possmap"
    assert run("-q", "fuse", str(DATA), "-g", str(grid)).exit_code == 0
    return grid


@pytest.fixture(autouse=True)
def beside(sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder of its own, beside a copy of a grid that is sound."""
    monkeypatch.chdir(tmp_path)
    for name in ("sound.possmap", "g.possmap"):
        shutil.copy(sound, name)


def run(*args: str) -> Result:
    return CliRunner().invoke(main, list(args), prog_name="possmap", color=True)


def change(sql: str, *values: object) -> int:
    connection = sqlite3.connect("g.possmap")
    try:
        return connection.execute(sql, values).rowcount
    finally:
        connection.commit()
        connection.close()


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_value_that_no_possmap_wrote_is_named_in_one_line(kind: str) -> None:
    sql, commands, problem = HOSTILE[kind]
    assert change(sql) > 0
    for command in commands:
        result = run(*command)
        assert result.exit_code == 1, (command, result.output, result.exception)
        assert isinstance(result.exception, SystemExit), (command, result.exception)
        lines = result.stderr.splitlines()
        assert any(problem in line for line in lines) or command[0] == "verify", (command, lines)
        assert all(line.startswith("possmap: ") for line in lines if command[0] != "fuse"), lines
        assert all(line.isprintable() and len(line) < 400 for line in lines), lines
        if command[0] not in ("fuse", "verify"):
            assert len(lines) == 1 and lines[0].startswith("possmap: g.possmap: damaged: "), lines


NAMES = {"robot": "r\x1b[2J" + "x" * 4_000, "name": "a\n\x1b]0;pwned\x07"}


def test_names_are_printed_without_terminal_codes_and_not_at_any_length() -> None:
    for column, name in NAMES.items():
        assert change(f"UPDATE excursion SET {column} = ? WHERE id = 1", name)
    assert change("UPDATE source SET name = ?", "\x1b[2J\n" + "é" * 3_000)
    carrier = "UPDATE part SET carrier_robot = ?, carrier_excursion = ?"
    assert change(carrier, *NAMES.values())
    assert change(
        "INSERT INTO forgotten VALUES (1, ?, NULL, NULL, NULL, 0, 0, ?, '1')", "\x1b[2J", "\x1b[3J"
    )
    for command in (INFO, AUDIT, QUERY, DIFF, BACK):
        result = run(*command)
        assert result.exit_code == 0, (command, result.output)
        lines = result.output.split("\n")
        assert all(line.isprintable() and len(line) < 500 for line in lines), (command, lines)
        assert any("r\\x1b[2Jx" in line for line in lines) or command == QUERY, (command, lines)


TABLES = (
    "setting", "source", "excursion", "part", "record", "touched", "tile", "cells", "again",
    "forgotten",
)  # fmt: skip
VALUES = (
    None, 0, -1, 1, 2**62, -(2**63), 2**63 - 1, 2**53, 1e308, -1e308, float("inf"), float("-inf"),
    1e6, 1e18, 5e-324, "", "x", "\x1b[2J\x1b]0;x\x07", "é" * 10, "a" * 100_000, b"", b"\0" * 40,
    b"\xff\xfe", "{}", "[]", "null", "1e999", "NaN", '"x"', "[" * 5000, '{"a":' * 100_000,
    "9" * 5000, '{"sensor":1e400}', "true", 3.5, -3, "wall", "pose", "beam", "meet", "zzz", "r1",
)  # fmt: skip


@pytest.mark.parametrize("some", range(10))
def test_whatever_value_stands_wherever_no_command_breaks(some: int, sound: Path) -> None:
    commands = (INFO, JSON, QUERY, AUDIT, RENDER, CSV, GEOJSON, DIFF, BACK)
    for seed in range(20 * some, 20 * some + 20):
        rng = random.Random(seed)
        shutil.copy(sound, "g.possmap")
        table = rng.choice(TABLES)
        connection = sqlite3.connect("g.possmap")
        column = rng.choice([row[1] for row in connection.execute(f"PRAGMA table_info ({table})")])
        keys = [row[1] for row in connection.execute(f"PRAGMA table_info ({table})") if row[5]]
        names = ", ".join(f'"{key}"' for key in keys)
        rows = connection.execute(f"SELECT {names} FROM {table}").fetchall()
        connection.close()
        if not rows:
            continue
        where = " AND ".join(f'"{key}" IS ?' for key in keys)
        value, row = rng.choice(VALUES), rng.choice(rows)
        try:
            change(f'UPDATE OR REPLACE {table} SET "{column}" = ? WHERE {where}', value, *row)
        except sqlite3.IntegrityError:  # a value that SQLite keeps out by itself
            continue
        for command in rng.sample(commands, 3):
            output = ["--overwrite"] if "-o" in command else []
            result = run(*command, *output)
            told = (seed, table, column, repr(value)[:30], command)
            assert result.exit_code in (0, 1), (told, result.output, result.exception)
            assert result.exception is None or isinstance(result.exception, SystemExit), told
            assert "\x1b" not in result.output, told
            if result.exit_code == 1:
                lines = result.stderr.splitlines()
                assert len(lines) == 1 and lines[0].startswith("possmap: "), (told, lines)
