"""The km, log file to map file, by possmap and by other mappers: whole processes, in turn.

    python tests/benchmarks/peers.py [--runs 7] [--reach 0.5] [--eager]

Every tool gets the same track and the same walls, in cells of 5 cm:

- possmap gets its log of 600 records: ends of runs, walls as segments. A second log has one at each
  pose and hit that the peers get, which is not how its robots write. As its default profile has it,
  runs past walls say nothing of their way: it finds less of the way than the peers.
- The peers get what a range finder at the robot's left says at a pose every 5 cm, as text in
  CARMEN's format: one beam a pose, or 61 over 180°. A beam hits the wall beside its run, or is free
  to its reach. All get the same file.
- OctoMap: ``peer_tools/octomap_driver.py``, with pyoctomap, if it is installed. ``--eager`` adds
  rows for insertions that are not lazy, pyoctomap's default.
- MRPT: ``carmen2simplemap``, then ``observations2map``, if they are installed (Debian: mrpt-apps).
  It writes a picture of the map beside it, and cannot be told not to.
- Log-odds: ``peer_tools/log_odds_driver.py``, Bresenham's lines in numpy.

The peers compute no error, take the poses as true and keep no record of what they were told;
possmap spreads each record over its error, writes a ledger and syncs the file to disk.

Every map is read back: it must be as large as the track, and show the way free and the walls
occupied. Ratios are medians of the ratios of wall times within one round. Nothing asserts a time.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from peer_tools.carmen import write_scans
from peer_tools.sightings import MISS, beam_step, scans_of, with_every_sighting
from peer_tools.verdicts import (
    Verdict,
    judge,
    read_log_odds,
    read_mrpt,
    read_octomap,
    read_possmap,
)
from tracks import the_km

DRIVERS = Path(__file__).parent / "peer_tools"
MRPT = "carmen2simplemap", "observations2map"
MRPT_MAP = """[MappingApplication]
occupancyGrid_count=1
pointsMap_count=0
[MappingApplication_occupancyGrid_00_creationOpts]
resolution=0.05
[MappingApplication_occupancyGrid_00_insertOpts]
maxDistanceInsertion={reach}
"""
BEAMS = {1: "one ray a pose", 61: "61 rays a pose"}


Command = Sequence[str | Path]


class Tool(NamedTuple):
    """A way from a log to a map: commands to run one after the other, and how to read the map."""

    name: str
    commands: Sequence[Command]
    target: Path
    read: Callable[[Path], Verdict]


class Cost(NamedTuple):
    """What the processes of one map took [s]; cpu is user and system time."""

    wall: float
    cpu: float


def possmap_tools(folder: Path) -> list[Tool]:
    """Return possmap on its own log of the km, and on one of single sightings."""
    logs = {"possmap": the_km(), "possmap, a record a sighting": with_every_sighting(the_km())}
    tools = []
    for number, (name, log) in enumerate(logs.items()):
        path = folder / f"km-{number}.json"
        path.write_text(json.dumps(log))
        target = folder / f"possmap-{number}" / "km.possmap"
        command: Command = [sys.executable, "-m", "possmap", "-q", "fuse", path, "-g", target]
        tools.append(Tool(name, [command], target, read_possmap))
    return tools


def peer_tools(folder: Path, reach: float, eager: bool) -> list[Tool]:
    """Return the peers that are installed, with logs of one beam and of many."""
    tools = []
    settings = folder / "mrpt.ini"
    settings.write_text(MRPT_MAP.format(reach=reach))
    for beams, rays in BEAMS.items():
        log = folder / f"km-{beams}.log"
        write_scans(log, scans_of(the_km(), beams, reach), beam_step(beams), 2 * MISS * reach)

        def driver(name: str, target: Path, *more: str, log: Path = log) -> Command:
            return [sys.executable, DRIVERS / name, log, target, str(reach), *more]

        if all(map(shutil.which, MRPT)):
            target = folder / f"mrpt-{beams}" / "km_gridmap_no00.gridmap"
            scans, prefix = target.with_name("km.simplemap"), target.with_name("km")
            convert: Command = [MRPT[0], "-q", "-w", "-z", "0", "-i", log, "-o", scans]
            build: Command = [MRPT[1], settings, scans, prefix]
            tools.append(Tool(f"MRPT, {rays}", [convert, build], target, read_mrpt))
        if importlib.util.find_spec("pyoctomap"):
            for kind in ("", "eager") if eager else ("",):
                target = folder / f"octomap-{beams}{kind}" / "km.bt"
                command = driver("octomap_driver.py", target, *kind.split())
                name = f"OctoMap, {rays}{', eager' * bool(kind)}"
                tools.append(Tool(name, [command], target, read_octomap))
        target = folder / f"log-odds-{beams}" / "km.npz"
        command = driver("log_odds_driver.py", target)
        tools.append(Tool(f"log-odds, {rays}", [command], target, read_log_odds))
    return tools


def run(tool: Tool) -> Cost:
    """Make the map from nothing."""
    shutil.rmtree(tool.target.parent, ignore_errors=True)
    tool.target.parent.mkdir()
    cpu = 0.0
    start = time.perf_counter()
    for command in tool.commands:
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(command, stdin=quiet, stdout=quiet)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{tool.name}: {command[0]} ended with {process.returncode}")
        cpu += used.ru_utime + used.ru_stime
    return Cost(time.perf_counter() - start, cpu)


def table(tools: Sequence[Tool], costs: Sequence[Sequence[Cost]]) -> list[str]:
    """Return the lines of the table; ``costs`` holds one of each tool in each round."""
    bases = [k for k, tool in enumerate(tools) if tool.name == "possmap" or BEAMS[1] in tool.name]
    bases = [k for k in bases if "eager" not in tools[k].name]
    heads = [f"× {tools[k].name.split(',')[0]}" for k in bases]
    columns = ["tool", "wall", "CPU", *heads, "map", "way", "walls", "file"]
    lines = [f"| {' | '.join(columns)} |", f"|{' --- |' * len(columns)}"]
    log = the_km()
    for k, tool in enumerate(tools):
        try:
            score = judge(tool.read(tool.target), log)
        except (ValueError, OSError) as problem:
            raise SystemExit(f"{tool.name}: {problem}") from problem
        ratios = [
            statistics.median(row[k].wall / row[base].wall for row in costs) for base in bases
        ]
        fields = [
            tool.name,
            *(f"{statistics.median(row[k][kind] for row in costs):.3f} s" for kind in (0, 1)),
            *(f"{ratio:.2f}" for ratio in ratios),
            f"{score.width:.1f} × {score.height:.1f} m",
            f"{score.way:.1%}",
            f"{score.walls:.1%}",
            f"{tool.target.stat().st_size / 1024:.0f} KiB",
        ]
        lines.append(f"| {' | '.join(fields)} |")
    return lines


def versions() -> str:
    """Return what was compared, on one line."""
    found = [f"Python {sys.version.split()[0]}"]
    for package in ("possmap", "numpy", "pyoctomap"):
        try:
            found.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            found.append(f"no {package}: rows left out")
    if all(map(shutil.which, MRPT)):
        told = subprocess.run([MRPT[0], "--version"], capture_output=True, text=True).stdout.split()
        found.append(f"MRPT {told[-1]}")
    else:
        found.append("no mrpt-apps: rows left out")
    return ", ".join(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=7, help="rounds, after one that is not counted")
    parser.add_argument("--reach", type=float, default=0.5, help="of beams [m]")
    parser.add_argument("--eager", action="store_true", help="OctoMap also without lazy insertions")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tools = [*possmap_tools(folder), *peer_tools(folder, options.reach, options.eager)]
        for tool in tools:
            run(tool)
        costs = [[run(tool) for tool in tools] for _ in range(options.runs)]
        sys.stdout.write("\n".join([versions(), "", *table(tools, costs), ""]))


if __name__ == "__main__":
    main()
