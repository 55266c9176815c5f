"""Logs that benchmarks share: *the km*, and a large square that is known everywhere."""

from __future__ import annotations

import random
from typing import Any

MODEL = {"along": 0.001, "across": 0.001, "turn_spread": 0}
TURNS = ((1, 0, 0), (0, 1, 90), (-1, 0, 180), (0, -1, -90))
RECORDS, METRES, SIDE = 600, 1000.0, 60.0


def the_km(seed: int = 0) -> dict[str, Any]:
    """Return the log: 255 runs with a turn before each, walls beside 90 of them."""
    rng = random.Random(seed)
    records: list[dict[str, Any]] = []

    def add(kind: str, **fields: float | bool) -> None:
        records.append({"seq": len(records), "kind": kind, **fields})

    runs = 255
    walls = RECORDS - 1 - 2 * runs
    beside = set(rng.sample(range(runs), walls))
    length = METRES / runs
    x, y, last = SIDE / 2, SIDE / 2, -1
    add("pose", x=x, y=y, heading=0.0)
    for run in range(runs):
        while True:
            turn = rng.randrange(4)
            dx, dy, heading = TURNS[turn]
            to_x, to_y = x + dx * length, y + dy * length
            if turn != last and 2 < to_x < SIDE - 2 and 2 < to_y < SIDE - 2:
                break
        last = turn
        add("pose", x=round(x, 4), y=round(y, 4), heading=heading)
        if run in beside:
            side_x, side_y = -0.3 * dy, 0.3 * dx
            add(
                "wall",
                x=round(x + side_x, 4),
                y=round(y + side_y, 4),
                x2=round(to_x + side_x, 4),
                y2=round(to_y + side_y, 4),
                followed=False,
            )
        x, y = to_x, to_y
        add("pose", x=round(x, 4), y=round(y, 4), heading=heading)
    return {"possmap_log": 1, "robot": "km", "excursion": "1", "model": MODEL, "records": records}


def known_square(side_m: float = 200.0) -> dict[str, Any]:
    """Return a log that makes 4000 × 4000 cells of 5 cm known: a lawn mower with a wide error."""
    model = {"along": 0, "across": 0, "turn_spread": 0, "max_error": 2.0}
    records: list[dict[str, Any]] = []
    lane = 0
    while lane * 1.5 <= side_m:
        ends = (0.0, side_m) if lane % 2 == 0 else (side_m, 0.0)
        for x in ends:
            records.append(
                {"seq": len(records), "kind": "pose", "x": x, "y": lane * 1.5, "heading": 0}
            )
        lane += 1
    records[0] |= {"error_x": 1.0, "error_y": 1.0}
    return {
        "possmap_log": 1,
        "robot": "mower",
        "excursion": "1",
        "model": model,
        "records": records,
    }
