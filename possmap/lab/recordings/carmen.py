"""CARMEN logs: odometry and laser lines (docs/convert.md, "CARMEN")."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from statistics import median
from typing import Literal, TypeAlias

import numpy as np

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Floats, Mount, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.carmen_line import Layout, laid_out, poses, robot_at, time_word
from possmap.lab.recordings.join import Join
from possmap.lab.recordings.mapping import Beam, Mapping, Table, chosen
from possmap.lab.recordings.readings import Interpreter
from possmap.lab.recordings.recording import CHUNK_ROWS, Recording
from possmap.lab.recordings.stream import Progress, lines

PoseOf: TypeAlias = Literal["odometry", "laser"]
"""Which pose of a laser line is the robot's: the wheels', or the one that somebody corrected."""

LASERS = (b"FLASER", b"RLASER", b"ROBOTLASER1")
KINDS = (*LASERS, b"ODOM")

_SKIPPED = "lines cut short or without numbers, skipped"
_COMPARED = 9  # laser lines of a kind
_LOOKED_AT = 20_000  # lines, until a log is believed to hold no laser


def looks_like(head: bytes) -> bool:
    """Whether a file's first bytes are those of a CARMEN log."""
    for line in head.split(b"\n")[:200]:
        word = line.split(b" ", 1)[0]
        if word in KINDS or word in (b"PARAM", b"NEFF", b"SYNC"):
            return True
    return False


def open_carmen(path: Path, wanted: Sequence[float], pose_of: PoseOf = "odometry") -> Recording:
    """Open a CARMEN log.

    If it has laser lines, samples stand on these and their poses; otherwise on the ODOM lines.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    pose_of
        Which pose of the laser lines to believe.

    Raises
    ------
    RecordingError
        If it cannot be read, or neither laser nor odometry lines are found.
    """
    layouts, mounts = _survey(path, wanted)
    roles = ("t", "x", "y", "yaw")
    beams = tuple(Beam("", mount) for mount in mounts)
    table = Table("", dict(zip(roles, roles, strict=True)), beams)
    mapping = Mapping("carmen", (table,))

    def samples(tally: Tally, progress: Progress | None) -> Iterator[Samples]:
        told = Interpreter(str(path), table, mapping, tally)
        join = Join(str(path), mapping, (len(mounts),), tally)
        if layouts:
            rows = _laser_rows(path, layouts, pose_of, told, tally, progress)
        else:
            rows = _odometry_rows(path, told, tally, progress)
        for block in _blocks(rows):
            columns = dict(zip(roles, block[:, 1:5].T, strict=True))
            join.feed(0, told.read(columns, block[:, 5:], block[:, 0]))
            found = join.samples()
            if found is not None:
                yield found
        told.finish()
        found = join.samples(last=True)
        if found is not None:
            yield found

    return Recording(path.name, tuple(mounts), samples, path.stat().st_size)


def _blocks(rows: Iterator[list[float]]) -> Iterator[Floats]:
    block: list[list[float]] = []
    for row in rows:
        block.append(row)
        if len(block) == CHUNK_ROWS:
            yield np.array(block)
            block = []
    if block:
        yield np.array(block)


def _survey(path: Path, wanted: Sequence[float]) -> tuple[dict[bytes, Layout], list[Mount]]:
    """Return the layout of each kind of laser line, and how the beams used lie.

    The first laser lines tell, most of them: one may be damaged. A log without any in its
    beginning is read for its odometry.
    """
    seen: dict[bytes, list[Layout]] = {}
    odometry = False
    for number, line in lines(path, Tally()):
        kind = line.split(b" ", 1)[0]
        odometry |= kind == b"ODOM"
        if kind in LASERS and len(seen.get(kind, ())) < _COMPARED:
            with suppress(ValueError, IndexError):
                layout = laid_out(kind, line.split())
                seen.setdefault(kind, []).append(layout)
        if number >= _LOOKED_AT and (seen or odometry):
            break
    layouts = {kind: _usual(found) for kind, found in seen.items()}
    if not layouts and not odometry:
        raise RecordingError(
            str(path),
            "found no whole line of ODOM, FLASER, RLASER or ROBOTLASER1, expected a CARMEN log",
        )
    # Of several lasers the nearest reading of any stands for a beam.
    every = [
        (kind, index, angle)
        for kind, layout in layouts.items()
        for index, angle in enumerate(layout.angles)
    ]
    used = [every[index] for index in chosen([one[2] for one in every], wanted, math.radians(1))]
    mounts: list[Mount] = []
    for kind, layout in list(layouts.items()):
        picked = tuple(index for one, index, _ in used if one == kind)
        mounts += [Mount(layout.angles[index], layout.x, layout.y) for index in picked]
        layouts[kind] = replace(layout, picked=picked)
    return layouts, mounts


def _usual(layouts: Sequence[Layout]) -> Layout:
    """Return the layout that most have; the laser sits where the middle ones of these say."""
    keys = [(layout.count, layout.longest, layout.angles) for layout in layouts]
    (most, _), *_ = Counter(keys).most_common(1)
    agree = [layout for layout, key in zip(layouts, keys, strict=True) if key == most]
    x, y = (median(getattr(layout, name) for layout in agree) for name in ("x", "y"))
    return replace(agree[0], x=x, y=y)


def _laser_rows(
    path: Path,
    layouts: dict[bytes, Layout],
    pose_of: PoseOf,
    told: Interpreter,
    tally: Tally,
    progress: Progress | None,
) -> Iterator[list[float]]:
    """Yield number of the line, t, x, y, yaw and the readings used, of each laser line."""
    widths = [len(layout.picked) for layout in layouts.values()]
    starts = dict(zip(layouts, accumulate([0, *widths[:-1]]), strict=True))
    for number, line in lines(path, tally, progress):
        kind = line[: line.find(b" ")]
        if kind not in LASERS:
            if kind == b"ODOM":
                tally.add("ODOM lines, not needed beside laser lines that have poses")
            continue
        words = line.split()
        known = layouts.get(kind)
        try:
            if known is None or int(words[known.first - 1]) != known.count:
                told.lose("laser lines of another layout than the others, skipped", number)
                continue
            laser, robot = poses(words, known)
            t = float(words[time_word(words, known)])
            read = [float(words[known.first + index]) for index in known.picked]
        except (ValueError, IndexError):
            told.lose(_SKIPPED, number)
            continue
        longest, start = known.longest, starts[kind]
        ranges = [math.nan] * sum(widths)
        ranges[start : start + len(read)] = [r if r < longest else _far(r) for r in read]
        pose = robot if pose_of == "odometry" else robot_at(laser, known)
        yield [number, t, *pose, *ranges]


def _far(value: float) -> float:
    """Return what a reading stands for that is not below the longest: NaN stays what it is."""
    return value if math.isnan(value) else math.inf


def _odometry_rows(
    path: Path, told: Interpreter, tally: Tally, progress: Progress | None
) -> Iterator[list[float]]:
    for number, line in lines(path, tally, progress):
        if not line.startswith(b"ODOM "):
            continue
        words = line.split()
        try:
            row = [float(words[7]), float(words[1]), float(words[2]), float(words[3])]
            _ = words[9]
        except (ValueError, IndexError):
            told.lose(_SKIPPED, number)
            continue
        yield [number, *row]
