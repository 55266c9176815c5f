"""Helpers of the tests of METHOD §3: versions of one straight run, and what fusing them says."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

from literal.teams import Log
from teams import digest, fuse, write_logs

from possmap.fusing.fuse import FuseSummary

SETTINGS = {"resolution": 0.1}


def log_of(robot: str, records: int = 6, **keys: Any) -> Log:
    """Return a log of a straight run past a wall: pose, wall, pose, wall and so on."""
    found = []
    for seq in range(records):
        x = seq / 2
        if seq % 2:
            place = {"x": x - 0.5, "y": 0.33, "x2": x + 0.5, "y2": 0.33}
            found.append({"seq": seq, "kind": "wall", **place})
        else:
            found.append({"seq": seq, "kind": "pose", "x": x, "y": 0.0, "heading": 0.0})
    return {"possmap_log": 1, "robot": robot, "excursion": "a", **keys, "records": found}


def prefix(log: Log, count: int) -> Log:
    """Return the version that ends after ``count`` records."""
    return {**log, "records": log["records"][:count]}


def changed(log: Log, number: int, **fields: object) -> Log:
    """Return a copy with one record changed."""
    log = copy.deepcopy(log)
    log["records"][number].update(fields)
    return log


def written(folder: Path, **logs: Log) -> list[Path]:
    """Write logs under their names, in the order given."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{name}.json" for name in logs]
    for path, log in zip(paths, logs.values(), strict=True):
        path.write_text(json.dumps(log))
    return paths


def outcomes(summary: FuseSummary) -> list[tuple[str, int, int]]:
    """Return what became of each log: status, records new and known."""
    return [(log.status, log.records_new, log.records_known) for log in summary.logs]


def errors(summary: FuseSummary, folder: Path) -> list[str]:
    """Return why logs were refused, without the folder in their names."""
    return [log.error.replace(f"{folder}/", "") for log in summary.logs if log.error]


def fused_digest(folder: Path, *logs: Log, settings: dict[str, Any] = SETTINGS) -> str:
    """Return the digest of a grid of these logs alone."""
    number = len(list(folder.glob("alone*.possmap")))
    grid = folder / f"alone{number}.possmap"
    fuse(write_logs(folder / f"alone{number}", logs), grid, settings)
    return digest(grid)


WHOLE = log_of("r1")
HINT = "another outing needs another excursion name"


def way_in(grid: str = "site.possmap") -> str:
    """Return how a conflict's message ends that says how to let the other log in."""
    return (
        f"{HINT}; if the other version is false, possmap forget {grid} --robot r1 --excursion a "
        "--once makes room for this one"
    )
