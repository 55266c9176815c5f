"""Every reader of possmap under one signature, with small valid files of its own to begin with."""

from __future__ import annotations

import json
import math
import re
import resource
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from fuzz.seeds import (
    DATA,
    bag_seeds,
    carmen_seeds,
    csv_seeds,
    grid_seeds,
    image_seeds,
    lines_seeds,
    log_seeds,
    table_json_seeds,
    zipped,
)
from fuzz.words import CARMEN_WORDS, CSV_WORDS, JSON_WORDS, NUMBERS, TEXTS, YAML_WORDS

import possmap
from possmap.errors import PossmapError
from possmap.fusing import reading
from possmap.grid.grid import Grid
from possmap.lab.calibrate.trials_file import read_trials
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Recording, Source, open_recordings, read_mapping
from possmap.lab.simulate.mission_file import read_mission
from possmap.logs import read_log, read_stdin
from possmap.settings.limits import Limits
from possmap.settings.settings_yaml import read_settings
from possmap.truth.plans import read_image, read_ros_map
from possmap.truth.truth import read_truth

BEAMS = tuple(math.radians(angle) for angle in (-90, 0, 90, 180))
LIMITS = Limits()
CELLS_SHOWN = 10**6


@dataclass(frozen=True)
class Reader:
    """One reader.

    suffix : of its files. read : takes in one file, whole. seeds : valid files' bytes.
    words : what a mutation may put in.
    """

    suffix: str
    read: Callable[[Path], object]
    seeds: Callable[[], list[bytes]]
    words: tuple[bytes, ...] = ()


def _log(path: Path) -> None:
    log = read_log(path, LIMITS, allow_truncated=True)
    assert all(one.version.name == one.name for one in log.deliveries)


def _stdin(path: Path) -> None:
    with path.open("rb") as stream:
        read_stdin(stream, LIMITS, allow_truncated=True)


def _mission(path: Path) -> None:
    read_mission(path, {})


def _image(path: Path) -> None:
    read_image(path, 0.05).walls()


def _ros_map(path: Path) -> None:
    image = path.with_name("plan.pgm")
    if not image.exists():
        image.write_bytes(b"P5 4 4 255\n" + bytes(range(0, 256, 16)))
    read_ros_map(path).walls()


def _samples(recordings: Iterable[Recording]) -> None:
    for recording in recordings:
        for _ in recording.samples(Tally(), None):
            pass


@cache
def _mapping(text: str) -> Source:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mapping.yaml"
        path.write_text(text)
        return Source(mapping=read_mapping(path), beams=BEAMS)


_TABLE = (
    "format: {}\ncolumns: {{t: t, x: x, y: y, yaw: yaw, vx: vx, vy: vy}}\n"
    "beams: [{{column: front, angle_deg: 0}}, {{column: left, angle_deg: 90}}]\n"
)
_SCAN = "format: json\ncolumns: {t: t, left: l, right: r}\nticks: {metres_per_tick: 0.001, "
_SCAN += "track: 0.2, wrap: 4096}\nscan: {column: s, first_deg: -90, step_deg: 90}\n"


def _table_csv(path: Path) -> None:
    _samples(open_recordings([path], _mapping(_TABLE.format("csv"))))


def _table_json(path: Path) -> None:
    scanned = b'"l"' in path.read_bytes()
    _samples(open_recordings([path], _mapping(_SCAN if scanned else _TABLE.format("json"))))


def _carmen(path: Path) -> None:
    for pose in ("odometry", "laser"):
        _samples(open_recordings([path], Source(format="carmen", beams=BEAMS, pose_of=pose)))


def _bag(path: Path) -> None:
    _samples(open_recordings([path], Source(format="ros", beams=BEAMS)))


def _grid(path: Path) -> None:
    reading.read(str(path), LIMITS, allow_truncated=False)
    with Grid(path) as grid:
        assert grid.settings is not None
        assert grid.robots is not None
        grid.digest()
        window = grid.window
        if window is not None and window.shape[0] * window.shape[1] <= CELLS_SHOWN:
            grid.necessity(window)
            grid.possibility(window)


def _fused(path: Path) -> None:
    with TemporaryDirectory() as folder:
        (log,) = possmap.fuse([path], Path(folder) / "site.possmap").logs
    if log.error:
        raise PossmapError(log.error)


