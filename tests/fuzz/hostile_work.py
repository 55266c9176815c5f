"""Small logs that ask for much work: what a record says is laid down cell by cell."""

from __future__ import annotations

from collections.abc import Callable

from fuzz.hostile_logs import HEAD, POSE
from fuzz.making import Case, text


def certain(*records: str, error: float = 0) -> Callable[[], bytes]:
    """Return what makes a log whose half-widths never grow, and may be almost anything [m]."""
    head = HEAD.strip()[:-1] + ', "model": {"max_error": 10000, "along": 0, "across": 0}}\n'
    first = POSE.strip()[:-1] + f', "error_x": {error}, "error_y": {error}}}\n'
    return text(head, first, "\n".join(records), "\n")


def pose(seq: int, x: float, y: float) -> str:
    """Return a line of a pose."""
    return f'{{"seq": {seq}, "kind": "pose", "x": {x}, "y": {y}, "heading": 0}}'


def wall(seq: int, x2: float, y2: float) -> str:
    """Return a line of a wall from the origin."""
    return f'{{"seq": {seq}, "kind": "wall", "x": 0, "y": 0, "x2": {x2}, "y2": {y2}}}'


WORK: tuple[Case, ...] = (
    Case(
        "a run of 2800 stamps of 5600 by 5600 cells",
        "fuse",
        "a.jsonl",
        certain(pose(1, 140, 140), error=140),
        "expected at most 5e+10 (setting limit_record_cells)",
    ),
    Case(
        "120 runs of 200 m, 120 m wide",
        "fuse",
        "a.jsonl",
        certain(*(pose(n, 200 * (n % 2), 0) for n in range(1, 121)), error=60),
        "expected at most 5e+10 (setting limit_record_cells)",
    ),
    Case(
        "200 runs of 200 m, 40 m wide",
        "fuse",
        "a.jsonl",
        certain(*(pose(n, 200 * (n % 2), 0) for n in range(1, 201)), error=20),
        "expected at most 5e+10 (setting limit_record_cells)",
    ),
    Case(
        "a wall through 38,000 tiles",
        "fuse",
        "a.jsonl",
        certain(wall(1, 490_000, 490_000), pose(2, 1, 0)),
        "expected at most 5e+10 (setting limit_record_cells)",
    ),
    Case(
        "2000 walls of 20 km from one place",
        "fuse",
        "a.jsonl",
        certain(*(wall(n, 20_000, n) for n in range(1, 2001)), pose(2001, 1, 0)),
        "expected at most 3e+11 (setting limit_file_cells)",
    ),
)
