"""``possmap fuse --dask``: a real scheduler and real workers come to the digest of one process."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from literal.teams import random_excursion
from teams import ROBUST, digest, flat_settings, write_logs

import possmap
from possmap.cli.main import main

pytest.importorskip("distributed")

from cluster.machines import Machines, machines

pytestmark = pytest.mark.thorough

LOGS = 36
SMALL: Mapping[str, Any] = {"transaction_records": 150, "max_error": 0.8}
PROFILES = {"paper": SMALL, "robust": {**ROBUST, **SMALL}}


def run(*args: object, stdin: bytes | None = None) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], input=stdin, catch_exceptions=False)


def fuse(logs: object, grid: Path, settings: Mapping[str, Any], *options: str) -> Result:
    flat = flat_settings(settings).items()
    given = [f"--set={name}={json.dumps(value).strip(chr(34))}" for name, value in flat]
    return run("fuse", logs, "-g", grid, *given, *options)


@pytest.fixture(scope="module")
def troupe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the logs of a troupe, each with beginnings of others' that it was handed."""
    rng = np.random.default_rng(8)
    alone = [random_excursion(rng, f"r{number}", "a") for number in range(LOGS)]
    logs = []
    for log in alone:
        others = [alone[k] for k in rng.choice(LOGS, size=3, replace=False)]
        carried = [
            {**one, "records": one["records"][: int(rng.integers(len(one["records"]) + 1))]}
            for one in others
            if one is not log
        ]
        logs.append({**log, "carried": carried})
    return write_logs(tmp_path_factory.mktemp("troupe") / "logs", logs)[0].parent


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    """Run a scheduler with two workers."""
    with machines(tmp_path_factory.mktemp("two") / "m", 2) as found:
        yield found


@pytest.mark.parametrize("profile", PROFILES)
def test_a_cluster_comes_to_the_digest_of_one_process(
    profile: str, troupe: Path, two: Machines, tmp_path: Path
) -> None:
    here, there = tmp_path / "here.possmap", tmp_path / "there.possmap"
    alone = fuse(troupe, here, PROFILES[profile], "--json")
    result = fuse(troupe, there, PROFILES[profile], "--json", f"--dask={two.address}")
    assert (result.exit_code, result.stderr) == (0, "")
    logs, expected = (json.loads(one.stdout)["logs"] for one in (result, alone))
    assert logs == expected
    assert digest(there) == digest(here)
    assert _ledger(there) == _ledger(here)


def _ledger(grid: Path) -> list[list[tuple[Any, ...]]]:
    """Return all that the ledger holds, but the times of arrival."""
    with sqlite3.connect(grid) as connection:
        tables = ("record", "excursion", "touched", "arrival")
        found = [
            connection.execute(f"SELECT * FROM {one} ORDER BY 1, 2, 3").fetchall() for one in tables
        ]
    connection.close()
    return found


