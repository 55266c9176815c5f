"""What a troupe brings: team size, exchange of maps and behaviours, over many seeds.

Drives the shipped mission figure8 with each team, fuses what comes home, and holds the map against
the true walls. Prints tables for docs/troupe.md: medians and the middle half of the seeds.

    python tests/benchmarks/troupe_study.py [--seeds 20] [--jobs 2]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import possmap
from possmap.lab.simulate.run import simulate

MISSION = Path(__file__).parents[2] / "configs" / "missions" / "figure8.yaml"
RESOLUTION = 0.1
NEAR_M = 0.3
"""A cell of the map is right if a true wall is so near, a piece of wall found if such a cell is."""


@dataclass(frozen=True)
class Team:
    """A row of a table."""

    robots: int
    exchange: bool = True
    behaviours: str = ""

    def overrides(self, seed: int) -> dict[str, str]:
        """Return the mission's values that this team changes."""
        given = {
            "seed": str(seed),
            "robots": str(self.robots),
            "exchange": str(self.exchange).lower(),
        }
        return given | ({"behaviours": self.behaviours} if self.behaviours else {})


SIZES = [Team(robots, exchange) for robots in (1, 2, 3, 6, 12) for exchange in (True, False)]
TEMPERS = [
    Team(6),
    *(
        Team(6, behaviours=f"[{temper}-left, {temper}-right]")
        for temper in ("anxious", "normal", "routine")
    ),
    Team(6, behaviours="[normal-left]"),
]

HEAD = (
    "robots", "behaviours", "exchange", "excursions", "home", "relayed", "explored", "found",
    "right",
)  # fmt: skip

Row = dict[str, float]


def one(team: Team, seed: int) -> Row:
    """Drive, fuse and judge one mission."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        summary = simulate(MISSION, folder, team.overrides(seed))
        row: Row = {
            "excursions": len(summary.excursions),
            "home": summary.home / len(summary.excursions),
            "relayed": summary.records_known_of_lost,
            "explored": summary.explored,
            "found": 0.0,
            "right": float("nan"),
        }
        if summary.home:
            grid = Path(name) / "site.possmap"
            possmap.fuse(folder / "logs", grid, {"resolution": RESOLUTION})
            walls = np.array(json.loads((folder / "truth.json").read_text())["walls"])
            row["found"], row["right"] = judged(grid, walls)
        return row


def judged(grid: Path, walls: np.ndarray) -> tuple[float, float]:
    """Return the share of true wall that the map holds likely, and of likely cells, the right."""
    with possmap.open_grid(grid) as opened:
        window = opened.window
        assert window is not None
        likely = np.argwhere(
            (opened.necessity() >= 0.5) & (opened.necessity() <= opened.possibility())
        )
    if not len(likely):
        return 0.0, float("nan")
    cells = (likely[:, ::-1] + (window.column0, window.row0) + 0.5) * RESOLUTION
    points = np.concatenate([along(wall) for wall in walls])
    apart = np.hypot(*(cells[:, None] - points[None]).transpose(2, 0, 1))
    return float((apart.min(axis=0) <= NEAR_M).mean()), float((apart.min(axis=1) <= NEAR_M).mean())


def along(wall: np.ndarray) -> np.ndarray:
    steps = max(1, round(float(np.abs(wall[2:] - wall[:2]).max()) / RESOLUTION))
    return wall[:2] + np.linspace(0, 1, steps + 1)[:, None] * (wall[2:] - wall[:2])


def table(teams: list[Team], rows: dict[Team, list[Row]]) -> Iterator[str]:
    yield f"| {' | '.join(HEAD)} |"
    yield f"|{' --- |' * len(HEAD)}"
    for team in teams:
        words = team.behaviours.strip("[]") or "mixed"
        cells = [str(team.robots), words, "yes" if team.exchange else "no"]
        for key, scale, unit in (
            ("excursions", 1, ""), ("home", 100, " %"), ("relayed", 1, ""),
            ("explored", 100, " %"), ("found", 100, " %"), ("right", 100, " %"),
        ):  # fmt: skip
            values = [row[key] * scale for row in rows[team] if row[key] == row[key]]
            low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
            cells.append(f"{middle:.0f}{unit} ({low:.0f}–{high:.0f})")
        yield f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    teams = list(dict.fromkeys([*SIZES, *TEMPERS]))
    with ProcessPoolExecutor(asked.jobs) as pool:
        waiting = {
            team: [pool.submit(one, team, seed) for seed in range(asked.seeds)] for team in teams
        }
        rows = {team: [done.result() for done in futures] for team, futures in waiting.items()}
    for lines in (table(SIZES, rows), table(TEMPERS, rows)):
        sys.stdout.write("\n".join(lines) + "\n\n")


if __name__ == "__main__":
    main()
