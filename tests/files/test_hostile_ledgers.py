"""A grid fused into another is trusted no more than logs: its ledger is held to their rules."""

from __future__ import annotations

import math
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from forging import forge
from teams import digest
from versions import SETTINGS, WHOLE, changed, log_of, outcomes, prefix, written

import possmap
from possmap.core.records import PartialMap, Pose, Wall
from possmap.errors import GridError
from possmap.grid.grid import Grid
from possmap.grid.rows import excursion_hash
from possmap.logs.delivery import path_text
from possmap.logs.fields import Fault
from possmap.logs.rechecking import rechecked

WHOSE = "old.possmap: damaged: excursion a of robot r1: "
CORNER = {"seq": 6, "kind": "corner", "x": 1.0, "y": 1.0, "corner": "convex"}
MEET = {"seq": 7, "kind": "meet", "peer": "r2", "peer_excursion": "a"}

RULES = {
    "x beyond any site": (
        "UPDATE record SET x = 1e300 WHERE excursion = 1 AND number = 2",
        "found 1e+300, expected a number within ±1e6",
    ),
    "a time without end": (
        "UPDATE record SET t = -9e999 WHERE excursion = 1 AND number = 2",
        "expected a finite number",
    ),
    "a negative error": (
        "UPDATE record SET error_x = -0.5 WHERE excursion = 1 AND number = 2",
        "expected a half-width",
    ),
    "a kind of corner with codes for the terminal": (
        "UPDATE record SET corner = char(27) || '[2J' WHERE excursion = 1 AND number = 6",
        'found "\\u001b[2J"',
    ),
    "a peer whose name is none": (
        "UPDATE record SET peer = 'a b' WHERE excursion = 1 AND number = 7",
        'found "a b", expected ',
    ),
    "a wall before the first pose": (
        "DELETE FROM record WHERE excursion = 1 AND number = 0;"
        " UPDATE record SET seq = 0 WHERE excursion = 1 AND number = 1;"
        " UPDATE record SET number = number + 100 WHERE excursion = 1;"
        " UPDATE record SET number = number - 101 WHERE excursion = 1;"
        " UPDATE excursion SET records = 7 WHERE id = 1",
        "records[0].kind: expected a pose before the first wall, corner or beam",
    ),
    "records out of order": (
        "UPDATE record SET seq = 1 WHERE excursion = 1 AND number = 2",
        "records[2].seq: found 1, expected more than 1, the one before",
    ),
    "a model of the log's own that knows no bounds": (
        "UPDATE excursion SET own_model = '{\"along\": -1}' WHERE id = 1",
        "expected a number >= 0",
    ),
    "keys of its own that are none": (
        "UPDATE excursion SET extra = '{{{' WHERE id = 1",
        'found "{{{", expected an object of x_ keys',
    ),
    "keys of its own that rename the robot": (
        'UPDATE excursion SET extra = \'{"robot": "r2"}\' WHERE id = 1',
        'found "{\\"robot\\": \\"r2\\"}", expected an object of x_ keys',
    ),
    "keys of its own, nested too deep": (
        "UPDATE record SET extra = '{\"x_a\": ' || replace(hex(zeroblob(16)), '00', '[') ||"
        " replace(hex(zeroblob(16)), '00', ']') || '}' WHERE excursion = 1 AND number = 2",
        "records[2].x_a: nested too deep (setting limit_nesting)",
    ),
}
"""What is written into a grid, and what of the refusal does not depend on who notices first."""

FAULTS = {
    "records[0].x: found 2000000.0, expected a number within ±1e6": {"x": 2e6},
    "records[0].t: found -Infinity, expected a finite number": {"t": -math.inf},
    "records[0].error_x: found -0.5, expected a half-width >= 0": {"error_x": -0.5},
    "records[0].seq: found -1, expected 0 to 2^53 - 1": {"seq": -1},
    "records[0].heading: found NaN, expected a finite number": {"heading_deg": math.nan},
    "records[0].x_a: found Infinity, expected a finite number": {"extra": '{"x_a": 9e999}'},
    'records[0].x_a: the key "x_a" is given twice': {"extra": '{"x_a": 1, "x_a": 2}'},
    'records[0]: found "[", expected an object of x_ keys': {"extra": "["},
    "records[0]: found [], expected an object": {"extra": "[]"},
}


SOURCES = {
    "a hash that is a command": (
        "UPDATE source SET sha256 = '$(reboot)' || char(27) || '[2J'",
        "a file that brought it is not as possmap writes it",
    ),
    "a carrier whose name is none": (
        "UPDATE arrival SET carrier_robot = char(27) || '[31m', carrier_excursion = 'a'",
        "a file that brought it is not as possmap writes it",
    ),
    "a file that held a text": (
        "UPDATE arrival SET records = 'all'",
        "INTEGER value in arrival.records",
    ),
    "a place that is bytes": (
        "UPDATE record SET x = x'00' WHERE number = 2",
        "REAL value in record.x",
    ),
    "records that nothing brought": (
        "UPDATE arrival SET records = 3",
        "nothing says what brought its last record",
    ),
}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """Make a grid of one excursion of r1 with records of most kinds."""
    log = {**WHOLE, "records": [*WHOLE["records"], CORNER, MEET]}
    grid = tmp_path / "old.possmap"
    possmap.fuse(written(tmp_path, r1=log), grid, SETTINGS)
    return grid


