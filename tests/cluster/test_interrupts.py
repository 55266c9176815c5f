"""Ctrl-C, which goes to all processes of a terminal's group: one line, and nobody stays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from literal.teams import random_excursion
from processes import hear_ctrl_c, members, workers
from teams import digest, write_logs

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc"),
    pytest.mark.thorough,
]

PATIENCE = 60.0
"""Seconds in which anything should happen."""

STOPPED = (
    "possmap: stopped; the grid holds whole logs only, and the same command completes the job\n"
)


def _await(condition: Callable[[], object], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)


def _first_worker(process: subprocess.Popen[str], grid: Path) -> None:
    _await(lambda: workers(process.pid), process)


def _both_workers_a_little_later(process: subprocess.Popen[str], grid: Path) -> None:
    _await(lambda: len(workers(process.pid)) == 2, process)
    time.sleep(0.5)  # they import what they need


def _work(process: subprocess.Popen[str], grid: Path) -> None:
    _await(lambda: grid.exists() and grid.stat().st_size, process)


def _a_worker_is_replaced(process: subprocess.Popen[str], grid: Path) -> None:
    _work(process, grid)
    before = workers(process.pid)
    os.kill(min(before), signal.SIGKILL)
    _await(lambda: workers(process.pid) - before, process)
    time.sleep(0.1)


@pytest.mark.parametrize(
    "moment", [_first_worker, _both_workers_a_little_later, _work, _a_worker_is_replaced]
)
def test_an_interrupted_local_cluster_ends_with_one_line_and_leaves_no_process(
    moment: Callable[[subprocess.Popen[str], Path], None], tmp_path: Path
) -> None:
    rng = np.random.default_rng(3)
    made = [{"possmap_log": 1, **random_excursion(rng, f"r{k}", "a")} for k in range(24)]
    logs = write_logs(tmp_path / "logs", made)[0].parent
    grid = tmp_path / "site.possmap"
    command = [
        sys.executable, "-m", "possmap", "fuse", str(logs), "--set=transaction_records=50", "-g",
    ]  # fmt: skip
    process = subprocess.Popen(
        [*command, str(grid), "--dask=local:2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=hear_ctrl_c,
    )
    try:
        moment(process, grid)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (1, "", STOPPED)
    end = time.monotonic() + PATIENCE
    while members(process.pid) and time.monotonic() < end:
        time.sleep(0.05)  # Python's keeper of semaphores ends once it sees that it is alone
    assert members(process.pid) == {}
    whole = tmp_path / "whole.possmap"
    for one in (grid, whole):
        subprocess.run([*command, str(one)], check=True, capture_output=True)
    assert digest(grid) == digest(whole)
