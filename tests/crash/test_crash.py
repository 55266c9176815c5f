"""Whatever goes wrong, a grid holds whole logs only, and the same command completes the job.

The short version of ``tests/crash/run.py``. Nothing here depends on what a random moment happens
to hit: the least that must be hit is asserted only of kills, faults and cuts that are counted out.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import pytest

Figures: TypeAlias = Mapping[str, Any]

RUN = Path(__file__).with_name("run.py")
PARTS = ("kills", "faults", "cuts", "weaker", "waits", "rounds")

pytestmark = [
    pytest.mark.skipif(
        not sys.platform.startswith("linux") or shutil.which("cc") is None,
        reason="needs Linux and a C compiler",
    ),
    pytest.mark.thorough,
]


def survived(*options: str, **asked: int) -> Figures:
    """Try some parts, and return their figures; fail if anything did not hold."""
    counts = [f"--{part}={asked.get(part, 0)}" for part in PARTS]
    command = [sys.executable, str(RUN), "--json", *counts, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.stderr
    found: Figures = json.loads(done.stdout)
    broken = [line for part in found.values() for line in part["broken"]]
    assert not broken
    assert done.returncode == 0
    return found


def test_killed_anywhere_a_grid_holds_whole_logs_only_and_the_same_command_completes() -> None:
    found = survived("--small", kills=40)
    assert sum(part["tried"] for part in found.values()) >= 32
    for part in ("kills before statements", "kills at calls"):
        assert found[part]["counts"]["inside a transaction"] > 0
    assert found["kills at calls"]["counts"]["in a commit"] > 0
    assert found["kills at calls"]["counts"]["killed, in the middle of a write"] > 0


def test_a_disk_that_fails_costs_one_clear_line_and_never_part_of_a_log() -> None:
    found = survived("--small", faults=40)
    assert found["calls that fail"]["tried"] >= 32
    assert found["calls that fail"]["counts"]["refused in one line, exit code 1"] > 16
    assert found["limits on file sizes"]["counts"]["refused in one line, exit code 1"] == 4


def test_a_power_cut_undoes_only_what_was_not_reported() -> None:
    found = survived("--small", cuts=30)
    assert found["power cuts"]["counts"]["some logs there"] > 0


def test_the_same_power_cuts_would_undo_more_if_less_was_asked_of_the_disk() -> None:
    counts = survived("--small", weaker=120)["power cuts, less promised"]["counts"]
    assert counts["synchronous FULL: sound, without logs that were reported"] > 0
    assert counts["synchronous OFF: damaged, and verify says so"] > 0
    assert counts["EXTRA, and a disk that lies: damaged, and verify says so"] > 0


def test_who_waits_for_another_process_says_so_and_gives_up_in_the_end() -> None:
    assert survived("--small", waits=1)["processes that wait"]["tried"] == 9


def test_many_writers_at_once_lose_nothing_and_readers_read_on() -> None:
    counts = survived("--small", rounds=1)["several writers"]["counts"]
    assert counts["writers done"] + counts.get("writers killed", 0) == 2 * (2 + 4 + 8)
    assert counts["readers"] > 0


@pytest.mark.slow
def test_a_thousand_kills_and_all_the_rest() -> None:
    found = survived(kills=1000, faults=240, cuts=300, weaker=300, waits=1, rounds=2)
    assert sum(part["tried"] for name, part in found.items() if "kills" in name) >= 800