UNCHANGED: dict[str, Callable[[Path], None]] = {"fuse": _fused}
"""What reads hostile files, but no mutations: what is let in may take a minute."""

READERS: dict[str, Reader] = {
    "json": Reader(".json", _log, log_seeds, JSON_WORDS),
    "jsonl": Reader(".jsonl", _log, lines_seeds, JSON_WORDS),
    "csv": Reader(".csv", _log, csv_seeds, CSV_WORDS),
    "gz": Reader(".jsonl.gz", _log, zipped(lines_seeds), JSON_WORDS),
    "stdin": Reader(
        ".jsonl", _stdin, lambda: [*lines_seeds(), *zipped(lines_seeds)()], JSON_WORDS
    ),
    "settings": Reader(
        ".yaml", lambda path: read_settings(path),
        lambda: [b"turn_spread: 1.0\nrobots:\n  r1: {turn_bias: 1.5}\n"], YAML_WORDS,
    ),
    "mission": Reader(
        ".yaml", _mission,
        lambda: [
            b"world: {walls: [[0, 0, 4, 0], [0, 0, 0, 4]], rooms: [{at: [0, 0, 9, 9], doors: "
            b"[[south, 1, 2]]}], obstacles: [[2, 2, 3, 3]], home: [5, 5]}\nseed: 3\n",
            b"world: {generate: office, size: [12, 12], seed: 1}\nrobots: 2\n",
        ],
        YAML_WORDS,
    ),
    "mapping": Reader(
        ".yaml", lambda path: read_mapping(path),
        lambda: [_TABLE.format("csv").encode(), _SCAN.encode()], YAML_WORDS,
    ),
    "image": Reader(".png", _image, image_seeds),
    "ros map": Reader(
        ".yaml", _ros_map,
        lambda: [b"image: plan.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
                 b"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"],
        YAML_WORDS,
    ),
    "truth": Reader(
        ".json", lambda path: read_truth(path, LIMITS),
        lambda: [b'{"possmap_truth": 1, "walls": [[0, 0, 1, 0]], "home": [0, 0], "robots": [{'
                 b'"robot": "a", "excursion": "1", "track": [[0, 0, 0, 0, 0, 0, 0.5]]}]}'],
        JSON_WORDS,
    ),
    "trials": Reader(
        ".csv", lambda path: read_trials(path),
        lambda: [b"\n".join((DATA / "trials.csv").read_bytes().splitlines()[:12])],
        CSV_WORDS,
    ),
    "carmen": Reader(".log", _carmen, carmen_seeds, CARMEN_WORDS),
    "table csv": Reader(
        ".csv", _table_csv,
        lambda: [b"t,x,y,yaw,vx,vy,front,left\n0,0,0,0,0,1,2,3\n1,0,1,0,0,1,,3\n2,0,2,0,0,1,2,9"],
        CSV_WORDS,
    ),
    "table json": Reader(".json", _table_json, table_json_seeds, JSON_WORDS),
    "bag": Reader(".bag", _bag, bag_seeds("bag")),
    "db3": Reader(".db3", _bag, bag_seeds("db3")),
    "mcap": Reader(".mcap", _bag, bag_seeds("mcap")),
    "grid": Reader(".possmap", _grid, grid_seeds, NUMBERS + TEXTS),
}  # fmt: skip
"""By name."""


def most_memory() -> float:
    """Return the most memory that this process had at once [MiB]."""
    status = Path("/proc/self/status")
    if status.exists():  # unlike what getrusage says, not that of the process before exec
        (peak,) = re.findall(r"VmHWM:\s+(\d+) kB", status.read_text())
        return int(peak) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Read one file and print what came of it as JSON; test_hostile_corpus runs this."""
    global LIMITS
    name, path, memory_mib, limit_mib = sys.argv[1:]
    LIMITS = Limits(limit_file_mib=float(limit_mib))
    resource.setrlimit(resource.RLIMIT_AS, (int(memory_mib) << 20,) * 2)
    began, told = time.process_time(), None
    try:
        (UNCHANGED.get(name) or READERS[name].read)(Path(path))
    except PossmapError as error:
        told = str(error)
    seconds = time.process_time() - began
    sys.stdout.write(json.dumps({"told": told, "seconds": seconds, "mib": most_memory()}) + "\n")


if __name__ == "__main__":
    main()
