"""``possmap verify`` and ``possmap repair``: damage is named, and the ledger saves what it can."""

from __future__ import annotations

import json
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from literal.teams import random_team
from teams import ROBUST, digest, fuse, write_logs

from possmap.cli.main import main

DATA = Path(__file__).parents[2] / "data" / "json"


def run(*args: str) -> Result:
    return CliRunner().invoke(main, list(args), prog_name="possmap")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    grid = tmp_path_factory.mktemp("sound") / "site.possmap"
    assert run("-q", "fuse", str(DATA), "-g", str(grid)).exit_code == 0
    return grid


@pytest.fixture
def site(sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(sound, "site.possmap")
    return Path("site.possmap")


def damage(grid: Path, sql: str) -> None:
    connection = sqlite3.connect(grid)
    connection.executescript(sql)
    connection.close()


def test_a_sound_grid_is_called_sound_with_its_digest(site: Path) -> None:
    result = run("verify", "site.possmap")
    assert (result.stderr, result.exit_code) == ("", 0)
    assert result.stdout.splitlines() == [
        "site.possmap: sound: 5 excursions, 4 tiles, 4 of them fused again",
        f"digest {digest(site)}",
    ]


DAMAGE = {
    "a byte of a tile": (
        "UPDATE cells SET data = x'02' || substr(data, 2) WHERE tile = 1",
        "tile -1, -1, walls: ",
    ),
    "a hash of a tile": (
        "UPDATE tile SET hash = zeroblob(32) WHERE id = 2",
        "tile -1, -1, free space: its hash is not that of its cells",
    ),
    "bounds of a tile": (
        "UPDATE tile SET row1 = 300 WHERE id = 1",
        "tile -1, -1, walls: bounds outside the tile",
    ),
    "a tile that is gone": (
        "DELETE FROM cells WHERE tile = 1; DELETE FROM tile WHERE id = 1",
        "tile -1, -1, walls: not what the ledger's records make",
    ),
    "a record that was moved": (
        "UPDATE record SET x = x + 0.1 WHERE excursion = 2 AND number = 5",
        "excursion a of robot r3: its hash is not that of its records",
    ),
    "a record that is gone": (
        "DELETE FROM record WHERE excursion = 1 AND number = 3",
        "excursion a of robot r2: damaged: excursion a of robot r2: ",
    ),
    "a place on the map": (
        "UPDATE record SET map_x = map_x + 0.1 WHERE excursion = 1 AND number = 1",
        "excursion a of robot r2: its places are not those of its records",
    ),
    "tiles touched": (
        "DELETE FROM touched WHERE excursion = 1"
        " AND number = (SELECT max(number) FROM touched WHERE excursion = 1)",
        "excursion a of robot r2: its tiles are not those that its records touch",
    ),
    "an arrival": (
        "DELETE FROM part WHERE excursion = 1",
        "excursion a of robot r2: nothing says what brought record 0",
    ),
    "a view": ("CREATE VIEW spy AS SELECT 1", "the view spy is none of possmap's"),
    "a trigger": (
        "CREATE TRIGGER t AFTER INSERT ON record BEGIN DELETE FROM record; END",
        "the trigger t is none of possmap's",
    ),
    "a table that is gone": ("DROP TABLE touched", "the table touched is missing, or not as"),
    "a tile of a missing row": (
        "INSERT INTO cells VALUES (999, x'00')",
        "row 999 of table cells belongs to a row of tile that is not there",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_each_kind_of_damage_is_named(site: Path, kind: str) -> None:
    sql, fault = DAMAGE[kind]
    damage(site, sql)
    result = run("verify", "site.possmap", "--full")
    assert (result.stdout, result.exit_code) == ("", 1)
    faults = [line.removeprefix("possmap: site.possmap: ") for line in result.stderr.splitlines()]
    assert any(one.startswith(fault) for one in faults), faults


@pytest.mark.parametrize("kind", ["a byte of a tile", "a tile that is gone", "a place on the map"])
def test_what_the_ledger_knows_is_brought_back(site: Path, sound: Path, kind: str) -> None:
    damage(site, DAMAGE[kind][0])
    assert run("repair", "site.possmap", "-o", "new.possmap").exit_code == 0
    assert digest(Path("new.possmap")) == digest(sound)
    assert run("verify", "new.possmap", "--full").exit_code == 0


def test_a_lost_excursion_is_named_and_the_others_are_saved(site: Path) -> None:
    damage(site, DAMAGE["a record that was moved"][0])
    result = run("repair", "site.possmap", "-o", "new.possmap", "--json")
    assert result.stderr.splitlines() == [
        "possmap: site.possmap: lost: excursion a of robot r3: its hash is not that of its records"
    ]
    assert result.exit_code == 1
    assert json.loads(result.stdout)["excursions"] == 4
    assert run("verify", "new.possmap", "--full").exit_code == 0


def test_a_repaired_grid_remembers_what_brought_its_records(site: Path) -> None:
    run("repair", "site.possmap", "-o", "new.possmap")
    old, new = (
        json.loads(run("info", grid, "--json").stdout) for grid in ("site.possmap", "new.possmap")
    )
    assert old["excursions"] == new["excursions"]


def test_an_existing_output_is_kept_and_a_grid_never_replaces_itself(site: Path) -> None:
    before = site.read_bytes()
    Path("new.possmap").write_text("mine")
    result = run("repair", "site.possmap", "-o", "new.possmap")
    assert result.stderr == "possmap: new.possmap: exists already; --overwrite replaces it\n"
    result = run("repair", "site.possmap", "-o", "site.possmap", "--overwrite")
    assert result.stderr == ("possmap: site.possmap: would replace itself, expected another -o\n")
    assert (site.read_bytes(), Path("new.possmap").read_text()) == (before, "mine")
    assert {path.name for path in Path().iterdir()} == {"site.possmap", "new.possmap"}


@pytest.mark.parametrize("profile", ["paper", "robust"])
def test_grids_of_random_teams_in_many_calls_are_sound_and_repaired_alike(
    tmp_path: Path, profile: str
) -> None:
    rng = np.random.default_rng(5)
    for number in range(6):
        team, settings = random_team(rng)
        settings |= ROBUST if profile == "robust" else {}
        logs = write_logs(tmp_path / f"logs{number}", team)
        grid = tmp_path / f"{number}.possmap"
        for log in logs:
            fuse([log], grid, settings)
        again = tmp_path / f"{number}-again.possmap"
        assert run("verify", str(grid), "--full").exit_code == 0
        assert run("repair", str(grid), "-o", str(again)).exit_code == 0
        assert digest(again) == digest(grid)