@pytest.mark.parametrize("independence", ["detection", "excursion"])
def test_what_the_grid_knows_already_is_added_to(
    independence: str, troupe: Path, two: Machines, tmp_path: Path
) -> None:
    settings = {**SMALL, "independence": independence}
    begun = tmp_path / "begun"
    begun.mkdir()
    for path in sorted(troupe.iterdir())[::2]:
        log = json.loads(path.read_text())
        log["records"] = log["records"][: len(log["records"]) // 2]
        (begun / path.name).write_text(json.dumps({**log, "carried": []}))
    here, there = tmp_path / "here.possmap", tmp_path / "there.possmap"
    fuse(troupe, here, settings)
    assert fuse(begun, there, settings).exit_code == 0
    before = digest(there)
    assert fuse(troupe, there, settings, f"--dask={two.address}").exit_code == 0
    assert before != digest(there) == digest(here)
    again = there.read_bytes()
    result = fuse(troupe, there, settings, f"--dask={two.address}")
    assert (result.exit_code, there.read_bytes()) == (0, again)


def test_stdin_and_grids_are_read_by_the_committer_and_files_by_relative_names(
    troupe: Path, two: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = sorted(troupe.iterdir())
    here, there, other = (tmp_path / f"{name}.possmap" for name in ("here", "there", "other"))
    fuse(troupe, here, {})
    run("fuse", *paths[:5], "-g", other)
    lines = b""
    for path in paths[5:9]:
        log = json.loads(path.read_text())
        header = {key: log[key] for key in log if key not in ("records", "carried")}
        lines += b"".join(json.dumps(one).encode() + b"\n" for one in [header, *log["records"]])
    monkeypatch.chdir(troupe)
    names = [path.name for path in paths[9:]]
    dask = f"--dask={two.address}"
    result = run("fuse", other, "-", *names, *paths[5:9], "-g", there, dask, stdin=lines)
    assert (result.exit_code, result.stderr) == (0, "")
    assert digest(there) == digest(here)


def test_a_refused_log_changes_nothing_and_a_dry_run_writes_nothing(
    troupe: Path, two: Machines, tmp_path: Path
) -> None:
    bad, here, there = (tmp_path / name for name in ("bad.json", "a.possmap", "b.possmap"))
    bad.write_text("[]")
    paths = sorted(troupe.iterdir())[:4]
    run("fuse", *paths, "-g", here)
    dry = run("fuse", *paths, "-g", there, "--dry-run", f"--dask={two.address}")
    assert dry.exit_code == 0 and not there.exists()
    result = run("fuse", paths[0], bad, *paths[1:], "-g", there, f"--dask={two.address}")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert result.stderr.startswith(f"possmap: {bad}:1: ")
    assert digest(there) == digest(here)
    strict = tmp_path / "strict.possmap"
    result = run("fuse", *paths, bad, "-g", strict, "--strict", f"--dask={two.address}")
    assert result.exit_code == 1 and not strict.exists()


def test_workers_read_urls_and_a_folder_at_one(troupe: Path, two: Machines, tmp_path: Path) -> None:
    here, there = tmp_path / "here.possmap", tmp_path / "there.possmap"
    fuse(troupe, here, {})
    first, *others = [f"file://{path}" for path in sorted(troupe.iterdir())[:3]]
    gone = f"file://{tmp_path}/gone.json"
    result = run(
        "fuse", first, gone, *others, f"file://{troupe}", "-g", there, f"--dask={two.address}"
    )
    assert result.stderr == f"possmap: {gone}: cannot be read: No such file or directory\n"
    assert result.exit_code == 1
    assert digest(there) == digest(here)
    with possmap.open_grid(there) as grid:
        assert next(grid.ledger.came.all()).origin.name == first


def test_a_damaged_tile_is_named_and_the_grid_stays(
    troupe: Path, two: Machines, tmp_path: Path
) -> None:
    grid = tmp_path / "site.possmap"
    first, *others = sorted(troupe.iterdir())
    run("fuse", first, "-g", grid)
    with sqlite3.connect(grid) as connection:
        connection.execute("UPDATE cells SET data = x'02ff'")
    connection.close()
    before = grid.read_bytes()
    result = run("fuse", *others, "-g", grid, f"--dask={two.address}")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert result.stderr.startswith(f"possmap: {grid}: damaged: tile ")
    assert grid.read_bytes() == before


def test_local_starts_workers_itself_and_says_nothing_of_them(troupe: Path, tmp_path: Path) -> None:
    here, there = tmp_path / "here.possmap", tmp_path / "there.possmap"
    fuse(troupe, here, {}, "--profile=paper")
    command = [sys.executable, "-m", "possmap", "fuse", str(troupe), "-g", str(there)]
    command += ["--profile=paper", "--dask=local:1"]
    environment = {**os.environ, "PYTHONWARNINGS": "default"}
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert (done.returncode, done.stderr.decode()) == (0, "")
    assert digest(there) == digest(here)
