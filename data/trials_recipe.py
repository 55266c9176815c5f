"""Make the example trials anew: three robots of the paper's, 80 trials each, as in its §3.

``python data/trials_recipe.py [OUT.csv]`` writes ``trials.csv`` (default: beside this file). Same
bytes on every run. Each robot is put on a line, asked to run 10 or 20 feet, or to turn 45 degrees
to a side and then to run 10 feet, 20 times each; where it ends is measured to the millimetre and to
a tenth of a degree. What is wrong with each robot stands in ROBOTS.
"""

import csv
import math
import sys
from pathlib import Path

import numpy as np

SEED = 1998
TIMES = 20
FEET = 0.3048  # [m]
FACTOR = 2.236  # standard deviations in a half-width
ALONG, ACROSS = 1.25 / 120, 5.5 / 120  # half-widths per metre run: the paper's rectangle
TURN_NOISE = 0.3 * FACTOR  # half-width of what changes from turn to turn, for 45 deg [deg]
ROBOTS = {  # over-turn to the left per 45 deg [deg], drift to the left [deg/m], true over asked way
    "r1": (2.1, 0.0, 1.0),
    "r2": (-1.7, 0.4, 1.0),
    "r3": (2.3, 0.0, 0.985),
}
MANOEUVRES = {  # turn [deg], then run [m]
    "straight-10ft": (0, 10 * FEET),
    "straight-20ft": (0, 20 * FEET),
    "left-10ft": (45, 10 * FEET),
    "right-10ft": (-45, 10 * FEET),
}


def trial(robot: str, turn: float, distance: float, rng: np.random.Generator) -> list[float]:
    """Return the end's error along and across [m], and in heading [deg]."""
    bias, drift, scale = ROBOTS[robot]
    stretch, kick, noise = rng.standard_normal(3) / FACTOR
    over = bias * abs(turn) / 45 + TURN_NOISE * math.sqrt(abs(turn) / 45) * noise
    heading = over + math.degrees(ACROSS) * kick
    half = math.radians(drift * distance / 2)
    length = distance * scale * (1 + ALONG * stretch) * (math.sin(half) / half if half else 1)
    way = math.radians(heading) + half
    return [
        round(length * math.cos(way) - distance, 3) + 0.0,
        round(length * math.sin(way), 3) + 0.0,
        round(heading + drift * distance, 1) + 0.0,
    ]


def main() -> None:
    """Write the example trials."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("trials.csv")
    rng = np.random.default_rng(SEED)
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(["robot", "manoeuvre", "distance", "turn", "along", "across", "heading"])
        for robot in ROBOTS:
            for name, (turn, distance) in MANOEUVRES.items():
                for _ in range(TIMES):
                    errors = trial(robot, turn, distance, rng)
                    table.writerow([robot, name, round(distance, 4), turn, *errors])


if __name__ == "__main__":
    main()
