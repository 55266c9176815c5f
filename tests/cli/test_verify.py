"""``possmap verify`` and ``possmap repair``: damage is named, and the ledger saves what it can."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from forging import forge
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


def test_a_sound_grid_is_called_sound_with_its_digest(site: Path) -> None:
    result = run("verify", "site.possmap")
    assert (result.stderr, result.exit_code) == ("", 0)
    assert result.stdout.splitlines() == [
        "site.possmap: sound: 5 excursions, 4 tiles, 4 of them fused again",
        f"digest {digest(site)}",
    ]


FORGOTTEN = "'r9', NULL, NULL, NULL, 1, 1, '2026-11-25T19:19:55+00:00', '0.1.0'"

DAMAGE = {
    "a byte of a tile": (
        "UPDATE cells SET data = CAST(x'02' || substr(data, 2) AS BLOB) WHERE tile = 1",
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
        "DELETE FROM arrival WHERE excursion = 1",
        "excursion a of robot r2: nothing says what brought record 0",
    ),
    "half a carrier": (
        "UPDATE arrival SET carrier_robot = 'r9' WHERE id = 1",
        f"excursion a of robot r2: source number 1, {DATA}/01-r2-a.json: not as possmap writes it",
    ),
    "a carrier without a sound name": (
        "UPDATE arrival SET carrier_robot = 'r 9', carrier_excursion = 'a' WHERE id = 1",
        f"excursion a of robot r2: source number 1, {DATA}/01-r2-a.json: not as possmap writes it",
    ),
    "a count that is a text": (
        "UPDATE arrival SET records = 'many' WHERE id = 1",
        "SQLite: non-INTEGER value in arrival.records",
    ),
    "a SHA-256": (
        "UPDATE source SET sha256 = 'zz' WHERE id = 1",
        f"excursion a of robot r2: source number 1, {DATA}/01-r2-a.json: not as possmap writes it",
    ),
    "a time": (
        "UPDATE source SET fused_at = 'garbage' WHERE id = 1",
        f"excursion a of robot r2: source number 1, {DATA}/01-r2-a.json: not as possmap writes it",
    ),
    "a file that brought nothing": (
        "INSERT INTO source SELECT 500, name, sha256, size, fused_at, version FROM source LIMIT 1",
        "1 rows of table source belong to nothing",
    ),
    "keys of a log": (
        "UPDATE excursion SET extra = '{{{' WHERE id = 1",
        'excursion a of robot r2: found "{{{", expected an object of x_ keys',
    ),
    "keys of a record": (
        "UPDATE record SET extra = '{\"x\": 1}' WHERE excursion = 1 AND number = 3",
        'excursion a of robot r2: records[3]: found "{\\"x\\": 1}", expected an object of x_ keys',
    ),
    "a setting that shapes evidence": (
        "UPDATE setting SET value = '0.02' WHERE name = 'along'",
        "excursion a of robot r2: fused with along 0.010416666666666666, but the grid's setting "
        "is 0.02",
    ),
    "a setting of a call": (
        "INSERT INTO setting VALUES ('limit_nesting', '40')",
        "setting limit_nesting: no grid keeps it",
    ),
    "a setting that is gone": (
        "DELETE FROM setting WHERE name = 'along'",
        "damaged: setting along is missing",
    ),
    "an own model": (
        "UPDATE excursion SET own_model = '{\"turn_bias\": 1.5}' WHERE id = 1",
        "excursion a of robot r2: fused with turn_bias 0.0, but its own model says 1.5",
    ),
    "an own model that is none": (
        "UPDATE excursion SET own_model = '[1]' WHERE id = 1",
        "excursion a of robot r2: damaged: excursion a of robot r2: ",
    ),
    "a tile touched by nobody": (
        "INSERT INTO touched VALUES (5000, 5000, 777, 1)",
        "a row of table touched belongs to a row of excursion that is not there",
    ),
    "a tile touched by a record beyond the last": (
        "INSERT INTO touched VALUES (0, 0, 1, 100000)",
        "1 rows of table touched belong to nothing",
    ),
    "a layer": (
        "INSERT INTO tile SELECT 999, 7, 9000, 0, 0, 1, 0, 1, hash FROM tile LIMIT 1;"
        "INSERT INTO cells VALUES (999, x'02')",
        "1 rows of table tile belong to nothing",
    ),
    "a robot without a name that was forgotten": (
        f"INSERT INTO forgotten VALUES (8, {FORGOTTEN}); UPDATE forgotten SET robot = ''",
        "robot  was forgotten: not as possmap writes it",
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
    forge(site, sql)
    result = run("verify", "site.possmap", "--full")
    assert (result.stdout, result.exit_code) == ("", 1)
    faults = [line.removeprefix("possmap: site.possmap: ") for line in result.stderr.splitlines()]
    assert any(one.startswith(fault) for one in faults), faults


@pytest.mark.parametrize("kind", ["a byte of a tile", "a tile that is gone", "a place on the map"])
def test_what_the_ledger_knows_is_brought_back(site: Path, sound: Path, kind: str) -> None:
    forge(site, DAMAGE[kind][0])
    assert run("repair", "site.possmap", "-o", "new.possmap").exit_code == 0
    assert digest(Path("new.possmap")) == digest(sound)
    assert run("verify", "new.possmap", "--full").exit_code == 0


def test_a_lost_excursion_is_named_and_the_others_are_saved(site: Path) -> None:
    forge(site, DAMAGE["a record that was moved"][0])
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


CURED = {
    "a setting of a call": 5,
    "a tile touched by nobody": 5,
    "a file that brought nothing": 5,
    "a layer": 5,
    "a SHA-256": 3,  # of a file that brought two
    "half a carrier": 4,
    "keys of a record": 4,
}


@pytest.mark.parametrize("kind", CURED)
def test_what_is_repaired_is_sound_and_what_is_in_doubt_is_left_out(site: Path, kind: str) -> None:
    forge(site, DAMAGE[kind][0])
    result = run("repair", "site.possmap", "-o", "new.possmap", "--json")
    assert result.exit_code == int(CURED[kind] < 5)
    assert json.loads(result.stdout)["excursions"] == CURED[kind]
    assert run("verify", "new.possmap", "--full").exit_code == 0


def test_a_setting_that_contradicts_the_ledger_is_kept_and_told(site: Path) -> None:
    forge(site, DAMAGE["a setting that shapes evidence"][0])
    result = run("repair", "site.possmap", "-o", "new.possmap", "--json")
    assert result.stderr.splitlines()[0] == (
        "possmap: site.possmap: lost: in doubt, and kept: excursion a of robot r2: fused with "
        "along 0.010416666666666666, but the grid's setting is 0.02"
    )
    assert (json.loads(result.stdout)["excursions"], result.exit_code) == (5, 1)


@pytest.mark.parametrize("accept", ["true", "false"])
def test_models_of_logs_and_of_changing_robots_are_sound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, accept: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for number, own in enumerate(({}, {"along": 0.02}, {"sensor": 0})):
        log = {"possmap_log": 1, "robot": "r1", "excursion": f"e{number}", "model": own}
        log["records"] = [
            {"seq": seq, "kind": "pose", "x": seq, "y": number, "heading": 0} for seq in (0, 1)
        ]
        Path("log.json").write_text(json.dumps(log))
        settings = ("--set", f"accept_models={accept}", "--set", f"robots.r1.across={0.1 + number}")
        assert run("fuse", "log.json", "-g", "site.possmap", *settings).exit_code == 0
    result = run("verify", "site.possmap", "--full")
    assert (result.stderr, result.exit_code) == ("", 0)
    forge(Path("site.possmap"), "UPDATE setting SET value = 'false' WHERE name = 'accept_models'")
    assert run("verify", "site.possmap").exit_code == int(accept == "true")


def test_a_grid_is_sound_after_something_was_forgotten(site: Path) -> None:
    for what in (("--robot", "r3"), ("--brought-by", "04-r1-b.json")):
        assert run("forget", "site.possmap", *what).exit_code == 0
        result = run("verify", "site.possmap", "--full")
        assert (result.stderr, result.exit_code) == ("", 0)


@pytest.mark.parametrize("end", ["-journal", "-wal", "-shm"])
def test_what_sqlite_left_beside_the_output_is_never_mixed_in(site: Path, end: str) -> None:
    left = Path(f"new.possmap{end}")
    left.write_bytes(b"of another")
    result = run("repair", "site.possmap", "-o", "new.possmap")
    assert result.stderr == (
        f"possmap: {left}: belongs to a writer that was interrupted, or still writes; remove it "
        "if the grid that it belonged to may go\n"
    )
    assert (left.read_bytes(), Path("new.possmap").exists()) == (b"of another", False)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no such files here")
def test_a_pipe_is_not_replaced_by_a_grid(site: Path) -> None:
    os.mkfifo("pipe")
    result = run("repair", "site.possmap", "-o", "pipe", "--overwrite")
    assert result.stderr == "possmap: pipe: not a regular file, expected one or none\n"
    assert Path("pipe").is_fifo()


def test_a_long_name_is_shortened(site: Path) -> None:
    forge(site, "UPDATE excursion SET robot = printf('%.*c', 100000, 'x') WHERE id = 1")
    for command in (("verify", "site.possmap"), ("repair", "site.possmap", "-o", "new.possmap")):
        assert max(map(len, run(*command).stderr.splitlines())) < 400


def test_more_tiles_than_a_sample_are_fused_again_only_with_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("possmap.grid.verify.SAMPLE", 2)
    assert run("fuse", str(DATA), "-g", "site.possmap").exit_code == 0
    some = json.loads(run("verify", "site.possmap", "--json").stdout)
    everything = json.loads(run("verify", "site.possmap", "--full", "--json").stdout)
    assert (some["fused_again"], everything["fused_again"]) == (2, 4)


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
