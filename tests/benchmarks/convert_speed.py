"""How fast recordings become logs: the readers alone, and whole processes on a gigabyte.

A robot drives round a hall of 12 x 8 m, ten samples a second, and its beams read the walls with a
centimetre of noise. Each format is generated first, from one seed, and not timed.

    python tests/benchmarks/convert_speed.py [--mebibytes 20] [--runs 3]
    python tests/benchmarks/convert_speed.py --gigabyte [--formats carmen csv json bag mcap]

The first prints for each format what its reader does alone, best of the runs; the second runs
``possmap convert`` once on a file of 1 GB each: wall time, speed, scans, peak memory.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Source, open_recordings, read_mapping

HALL = 12.0, 8.0
SPEED, HZ, NOISE = 0.5, 10.0, 0.01
LAP = 256
"""Scans that are generated, and then told again and again with other times."""

CSV_MAPPING = """format: csv
columns: {t: t, x: x, y: y, yaw: yaw}
beams:
  - {column: right, angle_deg: -90}
  - {column: front, angle_deg: 0}
  - {column: left, angle_deg: 90}
"""
JSON_MAPPING = """format: json
rows: map
columns: {t: key, x: x, "y": "y", yaw: theta}
scan: {column: range, first_deg: -90, step_deg: 1}
"""

Row = tuple[float, float, float, float, list[float]]
"""Time [s], place [m], heading [rad], and 180 ranges from -90 degrees on [m]."""


def drive() -> Iterator[Row]:
    """Yield samples of a robot that goes round and round, a metre from the walls, for ever."""
    lap: list[tuple[float, float, float, list[float]]] = []
    rng = np.random.default_rng(1)
    width, height = HALL[0] - 2, HALL[1] - 2
    for share in np.arange(LAP) / LAP * 2 * (width + height):
        x, y, yaw = _on_the_way(float(share), width, height)
        angles = yaw + np.radians(np.arange(-90, 90))
        cos, sin = np.cos(angles), np.sin(angles)
        with np.errstate(divide="ignore"):
            across = np.where(cos > 0, (HALL[0] - x) / cos, -x / cos)
            along = np.where(sin > 0, (HALL[1] - y) / sin, -y / sin)
        ranges = np.minimum(across, along) + rng.normal(0, NOISE, len(angles))
        lap.append((round(x, 4), round(y, 4), round(yaw, 5), np.round(ranges, 2).tolist()))
    number = 0
    while True:
        yield round(1e9 + number / HZ, 3), *lap[number % LAP]
        number += 1


def _on_the_way(along: float, width: float, height: float) -> tuple[float, float, float]:
    for corner, yaw, length in (
        ((1.0, 1.0), 0.0, width),
        ((1 + width, 1.0), math.pi / 2, height),
        ((1 + width, 1 + height), math.pi, width),
        ((1.0, 1 + height), -math.pi / 2, height),
    ):
        if along < length:
            return corner[0] + along * math.cos(yaw), corner[1] + along * math.sin(yaw), yaw
        along -= length
    return 1.0, 1.0, 0.0


def write_carmen(path: Path, size: int) -> int:
    """Write FLASER lines of 180 readings."""

    def line(row: Row) -> str:
        t, x, y, yaw, ranges = row
        pose = f"{x} {y} {yaw}"
        return f"FLASER 180 {' '.join(map(str, ranges))} {pose} {pose} {t} host {t}\n"

    return _write(path, size, "", line, "")


def write_csv(path: Path, size: int) -> int:
    """Write rows of ten columns, of which seven are used."""

    def line(row: Row) -> str:
        t, x, y, yaw, ranges = row
        near = f"{ranges[0]},{ranges[90]},{ranges[179]}"
        return f"{t},{x},{y},{yaw},{near},0.5,0.01,11.9\n"

    return _write(path, size, "t,x,y,yaw,right,front,left,speed,turn,volt\n", line, "")


def write_json(path: Path, size: int) -> int:
    """Write an object of scans by their times, as the Intel set is."""

    def line(row: Row) -> str:
        t, x, y, yaw, ranges = row
        entry = json.dumps({"range": ranges, "x": x, "y": y, "theta": yaw})
        return f'"{t}": {entry},\n'

    last = '"2e9": {"range": ' + json.dumps([1.0] * 180) + ', "x": 1, "y": 1, "theta": 0}}}\n'
    return _write(path, size, '{"map": {\n', line, last) + 1


def _write(path: Path, size: int, head: str, line: Callable[[Row], str], tail: str) -> int:
    count = 0
    with path.open("w") as stream:
        written = stream.write(head)
        for row in drive():
            written += stream.write(line(row))
            count += 1
            if written + len(tail) >= size:
                break
        stream.write(tail)
    return count


def write_bag(path: Path, size: int) -> int:
    """Write nav_msgs/Odometry and sensor_msgs/LaserScan, one of each for a sample."""
    from bags import words_of
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    one = path.suffix == ".bag"
    words = words_of("bag" if one else "mcap")
    serialize = words.store.serialize_ros1 if one else words.store.serialize_cdr
    folder = path if one else path.with_suffix("")
    writer = Writer1(path) if one else Writer2(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    written = count = 0
    with writer:
        types = {"/odom": "nav_msgs/msg/Odometry", "/scan": "sensor_msgs/msg/LaserScan"}
        known = {
            topic: writer.add_connection(topic, name, typestore=words.store)
            for topic, name in types.items()
        }
        for t, x, y, yaw, ranges in drive():
            t -= 1e9
            around = [*ranges, *ranges]
            for topic, message in (
                ("/odom", words.odometry(t, x, y, yaw)),
                ("/scan", words.scan(t, around)),
            ):
                data = serialize(message, types[topic])
                writer.write(known[topic], round((1000 + t) * 1e9), data)
                written += len(data) + 40
            count += 1
            if written >= size:
                break
    if not one:
        (folder / f"{folder.name}.mcap").rename(path)
    return count


WRITERS: dict[str, tuple[str, Callable[[Path, int], int], str]] = {
    "carmen": ("drive.log", write_carmen, ""),
    "csv": ("drive.csv", write_csv, CSV_MAPPING),
    "json": ("drive.json", write_json, JSON_MAPPING),
    "bag": ("drive.bag", write_bag, ""),
    "mcap": ("drive.mcap", write_bag, ""),
}


def mapping_of(folder: Path, form: str) -> Path | None:
    """Write the mapping of a format, if it needs one."""
    text = WRITERS[form][2]
    if not text:
        return None
    path = folder / f"{form}.yaml"
    path.write_text(text)
    return path


def readers(formats: list[str], mebibytes: float, runs: int) -> None:
    """Print what each reader does alone."""
    say(f"Readers alone, {mebibytes:g} MiB each, best of {runs}:")
    say(f"{'format':>8}{'MB':>8}{'rows':>10}{'seconds':>10}{'MB/s':>8}{'rows/s':>10}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for form in formats:
            path = folder / WRITERS[form][0]
            count = WRITERS[form][1](path, int(mebibytes * 2**20))
            rules = mapping_of(folder, form)
            source = Source(
                mapping=read_mapping(rules) if rules else None,
                beams=tuple(math.radians(angle) for angle in (-90, 0, 90)),
            )
            seconds = min(_read(path, source) for _ in range(runs))
            size = path.stat().st_size / 1e6
            say(
                f"{form:>8}{size:>8.1f}{count:>10}{seconds:>10.2f}{size / seconds:>8.1f}"
                f"{count / seconds:>10.0f}"
            )
            path.unlink()


def _read(path: Path, source: Source) -> float:
    start = time.perf_counter()
    (recording,) = open_recordings([path], source)
    for _ in recording.samples(Tally(), None):
        pass
    return time.perf_counter() - start


CHILD = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], check=False).returncode\n"
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr)\n"
    "sys.exit(code)\n"
)


def whole(formats: list[str], size: int) -> None:
    """Print what whole processes of ``possmap convert`` take."""
    say(f"possmap convert, {size / 1e9:g} GB each:")
    say(
        f"{'format':>8}{'MB':>8}{'scans':>10}{'seconds':>10}{'MB/s':>8}{'scans/s':>10}"
        f"{'peak MiB':>10}{'log MB':>8}"
    )
    for form in formats:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            path = folder / WRITERS[form][0]
            count = WRITERS[form][1](path, size)
            rules = mapping_of(folder, form)
            command = [sys.executable, "-m", "possmap", "-q", "convert", str(path)]
            command += ["-o", str(folder / "out.jsonl")]
            command += ["--mapping", str(rules)] if rules else []
            start = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-c", CHILD, *command], capture_output=True, text=True, check=True
            )
            seconds = time.perf_counter() - start
            peak = int(done.stderr.split()[-1]) / 1024
            read = path.stat().st_size / 1e6
            written = (folder / "out.jsonl").stat().st_size / 1e6
            say(
                f"{form:>8}{read:>8.0f}{count:>10}{seconds:>10.1f}{read / seconds:>8.1f}"
                f"{count / seconds:>10.0f}{peak:>10.0f}{written:>8.1f}"
            )


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mebibytes", type=float, default=20.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--gigabyte", action="store_true")
    parser.add_argument("--size", type=float, default=1e9, help="of --gigabyte, in bytes")
    parser.add_argument("--formats", nargs="+", choices=list(WRITERS), default=list(WRITERS))
    asked = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for bags.py
    if asked.gigabyte:
        whole(asked.formats, int(asked.size))
    else:
        readers(asked.formats, asked.mebibytes, asked.runs)
    say(f"(generated with a peak of {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f}"
        " MiB)")  # fmt: skip


if __name__ == "__main__":
    main()
