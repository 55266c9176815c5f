"""What it is worth to know where robots ended: tracks, walls and maps with fixes and without.

Drives teams through the worlds of quality.py; whoever collects a robot knows where it is to some
half-width, or does not look. The same missions are fused under `robust` with each, and held against
the truth. Prints, as Markdown, the table of docs/quality.md: means over missions.

    python tests/benchmarks/fixes.py [--seeds 3] [--worlds maze ...] [--uncalibrated]
        [--half-widths 0.05 0.2 0.5]

Real legs: python tests/benchmarks/real_robots.py --only intel --fix 0.1
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import TextIO

from quality import PLANS, TUNED, WORLDS, World, drive, request
from refining import tracks_of

from possmap.fusing.fuse import fuse
from possmap.lab.evaluate.run import Question, evaluate
from possmap.settings.limits import Limits
from possmap.truth.truth import Truth, read_truth

DRIVEN = 0.05
"""Half-width with which missions are driven; the others are the same errors, scaled [m]."""
COLUMNS = ("coverage", "half-width [m]", "rms [m]", "F1 15 cm", "F1 5 cm", "surprising")


def with_fixes(folder: Path, truth: Truth, half: float) -> Path:
    """Return a folder of the same logs, with fixes of another half-width; 0: without any."""
    found = folder.with_name(f"logs-{half:g}")
    found.mkdir()
    for path in sorted(folder.glob("*.json")):
        log = json.loads(path.read_text())
        for version in (log, *log.get("carried", [])):  # who meets it at home carries its fix
            end = truth.tracks[version["robot"], version["excursion"]][-1, 1:3].tolist()
            for fix in (one for one in version["records"] if one["kind"] == "fix"):
                for name, true in zip(("x", "y"), end, strict=True):
                    fix[name] = true + (fix[name] - true) * half / DRIVEN
                    fix[f"error_{name}"] = half
            if not half:
                version["records"] = [one for one in version["records"] if one["kind"] != "fix"]
        (found / path.name).write_text(json.dumps(log))
    return found


def one_mission(
    world: World, calibrated: bool, halves: Sequence[float], seed: int
) -> dict[float, tuple[float, ...]]:
    """Return the columns for each half-width; empty if nobody came home."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        told = {"seed": str(seed), "calibrated": str(calibrated).lower()}
        if not drive(world, folder, {**told, "dock_error": str(DRIVEN)}):
            return {}
        truth = read_truth(folder / "truth.json", Limits())
        found = {}
        for half in halves:
            grid = Path(name) / f"{half:g}.possmap"
            logs = with_fixes(folder / "logs", truth, half)
            summary = fuse([str(logs)], grid, request("robust", "walls", dict(world.settings)))
            assert not summary.count("refused"), summary.logs
            tracks = tracks_of(grid, truth)
            scores = evaluate(grid, folder / "truth.json", Question(baselines=TUNED))
            possmap = scores.methods["possmap"]
            surprising = sum(one.observations.surprising for one in summary.reach.values())
            found[half] = (
                tracks.coverage, tracks.half, tracks.rms,
                possmap.f1_15cm or 0.0, possmap.f1_5cm or 0.0, surprising / len(summary.reach),
            )  # fmt: skip
        return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--worlds", nargs="*", default=[])
    parser.add_argument("--uncalibrated", action="store_true")
    parser.add_argument("--half-widths", nargs="*", type=float, default=[0.05, 0.2, 0.5])
    options = parser.parse_args()
    halves = [0.0, *options.half_widths]
    missions: list[dict[float, tuple[float, ...]]] = []
    for world in WORLDS:
        wanted = not options.worlds or any(one in world.name for one in options.worlds)
        if wanted and not (world.plan and not (PLANS / world.plan).exists()):
            for seed in range(1, options.seeds + 1):
                one = one_mission(world, not options.uncalibrated, halves, seed)
                missions += [one] if one else []
                say(f"{world.name}, seed {seed}: " + ", ".join(
                    f"{half:g}: {told[0]:.3f} {told[1]:.3f} {told[2]:.3f}"
                    for half, told in one.items()
                ), sys.stderr)  # fmt: skip
    say(f"{len(missions)} missions", sys.stdout)
    say(f"\n| fix | {' | '.join(COLUMNS)} |\n|{' --- |' * (len(COLUMNS) + 1)}", sys.stdout)
    for half in halves:
        columns = zip(*(one[half] for one in missions), strict=True)
        name = f"±{half:g} m" if half else "none"
        say(f"| {name} | {' | '.join(f'{mean(column):.3f}' for column in columns)} |", sys.stdout)


def say(line: str, stream: TextIO) -> None:
    """Print a line at once."""
    stream.write(line + "\n")
    stream.flush()


if __name__ == "__main__":
    main()
