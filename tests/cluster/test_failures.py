"""What goes wrong with a cluster: one clear line, whole logs, and the same command completes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from click.testing import CliRunner, Result
from literal.teams import random_excursion
from teams import digest, write_logs

import possmap
from possmap.cli.main import main
from possmap.errors import MissingExtra, WorkerError
from possmap.fusing import cluster
from possmap.fusing.fuse import fuse
from possmap.grid.ledger import Ledger
from possmap.grid.rows import ExcursionRows
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting

pytest.importorskip("distributed")

from cluster.machines import machines

pytestmark = pytest.mark.thorough

AtExcursion: TypeAlias = Callable[[int, Callable[[], None]], None]
LOGS = 24
SMALL = Request(
    profile="paper",
    overrides={"transaction_records": parse_setting("transaction_records", "150", "")},
)
"""Some ten transactions."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a batch of logs."""
    rng = np.random.default_rng(11)
    made = [
        {"possmap_log": 1, **random_excursion(rng, f"r{number}", "a")} for number in range(LOGS)
    ]
    return write_logs(tmp_path_factory.mktemp("failures") / "logs", made)[0].parent


@pytest.fixture(scope="module")
def expected(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of an undisturbed run by one process."""
    grid = tmp_path_factory.mktemp("undisturbed") / "site.possmap"
    fuse([str(logs)], grid, SMALL)
    return digest(grid)


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


@pytest.fixture
def at_excursion(monkeypatch: pytest.MonkeyPatch) -> AtExcursion:
    """Return what makes something happen when so many excursions were written to the ledger.

    By then workers hold the plans of that transaction's excursions, and nothing was stamped.
    """
    add, count = Ledger.add, 0

    def at(number: int, act: Callable[[], None]) -> None:
        def counting(self: Ledger, rows: ExcursionRows) -> None:
            nonlocal count
            add(self, rows)
            count += 1
            if count == number:
                act()

        monkeypatch.setattr(Ledger, "add", counting)

    return at


def kill(*processes: Any) -> None:
    for process in processes:
        process.kill()
        process.wait()


def whole_logs(grid: Path, logs: Path) -> int:
    """Check that a grid holds whole logs only; return how many."""
    if not grid.exists() or not grid.stat().st_size:
        return 0
    with possmap.open_grid(grid) as opened:
        held = {entry.name: entry.records for entry in opened.ledger.entries()}
        found = {arrival.origin.name for arrival in opened.ledger.came.all()}
    names = sorted(found)
    alone = grid.with_name("alone.possmap")
    fuse(names, alone, SMALL)
    with possmap.open_grid(alone) as opened:
        assert held == {entry.name: entry.records for entry in opened.ledger.entries()}
    assert digest(grid) == digest(alone)
    alone.unlink()
    return len(found)


def test_one_of_two_workers_is_killed_and_the_job_completes(
    logs: Path, expected: str, tmp_path: Path, at_excursion: AtExcursion
) -> None:
    with machines(tmp_path / "m", 2) as found:
        grid = tmp_path / "site.possmap"
        at_excursion(LOGS // 2, lambda: kill(found.workers[0]))
        summary = fuse([str(logs)], grid, SMALL, dask=found.address)
        assert found.workers[0].returncode == -9
    assert summary.count("fused") == LOGS
    assert digest(grid) == expected


def test_all_workers_are_killed_and_the_same_command_completes_the_job(
    logs: Path, expected: str, tmp_path: Path, at_excursion: AtExcursion
) -> None:
    with machines(tmp_path / "m", 2) as found:
        grid = tmp_path / "site.possmap"
        patch = pytest.MonkeyPatch()

        def kill_all() -> None:
            patch.setattr(cluster, "PATIENCE", 2.0)  # not before: workers take time to start
            kill(*found.workers)

        at_excursion(LOGS // 2, kill_all)
        with pytest.raises(WorkerError) as error:
            fuse([str(logs)], grid, SMALL, dask=found.address)
        assert str(error.value) == (
            f"the scheduler at {found.address} has no workers, waited 2 s; the grid holds whole "
            "logs only, and the same command completes the job"
        )
        assert 0 < whole_logs(grid, logs) < LOGS
        patch.undo()
        found.add()
        summary = fuse([str(logs)], grid, SMALL, dask=found.address)
    assert summary.count("known") > 0
    assert digest(grid) == expected


def test_the_scheduler_is_killed_and_the_same_command_completes_the_job(
    logs: Path, expected: str, tmp_path: Path, at_excursion: AtExcursion
) -> None:
    grid = tmp_path / "site.possmap"
    with machines(tmp_path / "m", 1) as found:
        at_excursion(LOGS // 2, lambda: kill(found.scheduler))
        with pytest.raises(WorkerError, match=r"^the connection to .* is lost; .* completes the"):
            fuse([str(logs)], grid, SMALL, dask=found.address)
    assert 0 < whole_logs(grid, logs) < LOGS
    fuse([str(logs)], grid, SMALL)
    assert digest(grid) == expected


def test_a_log_that_kills_every_worker_is_named(logs: Path, expected: str, tmp_path: Path) -> None:
    deadly = tmp_path / "deadly.json"
    deadly.write_text("{}")
    grid = tmp_path / "site.possmap"
    few = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    with machines(tmp_path / "m", **few) as found:
        found.add_faulty("logs", nanny=True)  # which starts it anew each time
        with pytest.raises(WorkerError) as error:
            fuse([str(logs), str(deadly)], grid, SMALL, dask=found.address)
    assert str(error.value) == (
        f"{sorted(logs.iterdir())[0]} or one of {LOGS} after it: 2 workers died of it, "
        "perhaps for want of memory; the grid holds whole logs only, and the same command "
        "completes the job"
    )
    assert whole_logs(grid, logs) == 0
    fuse([str(logs)], grid, SMALL)
    assert digest(grid) == expected


def test_a_log_that_takes_more_memory_than_there_is_is_named(logs: Path, tmp_path: Path) -> None:
    huge, grid = tmp_path / "huge.json", tmp_path / "site.possmap"
    huge.write_text("{}")
    with machines(tmp_path / "m") as found:
        found.add_faulty("logs")
        result = run("fuse", huge, "-g", grid, f"--dask={found.address}")
    assert result.exit_code == 1 and not grid.exists()
    assert result.stderr == (
        f"possmap: {huge}: a worker ran out of memory; the grid holds whole logs only, and the "
        "same command completes the job\n"
    )


@pytest.mark.parametrize(
    ("fault", "problem"),
    [("old", "has possmap 0.0.1, expected "), ("none", "has no possmap: install ")],
)
def test_a_worker_with_another_possmap_or_none_is_named(
    fault: str, problem: str, logs: Path, tmp_path: Path
) -> None:
    with machines(tmp_path / "m") as found:
        found.add_faulty(fault)
        result = run("fuse", logs, "-g", tmp_path / "g.possmap", f"--dask={found.address}")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert result.stderr.startswith("possmap: the worker at tcp://127.0.0.1:")
    assert f"{problem}{possmap.version()}\n" in result.stderr
    assert not (tmp_path / "g.possmap").exists()


def test_a_worker_of_another_version_that_joins_later_stamps_nothing() -> None:
    assert cluster.run(cluster.Task(sum, ((1, 2),), possmap.version())) == 3
    with pytest.raises(WorkerError, match=r"a worker has possmap .*, and this process has 9"):
        cluster.run(cluster.Task(sum, ((1, 2),), "9"))


def test_a_scheduler_that_cannot_be_reached_leaves_the_grid_alone(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 2.0)
    grid = tmp_path / "site.possmap"
    fuse([str(next(logs.iterdir()))], grid)
    before = grid.read_bytes()
    result = run("fuse", logs, "-g", grid, "--dask=tcp://127.0.0.1:9")
    assert result.stderr == (
        "possmap: the scheduler at tcp://127.0.0.1:9 cannot be reached, tried for 2 s; the grid "
        "is as it was\n"
    )
    assert (result.exit_code, grid.read_bytes()) == (1, before)


def test_a_scheduler_without_workers_is_said_to_have_none(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    with machines(tmp_path / "m") as found:
        result = run("fuse", logs, "-g", tmp_path / "g.possmap", f"--dask={found.address}")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "has no workers, waited 2 s" in result.stderr
    assert not (tmp_path / "g.possmap").exists()


def test_where_dask_cannot_start_a_thread_one_line_says_so_at_any_time(
    logs: Path, tmp_path: Path, at_excursion: AtExcursion, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("can't start new thread")  # as Python says it

    grid = tmp_path / "site.possmap"
    with machines(tmp_path / "m", 1) as found:
        at_excursion(LOGS // 2, fail)
        result = run(
            "fuse", logs, "-g", grid, "--set=transaction_records=150", f"--dask={found.address}"
        )
    assert result.exit_code == 1
    assert result.stderr == (
        "possmap: dask cannot start a thread, perhaps for want of memory; the grid holds whole "
        "logs only, and the same command completes the job\n"
    )
    assert 0 < whole_logs(grid, logs) < LOGS
    monkeypatch.setattr("distributed.Client", fail)
    result = run("fuse", logs, "-g", grid, "--dask=local:1")
    assert result.exit_code == 1
    assert result.stderr == (
        "possmap: the cluster on this machine cannot be started: can't start new thread\n"
    )


@pytest.mark.parametrize("port", ["0", "65536", "99999999", "9" * 5000])
def test_a_port_that_is_none_is_wrong_usage(port: str, logs: Path, tmp_path: Path) -> None:
    result = run("fuse", logs, "-g", tmp_path / "g.possmap", f"--dask=tcp://localhost:{port}")
    assert result.exit_code == 2
    assert f"found the port {port[:20]}, expected 1 to 65535" in result.stderr


@pytest.mark.parametrize("address", ["here", "tcp://host", "local:0", "local:x", "tcp://:"])
def test_an_address_that_is_none_is_wrong_usage(address: str, logs: Path, tmp_path: Path) -> None:
    result = run("fuse", logs, "-g", tmp_path / "g.possmap", f"--dask={address}")
    assert result.exit_code == 2
    assert "expected tcp://HOST:PORT, local or local:N" in result.stderr


def test_jobs_and_dask_exclude_each_other(logs: Path, tmp_path: Path) -> None:
    result = run("fuse", logs, "-g", tmp_path / "g.possmap", "--dask=local", "--jobs=2")
    assert result.exit_code == 2
    assert "--dask and --jobs exclude each other" in result.stderr


def test_without_the_extra_the_command_that_brings_it_is_named(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match=r"--dask needs the extra cluster: pip install 'possmap"):
        fuse([str(logs)], tmp_path / "site.possmap", dask="local:1")
    assert not (tmp_path / "site.possmap").exists()
