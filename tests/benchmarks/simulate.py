"""What driving a troupe costs: robot-steps a second, how time grows with robots, memory, ir-sim.

A step is one robot out for 0.1 s. Ten robots with five infrared sensors in an office of 60 x 60 m;
ir-sim, where it is installed (``pip install ir-sim``), drives ten in the same walls, each with a
lidar of 8 beams, in the same run and without drawing; then also in an empty hall as large.

    python tests/benchmarks/simulate.py [--runs 3] [--minutes 5]
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np

from possmap.lab.simulate.floor_plan import sides
from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.mission_file import read_mission
from possmap.lab.simulate.world import World
from possmap.settings.shipped import shipped

OFFICE = shipped("missions/large-office.yaml")
BEAMS, ROBOTS = 8, 10


def drive(robots: int, minutes: float, seed: int, exchange: bool) -> tuple[float, int, int]:
    """Return the seconds that the first minutes take, the robot-steps in them and the meetings."""
    plan = read_mission(OFFICE, {})
    # Large errors allowed, so that all stay out and the rows compare.
    settings = replace(
        plan.settings, robots=robots, minutes=30.0, seed=seed, exchange=exchange, max_error=1e6
    )
    start = time.perf_counter()
    mission = Mission(plan.world, settings)
    for now in mission:
        if now >= 60 * minutes:
            break
    return time.perf_counter() - start, mission.steps, len(mission.meetings)


def table(runs: int, minutes: float) -> float:
    """Print how time grows with the robots; return the steps a second of ten that exchange."""
    of_ten = 0.0
    say(f"The first {minutes:g} minutes of robots that set out from one place in 60 x 60 m:")
    say(f"{'robots':>8}{'exchange':>10}{'seconds':>10}{'steps':>10}{'steps/s':>10}{'meetings':>10}")
    for robots, exchange in product((1, 3, 10, 30, 100), (True, False)):
        results = [drive(robots, minutes, seed, exchange) for seed in range(1, runs + 1)]
        seconds = sum(one[0] for one in results)
        steps = sum(one[1] for one in results)
        meetings = statistics.mean(one[2] for one in results)
        exchanges = "yes" if exchange else "no"
        say(
            f"{robots:>8}{exchanges:>10}{seconds / runs:>10.2f}{steps // runs:>10}"
            f"{steps / seconds:>10.0f}{meetings:>10.0f}"
        )
        if (robots, exchange) == (ROBOTS, True):
            of_ten = steps / seconds
    return of_ten


def irsim_world(world: World) -> str:
    """Return a scene of ir-sim: the same walls, and ten robots near home, each with a lidar."""
    x0, y0, x1, y1 = world.bounds
    rng = np.random.default_rng(1)
    robots = []
    while len(robots) < ROBOTS:
        x, y = rng.uniform((x0 + 1, y0 + 1), (x1 - 1, y1 - 1))
        if world.clearance(x, y) > 0.5:
            robots.append(
                f"  - {{kinematics: {{name: diff}}, shape: {{name: circle, radius: 0.13}}, "
                f"state: [{x:.2f}, {y:.2f}, 0], goal: [{x1 / 2}, {y1 / 2}, 0], "
                "behavior: {name: dash}, sensors: [{name: lidar2d, range_min: 0, range_max: 0.5, "
                f"angle_range: 3.14, number: {BEAMS}, noise: false}}]}}"
            )
    walls = [
        f"  - {{shape: {{name: linestring, vertices: [[{x}, {y}], [{x2}, {y2}]]}}, "
        "unobstructed: false}"
        for x, y, x2, y2 in world.walls.tolist()
    ]
    head = f"world: {{width: {x1}, height: {y1}, step_time: 0.1, collision_mode: stop}}"
    return "\n".join([head, "robot:", *robots, "obstacle:", *walls, ""])


def irsim_steps_a_second(world: World, rounds: int) -> float:
    """Return what ir-sim does with the like scene."""
    import irsim

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "office.yaml"
        path.write_text(irsim_world(world))
        env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
        env.step()
        start = time.perf_counter()
        for _ in range(rounds):
            env.step()
        seconds = time.perf_counter() - start
        env.end()
    return rounds * ROBOTS / seconds


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=5.0)
    asked = parser.parse_args()
    of_ten = table(asked.runs, asked.minutes)
    if find_spec("irsim"):
        office = read_mission(OFFICE, {}).world
        x0, y0, x1, y1 = office.bounds
        hall = replace(office, walls=np.array(sides((x0, y0, x1, y1))))
        for name, world, rounds in (("the office", office, 40), ("an empty hall", hall, 400)):
            theirs = irsim_steps_a_second(world, rounds)
            say(
                f"ir-sim, {ROBOTS} robots with {BEAMS} beams in {name}, {len(world.walls)} walls: "
                f"{theirs:.0f} steps/s; possmap in the office: {of_ten / theirs:.1f} times as many"
            )
    else:
        say("ir-sim is not installed here (pip install ir-sim): not compared")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-m", "possmap", "-q", "simulate", str(OFFICE), "-o", str(out)]
        start = time.perf_counter()
        subprocess.run(command, check=True)
        seconds = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    say(f"possmap simulate large-office.yaml, whole process: {seconds:.1f} s, {memory:.0f} MiB")


if __name__ == "__main__":
    main()
