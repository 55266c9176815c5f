"""``possmap fuse --memory``: what does not fit is refused, and results do not depend on it."""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from teams import digest

from possmap.cli.main import main

RSS = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "possmap", *sys.argv[1:]])
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)
sys.exit(done.returncode)
"""


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], prog_name="possmap")


def lawn(records: int, robot: str = "mower") -> dict[str, Any]:
    """Return lanes of steps of 5 cm."""
    poses = []
    for number in range(records):
        lane, step = divmod(number, 500)
        x = (step if lane % 2 == 0 else 499 - step) * 0.05
        heading = 0 if lane % 2 == 0 else 180
        poses.append(
            {"seq": number, "kind": "pose", "x": round(x, 2), "y": lane / 4, "heading": heading}
        )
    model = {"along": 1e-4, "across": 1e-4, "turn_spread": 0}
    return {"possmap_log": 1, "robot": robot, "excursion": "1", "model": model, "records": poses}


def test_a_log_that_would_not_fit_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("large.json").write_text(json.dumps(lawn(32_000)))
    Path("small.json").write_text(json.dumps(lawn(10)))
    size = Path("large.json").stat().st_size
    needed = 56 + -(-size * 40 >> 20)
    result = run("fuse", "large.json", "small.json", "-g", "site.possmap", "--memory", 128)
    assert result.stderr == (
        f"possmap: large.json: a log of {size / 2**20:.1f} MiB needs --memory {needed}, found 128\n"
    )
    assert result.stdout.startswith(
        "site.possmap: fused 1 log (10 new records), 0 known, 1 refused"
    )
    assert result.exit_code == 1
    enough = run("fuse", "large.json", "-g", "a.possmap", "--memory", needed, "--dry-run")
    assert enough.exit_code == 0


def test_a_compressed_log_is_measured_by_what_it_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("large.json.gz").write_bytes(gzip.compress(json.dumps(lawn(32_000)).encode()))
    result = run("fuse", "large.json.gz", "-g", "site.possmap", "--memory", 128)
    assert result.stderr == (
        "possmap: large.json.gz: larger than 1.8 MiB, decompressed (--memory 128)\n"
    )
    assert not Path("site.possmap").exists()


def test_strict_refuses_more_than_it_can_hold_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("possmap.budget._RECORD_BYTES", 10**6)
    for number in range(9):
        Path(f"{number}.json").write_text(json.dumps(lawn(10, f"r{number}")))
    logs = [f"{number}.json" for number in range(9)]
    result = run("fuse", *logs, "-g", "site.possmap", "--strict", "--memory", 128)
    assert result.stderr == (
        "possmap: --strict keeps all logs in memory: 80 records need --memory 133, found 128\n"
    )
    assert (result.exit_code, Path("site.possmap").exists()) == (1, False)
    assert run("fuse", *logs, "-g", "site.possmap", "--memory", 128).exit_code == 0


@pytest.mark.thorough
def test_with_little_memory_the_digest_is_the_same_and_the_bound_holds(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in range(6):
        (logs / f"{number}.json").write_text(json.dumps(lawn(6_000, f"r{number}")))
    grids = [tmp_path / "little.possmap", tmp_path / "much.possmap"]
    for grid, memory in zip(grids, (128, 4096), strict=True):
        command = ["-q", "fuse", str(logs), "-g", str(grid), "--memory", str(memory)]
        done = subprocess.run(
            [sys.executable, "-c", RSS, *command], check=True, capture_output=True, text=True
        )
        assert int(done.stdout) <= memory
    assert digest(grids[0]) == digest(grids[1])
