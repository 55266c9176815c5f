"""Make the example recording anew: one robot goes twice around a ring of corridors.

``python data/recordings/recipe.py [OUTDIR]`` writes hall.log, hall.csv and hall-truth.csv to OUTDIR
(default: the folder of this file). Same bytes on every run. The robot's wheels are unequal: it
turns 1.5° to the left per metre more than it knows, and its turns are 2 % larger. Nobody told it.
"""

import csv
import io
import math
import sys
from pathlib import Path

import numpy as np

SEED = 2026
STEP_S = 0.2
SPEED = 0.4  # [m/s]
TURN_RATE = math.radians(60)  # [rad/s]
DRIFT = math.radians(1.5)  # turn to the left that the wheels do not tell [rad/m]
TURN_GAIN = 0.02  # over-turn that they do not tell, as a share
SLIP = 0.01, math.radians(0.1)  # deviations per step: of the way, as a share; of the heading [rad]
READINGS = 61  # of the laser, 3 degrees apart
NOISE_M = 0.01
FAR_M = 81.0  # what the laser says where it sees nothing
TRACK_M, TICK_M, WRAP = 0.25, 0.0005, 65536

# The ring: outside, inside, a recess in the north wall, and a door in the south.
WALLS = [
    (0, 0, 4, 0), (5, 0, 12, 0), (12, 0, 12, 8), (12, 8, 7, 8), (7, 8, 7, 8.8), (7, 8.8, 5.5, 8.8),
    (5.5, 8.8, 5.5, 8), (5.5, 8, 0, 8), (0, 8, 0, 0),
    (1.6, 1.6, 10.4, 1.6), (10.4, 1.6, 10.4, 6.4), (10.4, 6.4, 1.6, 6.4), (1.6, 6.4, 1.6, 1.6),
]  # fmt: skip
GOALS = [(11.2, 0.8), (11.2, 7.2), (0.8, 7.2), (0.8, 0.8)] * 2


def seen(x: float, y: float, angle: float) -> float:
    """Return how far it is to the nearest wall [m]; FAR_M if there is none."""
    cos, sin = math.cos(angle), math.sin(angle)
    nearest = FAR_M
    for x0, y0, x1, y1 in WALLS:
        dx, dy = x1 - x0, y1 - y0
        cross = cos * dy - sin * dx
        if abs(cross) > 1e-12:
            along = ((x0 - x) * dy - (y0 - y) * dx) / cross
            share = ((x0 - x) * sin - (y0 - y) * cos) / cross
            if along > 0 and 0 <= share <= 1:
                nearest = min(nearest, along)
    return nearest


def drive(rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Return t, true pose, believed pose, and ticks of both wheels, of each step."""
    true = [0.8, 0.8, 0.0]
    believed = [0.8, 0.8, 0.0]
    ticks = [65000.0, 65000.0]
    rows: list[tuple[float, ...]] = []
    t = 0.0
    for goal_x, goal_y in GOALS:
        while True:
            rows.append((t, *true, *believed, *ticks))
            t += STEP_S
            away = math.hypot(goal_x - true[0], goal_y - true[1])
            if away < 0.1:
                break
            # It sees where the goal is: what it does is sensible, what it believes is not.
            off = math.atan2(goal_y - true[1], goal_x - true[0]) - true[2]
            off = math.remainder(off, 2 * math.pi)
            turn = max(-TURN_RATE * STEP_S, min(TURN_RATE * STEP_S, off))
            way = SPEED * STEP_S if abs(off) < math.radians(20) else 0.0
            real_way = way * (1 + SLIP[0] * rng.standard_normal())
            slip = SLIP[1] * rng.standard_normal() * bool(way)
            told = (turn - DRIFT * way - slip) / (1 + TURN_GAIN)
            for pose, moved, turned in ((true, real_way, turn), (believed, way, told)):
                pose[0] += moved * math.cos(pose[2] + turned / 2)
                pose[1] += moved * math.sin(pose[2] + turned / 2)
                pose[2] += turned
            ticks[0] += (way - told * TRACK_M / 2) / TICK_M
            ticks[1] += (way + told * TRACK_M / 2) / TICK_M
    return rows


def main(folder: Path) -> None:
    """Write the files."""
    rng = np.random.default_rng(SEED)
    rows = drive(rng)
    angles = [math.radians(-90 + 3 * index) for index in range(READINGS)]
    log = ["# A simulated robot's CARMEN log; data/recordings/recipe.py makes it."]
    table = io.StringIO()
    out = csv.writer(table, lineterminator="\n")
    out.writerow(["ms", "left", "right", "range_right_mm", "range_ahead_mm", "range_left_mm"])
    truth = ["t,x,y,yaw"]
    for number, (t, x, y, yaw, bx, by, byaw, left, right) in enumerate(rows):
        truth.append(f"{t:.1f},{x:.4f},{y:.4f},{yaw:.5f}")
        ranges = [seen(x, y, yaw + angle) for angle in angles]
        noisy = [r if r == FAR_M else r + NOISE_M * rng.standard_normal() for r in ranges]
        pose = f"{bx:.4f} {by:.4f} {byaw:.5f}"
        if number % 2 == 0:  # the laser is slower than the wheels
            words = " ".join(f"{value:.2f}" for value in noisy)
            log.append(f"FLASER {READINGS} {words} {pose} {pose} {t:.1f} hall {t:.1f}")
        else:
            log.append(f"ODOM {pose} 0 0 0 {t:.1f} hall {t:.1f}")
        short = [-1 if noisy[k] > 4 else round(1000 * noisy[k]) for k in (0, READINGS // 2, -1)]
        out.writerow([round(1000 * t), round(left) % WRAP, round(right) % WRAP, *short])
    (folder / "hall.log").write_text("\n".join(log) + "\n")
    (folder / "hall.csv").write_text(table.getvalue())
    (folder / "hall-truth.csv").write_text("\n".join(truth) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