def spoil(grid: Path, script: str, rehash: bool = False) -> None:
    """Change a grid behind possmap's back; perhaps with the hash that then fits."""
    forge(grid, script)
    if rehash:
        try:
            with Grid(grid) as opened:
                entry = next(opened.ledger.entries())
                digest = excursion_hash(opened.ledger.version(entry), entry.model)
        except GridError:
            return  # whatever its hash, nobody reads it
        with closing(sqlite3.connect(grid)) as database, database:
            database.execute("UPDATE excursion SET hash = ? WHERE id = 1", (digest,))


def refused(old: Path) -> str:
    """Fuse a grid into a new one; return why it was refused, and nothing is left."""
    new = old.with_name("new.possmap")
    summary = possmap.fuse([old], new, SETTINGS)
    assert outcomes(summary) == [("refused", 0, 0)]
    assert not new.exists()
    return (summary.logs[0].error or "").replace(f"{old.parent}/", "")


def test_records_that_were_changed_do_not_get_in(old: Path) -> None:
    spoil(old, "UPDATE record SET x = x + 3 WHERE excursion = 1 AND number > 2")
    assert refused(old) == WHOSE + "its hash is not that of its records"


def test_a_model_in_force_that_was_changed_does_not_get_in(old: Path) -> None:
    spoil(old, "UPDATE excursion SET model = json_set(model, '$.along', 0.5)")
    assert refused(old) == WHOSE + "its hash is not that of its records"


@pytest.mark.parametrize("case", RULES)
def test_what_no_log_may_say_a_grid_may_not_either(case: str, old: Path) -> None:
    script, problem = RULES[case]
    spoil(old, script, rehash=True)
    found = refused(old)
    assert found.startswith(WHOSE) and problem in found and "\n" not in found


@pytest.mark.parametrize("fault", FAULTS)
def test_a_version_is_held_to_every_rule_of_logs(fault: str) -> None:
    whole = PartialMap("r1", "a", (), (Pose(0, None, 1.0, 2.0, 3.0), Wall(1, 0.5, 0, 0, 1, 1)))
    assert rechecked(whole, 15) is whole
    first = replace(whole.records[0], **FAULTS[fault])
    with pytest.raises(Fault) as raised:
        rechecked(replace(whole, records=(first, *whole.records[1:])), 15)
    problem = raised.value.problem
    assert ": ".join(filter(None, [path_text(raised.value.path), problem])) == fault


@pytest.mark.parametrize("case", SOURCES)
def test_what_is_said_of_files_is_held_to_what_possmap_writes(case: str, old: Path) -> None:
    script, problem = SOURCES[case]
    spoil(old, script)
    found = refused(old)
    assert found.startswith("old.possmap: damaged: ") and problem in found
    assert "\x1b" not in found


def test_a_robot_whose_name_is_none_does_not_get_in(old: Path) -> None:
    spoil(old, "UPDATE excursion SET robot = char(27) || '[2J'", rehash=True)
    found = refused(old)
    assert 'found "\\u001b[2J", expected ' in found and "\x1b" not in found


def test_a_grid_is_no_way_around_the_limit_of_cells(old: Path) -> None:
    new = old.with_name("new.possmap")
    (log,) = possmap.fuse([old], new, {**SETTINGS, "limit_file_cells": 1}).logs
    assert log.status == "refused" and "(setting limit_file_cells)" in (log.error or "")


def test_a_sound_grid_says_the_same_as_its_logs(tmp_path: Path) -> None:
    own: dict[str, Any] = {"x_note": {"é": [1, None, 2.5]}}
    carrier = {**log_of("r2", 4, **own), "carried": [prefix(WHOLE, 3)], "model": {"along": 0.02}}
    whole = changed(WHOLE, 1, t=0.0, x_mine=["a"])
    logs = written(tmp_path, r2=carrier, empty=log_of("r3", 0), r1=WHOLE, other=whole)
    old, new = tmp_path / "old.possmap", tmp_path / "new.possmap"
    possmap.fuse(logs[:3], old, SETTINGS)
    shutil.copy(old, tmp_path / "copy.possmap")
    assert outcomes(possmap.fuse([old], new, SETTINGS)) == [("fused", 10, 0)]
    assert digest(new) == digest(old)
    with Grid(old) as one, Grid(new) as other:
        before, after = (
            [(one.name, one.records, one.origin, one.carrier) for one in grid.ledger.came.all()]
            for grid in (one, other)
        )
        extras = [grid.ledger.version(next(grid.ledger.entries())).extra for grid in (one, other)]
    assert before == after and extras[0] == extras[1] != ""
