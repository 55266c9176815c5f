"""Broken robots: logs of honest ones, told again as odometry with a fault would have told them.

What truly happened stays as it was; only what the robot believes changes, run by run and turn by
turn, and with it everything that it saw on the way.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

Log: TypeAlias = dict[str, Any]
Run: TypeAlias = Callable[[int], tuple[float, float]]
"""Number of a run -> logged over true length, and degrees that it bends to the left per metre."""
Turn: TypeAlias = Callable[[int, float], float]
"""Number of a turn, and its degrees -> the degrees that are logged."""


def _sound_run(number: int) -> tuple[float, float]:
    return 1.0, 0.0


def _sound_turn(number: int, degrees: float) -> float:
    return degrees


def retold(
    log: Log,
    run: Run = _sound_run,
    turn: Turn = _sound_turn,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Log:
    """Return a log with other runs and turns.

    start : where its first pose is logged, less where it was [m, m, deg].
    """
    records: list[dict[str, Any]] = []
    waiting: list[dict[str, Any]] = []
    last: dict[str, Any] | None = None
    x = y = 0.0
    off = start[2]
    runs = turns = 0
    for record in log["records"]:
        if record["kind"] != "pose":
            waiting.append(record)
            continue
        if last is None:
            x, y = record["x"] + start[0], record["y"] + start[1]
            records += waiting
        else:
            step = record["x"] - last["x"], record["y"] - last["y"]
            length = math.hypot(*step)
            scale, bend = run(runs) if length else (1.0, 0.0)
            runs += length > 0
            moved = off + bend * length / 2
            records += [_seen(one, last, step, scale, moved, (x, y)) for one in waiting]
            dx, dy = _turned(*step, moved)
            x, y, off = x + scale * dx, y + scale * dy, off + bend * length
            degrees = math.remainder(record["heading"] - last["heading"], 360)
            if degrees:
                off += turn(turns, degrees) - degrees
                turns += 1
        heading = round((record["heading"] + off) % 360, 3)
        records.append({**record, "x": round(x, 4), "y": round(y, 4), "heading": heading})
        last, waiting = record, []
    return {**log, "records": records + waiting}


def _turned(x: float, y: float, degrees: float) -> tuple[float, float]:
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return cos * x - sin * y, sin * x + cos * y


def _seen(
    record: Mapping[str, Any],
    last: Mapping[str, Any],
    step: tuple[float, float],
    scale: float,
    off: float,
    begin: tuple[float, float],
) -> dict[str, Any]:
    """Move what was seen during a run with it; how far off the path it lay is measured truly."""
    moved = dict(record)
    length = math.hypot(*step)
    for name_x, name_y in (("x", "y"), ("x2", "y2")):
        if name_x not in record:
            continue
        dx, dy = record[name_x] - last["x"], record[name_y] - last["y"]
        if length:
            along = (dx * step[0] + dy * step[1]) / length
            more = (scale - 1) * min(length, max(0.0, along)) / length
            dx, dy = dx + more * step[0], dy + more * step[1]
        dx, dy = _turned(dx, dy, off)
        moved[name_x], moved[name_y] = round(begin[0] + dx, 4), round(begin[1] + dy, 4)
    return moved


def luck(log: Log) -> np.random.Generator:
    """Return random numbers of an excursion's own, the same at each call."""
    return np.random.default_rng(zlib.crc32(f"{log['robot']} {log['excursion']}".encode()))


def turns_wrong(log: Log) -> Log:
    """Log 5° too much to the left in every turn of 45°."""
    return retold(log, turn=lambda number, degrees: degrees + abs(degrees) / 9)


def scale_wrong(log: Log) -> Log:
    """Log 15 % too much of every metre."""
    return retold(log, run=lambda number: (1.15, 0.0))


def turn_lost(log: Log) -> Log:
    """Miss one turn of more than 40°, from the fourth to the fifteenth on."""
    first = int(luck(log).integers(4, 16))
    lost: list[int] = []

    def turn(number: int, degrees: float) -> float:
        if number >= first and abs(degrees) > 40 and not lost:
            lost.append(number)
            return 0.0
        return degrees

    return retold(log, turn=turn)


def encoder_stuck(log: Log) -> Log:
    """Count only half on one wheel, from the fifth to the 24th run on."""
    first = int(luck(log).integers(5, 25))
    return retold(log, run=lambda number: (0.75, 20.0) if number >= first else (1.0, 0.0))


def start_moved(log: Log) -> Log:
    """Start 1 m from where it believes to be."""
    angle = luck(log).uniform(0, 2 * math.pi)
    return retold(log, start=(math.cos(angle), math.sin(angle), 0.0))


def start_turned(log: Log) -> Log:
    """Start 20° off, to either side."""
    return retold(log, start=(0.0, 0.0, float(luck(log).choice([-20, 20]))))


FAULTS: Mapping[str, Callable[[Log], Log]] = {
    "turns 5° per 45° wrong": turns_wrong,
    "lengths 15 % wrong": scale_wrong,
    "one turn lost": turn_lost,
    "one encoder counts half": encoder_stuck,
    "starts 1 m off": start_moved,
    "starts 20° off": start_turned,
}
