"""``possmap fuse --jobs``: what one process says and makes, whatever happens to the others."""

from __future__ import annotations

import gzip
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from processes import cpu_seconds, hear_ctrl_c, workers
from teams import digest

from possmap.cli.main import main

pytestmark = pytest.mark.thorough

PEAK = """
import sys
from possmap.cli.main import main
try:
    main(sys.argv[1:])
finally:
    with open("/proc/self/status") as status:
        print(*[int(line.split()[1]) // 1024 for line in status if line.startswith("VmHWM")])
"""

PAPER = ("--profile", "paper")
"""Named, for a process of its own and a module's fixture take no notice of conftest.py."""

linux = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks into /proc")


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], prog_name="possmap")


def log_of(robot: str, records: int) -> dict[str, Any]:
    """Return a drive to and fro with walls on its left."""
    found = []
    for number in range(records // 2):
        x = 5 * (number % 2)
        heading = 180 * (number % 2)
        y = round(number * 0.1, 1)
        found.append({"kind": "pose", "x": x, "y": y, "heading": heading})
        found.append({"kind": "wall", "x": x, "y": y + 0.3, "x2": 5 - x, "y2": y + 0.3})
    numbered = [{"seq": seq, **record} for seq, record in enumerate(found)]
    return {"possmap_log": 1, "robot": robot, "excursion": "1", "records": numbered}


def some(folder: Path, count: int, records: int) -> None:
    folder.mkdir()
    for number in range(count):
        text = json.dumps(log_of(f"r{number}", records))
        (folder / f"{number:02d}.json").write_text(text)


def test_jobs_change_neither_words_nor_grid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    some(Path("logs"), 6, 60)
    whole = json.dumps(log_of("r2", 80))
    Path("logs/02a.json.gz").write_bytes(gzip.compress(whole.encode()))
    Path("logs/03a.json").write_text("{")
    Path("logs/04a.json").write_text(json.dumps(log_of("r9", 40)).replace('"y": 0.1', '"y": 9e9'))
    run("fuse", "logs/05.json", "-g", "other.possmap")
    said = {}
    for jobs in (1, 2, 3):
        grid = f"{jobs}.possmap"
        logs = "logs", "other.possmap", "logs/00.json", "none.json"
        Path("none.json").write_text("")
        result = run("fuse", *logs, "-g", grid, "--jobs", jobs, "--set", "transaction_records=90")
        told = result.stdout.replace(grid, "GRID"), result.stderr, result.exit_code
        said[jobs] = *told, digest(Path(grid))
    assert said[1][2] == 1
    assert said[1][1].count("\n") == 3
    assert said[2] == said[1]
    assert said[3] == said[1]


class Running:
    """A ``fuse --jobs 2`` at work, in a group of processes of its own."""

    def __init__(self, grid: Path, *args: object) -> None:
        command = [sys.executable, "-m", "possmap", "fuse", *map(str, args), "-g", str(grid)]
        command += [*PAPER, "--jobs", "2"]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=hear_ctrl_c,
        )

    def wait_until_at_work(self) -> set[int]:
        """Wait until two processes have worked for a moment, and return them."""
        until = time.monotonic() + 30
        while self.process.poll() is None and time.monotonic() < until:
            children = workers(self.process.pid)
            if len(children) == 2 and all(cpu_seconds(pid) > 0.35 for pid in children):
                return children
            time.sleep(0.01)
        raise AssertionError("the processes do not begin to work")

    def end(self) -> tuple[int, str]:
        """Return exit code and stderr; fail if it hangs."""
        _, told = self.process.communicate(timeout=30)
        return self.process.returncode, told


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return logs, and the digest of what one process makes of them."""
    folder = tmp_path_factory.mktemp("undisturbed")
    some(folder / "logs", 90, 2000)
    assert run("fuse", folder / "logs", "-g", folder / "site.possmap", *PAPER).exit_code == 0
    return folder / "logs", digest(folder / "site.possmap")


@contextmanager
def at_work(logs: Path, grid: Path) -> Iterator[tuple[Running, set[int]]]:
    """Run ``fuse`` on logs, and go on when its processes are at work."""
    running = Running(grid, logs)
    try:
        yield running, running.wait_until_at_work()
    finally:
        if running.process.poll() is None:
            os.killpg(running.process.pid, signal.SIGKILL)
            running.process.communicate()


@linux
def test_a_process_that_dies_while_it_sends_ends_the_run(
    tmp_path: Path, undisturbed: tuple[Path, str]
) -> None:
    logs, whole = undisturbed
    grid = tmp_path / "site.possmap"
    with at_work(logs, grid) as (running, children):
        running.process.send_signal(signal.SIGSTOP)
        time.sleep(1)  # by now both wait for somebody to take what they made
        for child in children:
            os.kill(child, signal.SIGKILL)
        running.process.send_signal(signal.SIGCONT)
        code, told = running.end()
    assert (code, told) == (
        1,
        "possmap: a process of --jobs ended early, perhaps for want of memory; the grid holds "
        "whole logs only, and the same command completes the job\n",
    )
    assert run("fuse", logs, "-g", grid, *PAPER).exit_code == 0
    assert digest(grid) == whole


@linux
@pytest.mark.parametrize(
    ("number", "code", "told"),
    [
        (
            signal.SIGINT,
            1,
            "possmap: stopped; the grid holds whole logs only, and the same command completes "
            "the job\n",
        ),
        (signal.SIGTERM, 143, ""),
        (signal.SIGHUP, 129, ""),
    ],
)
def test_what_the_whole_group_is_told_ends_the_run_once(
    tmp_path: Path, undisturbed: tuple[Path, str], number: signal.Signals, code: int, told: str
) -> None:
    logs, whole = undisturbed
    grid = tmp_path / "site.possmap"
    with at_work(logs, grid) as (running, _):
        os.killpg(running.process.pid, number)
        assert running.end() == (code, told)
        assert workers(running.process.pid) == set()
    assert run("fuse", logs, "-g", grid, *PAPER).exit_code == 0
    assert digest(grid) == whole


@linux
def test_compressed_logs_take_no_more_memory_than_was_given(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in range(40):
        text = json.dumps(log_of(f"r{number}", 4000))
        (logs / f"{number:02d}.json.gz").write_bytes(gzip.compress(text.encode()))
    options = ["-g", str(tmp_path / "g.possmap"), "--jobs", "4", "--memory", "128"]
    done = subprocess.run(
        [sys.executable, "-c", PEAK, "-q", "fuse", str(logs), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert int(done.stdout) <= 128
