"""``possmap fuse --dask`` names files as the user did, though workers open them by whole names."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.teams import random_excursion
from teams import digest

pytest.importorskip("distributed")

from cluster.machines import machines

pytestmark = pytest.mark.thorough


def _write(path: Path, log: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"possmap_log": 1, **log}))


def _inputs(folder: Path) -> list[str]:
    """Write logs of every fate below a folder; return what somebody in it would type."""
    rng = np.random.default_rng(5)
    first, second, third, fourth = (random_excursion(rng, f"r{k}", "a") for k in range(4))
    _write(folder / "in/mix/000.json", first)
    (folder / "in/mix/001.json").write_text('{"possmap_log": 1,\n "robot": 7}')
    *same, last = second["records"]
    other = {**last, "x": last["x"] + 0.001}
    _write(folder / "in/mix/002.json", {**second, "records": [*same, other]})
    _write(folder / "in/mix/003.json", second)  # contradicts the one before
    (folder / "in/mix/004.json").write_bytes(b"\xff")
    (folder / "in/none").mkdir()
    _write(folder / "in/alone.json", third)
    _write(folder / "whole/a.json", fourth)
    header = {"possmap_log": 1, **fourth, "excursion": "b"}
    lines = [{key: header[key] for key in header if key not in ("records", "carried")}]
    text = "\n".join(json.dumps(one) for one in [*lines, *fourth["records"]])
    (folder / "in/cut.jsonl").write_text(text[:-5])
    command = [sys.executable, "-m", "possmap", "fuse", "in/alone.json", "-g", "in/other.possmap"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return [
        "in/mix", "in/other.possmap", "in/none", "./in/alone.json", "in/../in/cut.jsonl",
        str(folder / "whole"),
    ]  # fmt: skip


def _sources(grid: Path) -> list[tuple[Any, ...]]:
    """Return the files from which a grid has something, by name, SHA-256 and size."""
    with sqlite3.connect(grid) as connection:
        found = connection.execute("SELECT name, sha256, size FROM source ORDER BY id").fetchall()
    connection.close()
    return found


@contextmanager
def _cluster(where: str, folder: Path) -> Iterator[str]:
    if where == "here":
        yield "local:2"
        return
    with machines(folder / "m", 1) as found:  # its folder is not the user's
        yield found.address


@pytest.mark.parametrize("where", ["here", "elsewhere"])
def test_logs_are_named_as_with_jobs_on_both_outputs_and_in_the_ledger(
    where: str, tmp_path: Path
) -> None:
    names = _inputs(tmp_path)
    told: list[tuple[Any, ...]] = []
    kept = []
    with _cluster(where, tmp_path) as address:
        for way in ("--jobs=1", f"--dask={address}"):
            grid = tmp_path / "site.possmap"
            command = [sys.executable, "-m", "possmap", "-v", "fuse", *names, "-g", grid.name]
            done = subprocess.run(
                [*command, way, "--json", "--allow-truncated"],
                cwd=tmp_path, capture_output=True, text=True, check=False,
            )  # fmt: skip
            answer = json.loads(done.stdout)
            del answer["seconds"]
            kept.append((digest(grid), _sources(grid)))
            grid.unlink()
            plain = subprocess.run(
                [*command, way, "--dry-run"],
                cwd=tmp_path, capture_output=True, text=True, check=False,
            )  # fmt: skip
            told.append(
                (answer, done.returncode, done.stderr, plain.returncode, plain.stdout, plain.stderr)
            )
    assert told[1] == told[0]
    assert kept[1] == kept[0]
    logs = {log["path"]: log for log in told[0][0]["logs"]}
    assert logs["in/mix/000.json"]["status"] == "fused"
    assert logs["in/mix/001.json"]["error"].startswith("in/mix/001.json:")
    assert "in/mix/002.json" in logs["in/mix/003.json"]["error"]
    assert "in/../in/cut.jsonl" in told[0][2]
    assert [log["status"] for log in logs.values()].count("refused") == 4
