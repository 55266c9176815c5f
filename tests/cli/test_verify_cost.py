"""``possmap verify`` takes about as long as fusing, and stops where it would never end."""

from __future__ import annotations

import json
import re
import sqlite3
import struct
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main
from possmap.fusing import refuse
from possmap.grid.database import Database

MANY = 70
"""Excursions, more than the 64 that were once kept laid out."""


def run(*args: str) -> Result:
    return CliRunner().invoke(main, list(args), prog_name="possmap")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a grid of many excursions that all run through the same few tiles."""
    monkeypatch.chdir(tmp_path)
    carried = [
        {
            "robot": f"q{number}",
            "excursion": "a",
            "model": {},
            "records": [
                {"seq": seq, "kind": "pose", "x": 30.0 * seq, "y": number / 10, "heading": 0}
                for seq in (0, 1)
            ],
        }
        for number in range(MANY)
    ]
    log = {"possmap_log": 1, "robot": "r", "excursion": "a", "records": [], "carried": carried}
    Path("log.json").write_text(json.dumps(log))
    assert run("fuse", "log.json", "-g", "site.possmap").exit_code == 0
    return Path("site.possmap")


def change(grid: Path, sql: str) -> None:
    connection = sqlite3.connect(grid)
    connection.executescript(sql)
    connection.close()


TO_FORMAT_1 = (
    "DROP TABLE again; DROP TABLE forgotten; DROP INDEX part_of_excursion; PRAGMA user_version = 1"
)


@pytest.mark.parametrize("full", [(), ("--full",)])
@pytest.mark.parametrize("sql", ["", TO_FORMAT_1], ids=["format 2", "format 1"])
def test_nothing_that_is_asked_often_scans_a_table(
    site: Path, sql: str, full: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    change(site, sql)
    asked: Counter[str] = Counter()
    ask = Database._patiently

    def noted(self: Database, statement: str, values: Sequence[object]) -> Any:
        asked[statement] += 1
        return ask(self, statement, values)

    monkeypatch.setattr(Database, "_patiently", noted)
    assert run("verify", "site.possmap", *full).exit_code == 0
    connection = sqlite3.connect(site)
    scans = [
        (statement, step)
        for statement, times in asked.items()
        if times > (9 if statement.endswith("FROM setting") else 2)
        and not statement.startswith(("PRAGMA", "BEGIN", "COMMIT"))
        for *_, step in connection.execute(
            f"EXPLAIN QUERY PLAN {statement}", [0] * _values_of(statement)
        )
        if re.match(r"SCAN (?!held|CONSTANT|\()", step)
    ]
    connection.close()
    assert max(asked.values()) >= MANY
    assert not scans


def _values_of(statement: str) -> int:
    numbered = set(re.findall(r"\?\d+", statement))
    return len(numbered) or statement.count("?")


def test_each_excursion_is_laid_out_once_for_all_tiles(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    laid_out: list[str] = []
    find = refuse.findings

    def noted(excursion: Any, *rest: Any) -> Any:
        laid_out.append(excursion.robot)
        return find(excursion, *rest)

    monkeypatch.setattr(refuse, "findings", noted)
    result = json.loads(run("verify", "site.possmap", "--full", "--json").stdout)
    assert result["fused_again"] > 1
    assert len(laid_out) == MANY + 1  # with the one that carried them


@pytest.mark.parametrize("part", ["TILES", "KEPT", "GATHERED"])
def test_with_little_memory_the_same_is_found_in_more_steps(
    site: Path, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refuse, part, 2**62)
    assert run("verify", "site.possmap", "--full").exit_code == 0
    change(
        site,
        "DELETE FROM touched WHERE excursion = 9 AND tile_column ="
        " (SELECT max(tile_column) FROM touched);"
        "DELETE FROM cells WHERE tile = 1; DELETE FROM tile WHERE id = 1",
    )
    faults = run("verify", "site.possmap", "--full").stderr.splitlines()
    named = [line.removeprefix("possmap: site.possmap: ").partition(":")[0] for line in faults]
    assert sorted(named) == [
        "excursion a of robot q7",
        "tile -1, 0, free space",  # that is gone
        "tile 0, 1, free space",  # of which the list does not say all
    ]


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE touched SET tile_column = 100 WHERE excursion = 9 AND tile_column = 0",
        "UPDATE touched SET number = 0 WHERE excursion = 9 AND tile_column = 0",
        "INSERT INTO touched VALUES (100, 100, 9, 0)",
    ],
    ids=["elsewhere", "by another record", "one more"],
)
def test_a_wrong_list_of_tiles_is_found_however_it_is_wrong(site: Path, sql: str) -> None:
    change(site, sql)
    result = run("verify", "site.possmap", "--full")
    assert result.exit_code == 1
    assert "its tiles are not those that its records touch" in result.stderr


def test_after_a_fault_of_the_structure_nothing_is_read_on(site: Path) -> None:
    connection = sqlite3.connect(site)
    (root,) = connection.execute(
        "SELECT rootpage FROM sqlite_schema WHERE name = 'source'"
    ).fetchone()
    (size,) = connection.execute("PRAGMA page_size").fetchone()
    connection.close()
    pages = bytearray(site.read_bytes())
    leaf = bytes(pages[(root - 1) * size : root * size])
    assert leaf[0] == 13, "a page of rows"
    last = len(pages) // size + 1
    # An inner page all of whose children are one page: its row seems to be there four times.
    inner = bytearray(size)
    inner[:12] = struct.pack(">BHHHBI", 5, 0, 3, size - 15, 0, last)
    inner[12:18] = struct.pack(">HHH", size - 5, size - 10, size - 15)
    for place, key in enumerate((1, 2, 3), 1):
        inner[size - 5 * place : size - 5 * (place - 1)] = struct.pack(">IB", last, key)
    pages[(root - 1) * size : root * size] = inner
    pages[28:32] = struct.pack(">I", last)
    site.write_bytes(bytes(pages) + leaf)
    result = run("verify", "site.possmap")
    faults = [line.removeprefix("possmap: site.possmap: ") for line in result.stderr.splitlines()]
    assert (result.stdout, result.exit_code) == ("", 1)
    assert any("2nd reference to page" in one for one in faults)
    assert [one for one in faults if not one.startswith("SQLite: ")] == [
        "nothing else was looked at: its structure is damaged"
    ]
