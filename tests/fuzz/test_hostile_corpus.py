"""Hostile files through their readers: one clear line, in time, within bounds of memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz.corpus import CASES
from fuzz.making import Case

pytestmark = pytest.mark.thorough

TESTS = Path(__file__).parents[1]
SECONDS = 30.0
"""Of CPU time, for any of them; the slowest take a few."""
MOST_MIB = 1280.0
"""Of memory, as docs/trust.md has it."""
MEMORY_MIB = 3072
"""Of address space, which is more than what is used: what goes beyond harms no other process."""


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what.replace(" ", "-"))
def test_a_hostile_file_is_refused_in_one_line_in_time_and_within_bounds(
    tmp_path: Path, case: Case
) -> None:
    path = case.write(tmp_path)
    command = [sys.executable, "-W", "error", "-m", "fuzz.readers", case.reader, str(path)]
    # The tests are found as here, and so is possmap, installed or not.
    found = os.pathsep.join([str(TESTS), *filter(None, sys.path)])
    done = subprocess.run(
        [*command, str(MEMORY_MIB), str(case.limit_mib)],
        capture_output=True,
        text=True,
        timeout=4 * SECONDS,
        env={**os.environ, "PYTHONPATH": found},
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    outcome = json.loads(done.stdout)
    if case.told is None:
        assert outcome["told"] is None
    else:
        assert outcome["told"].endswith(case.told)
        assert outcome["told"].isprintable()
        assert outcome["told"].startswith(("stdin:", "/dev/", str(path)))
    assert outcome["seconds"] < SECONDS
    assert outcome["mib"] < MOST_MIB
