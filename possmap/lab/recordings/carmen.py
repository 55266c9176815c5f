"""CARMEN logs: odometry and laser lines (docs/convert.md, "CARMEN")."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from statistics import median
from typing import Literal, TypeAlias

import numpy as np

from possmap.errors import RecordingError, printable
from possmap.lab.convert.samples import Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import BeamColumn, chosen, mounts_of
from possmap.lab.recordings.carmen_line import (
    LASERS,
    ODOMETRY,
    RAW,
    Layout,
    laid_out,
    mounted_by,
    pose_and_time,
    time_word,
)
from possmap.lab.recordings.join import Join
from possmap.lab.recordings.mapping import Mapping as ColumnMapping
from possmap.lab.recordings.mapping import Table
from possmap.lab.recordings.readings import Interpreter
from possmap.lab.recordings.recording import BRIDGED, CHUNK_ROWS, Handling, Recording
from possmap.lab.recordings.roles import Role
from possmap.lab.recordings.stream import Progress, lines

PoseOf: TypeAlias = Literal["odometry", "laser"]
"""Which pose of a laser line is the robot's: the wheels', or the one that somebody corrected."""

_SAYS_NOTHING = (b"PARAM", b"NEFF", b"SYNC", b"TRUEPOS", b"GPS", b"MARKER")
_SKIPPED = "lines cut short or without numbers, skipped"
_UNNEEDED = "{} lines, not needed beside laser lines that have poses"
_COMPARED = 9  # laser lines of a kind
_LOOKED_AT = 20_000  # lines, until a log is believed to hold no laser
_MOST_KINDS = 20

Row: TypeAlias = tuple[int, list[float]]
"""Number of a table, and its row: number of the line, t, then the pose if it has one, ranges."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """What is read of a log.

    layouts : of the laser lines that are used, by kind. posed : whether these hold the poses; if
    not, ODOM lines do, and each kind of laser line is a table of its own.
    """

    layouts: Mapping[bytes, Layout]
    posed: bool

    @property
    def beams(self) -> list[list[BeamColumn]]:
        """Of each table, the one with the poses first."""
        found = [
            [
                BeamColumn(column="", angle_deg=one.angles[i], x=one.x, y=one.y, max=one.longest)
                for i in one.picked
            ]
            for one in self.layouts.values()
        ]
        return [[beam for beams in found for beam in beams]] if self.posed else [[], *found]


def looks_like(head: bytes) -> bool:
    """Whether a file's first bytes are those of a CARMEN log."""
    kinds = (*LASERS, *RAW, ODOMETRY, b"PARAM", b"NEFF", b"SYNC")
    return any(line.split(b" ", 1)[0] in kinds for line in head.split(b"\n")[:200])


def open_carmen(
    path: Path,
    wanted: Sequence[float],
    pose_of: PoseOf = "odometry",
    handling: Handling = BRIDGED,
) -> Recording:
    """Open a CARMEN log.

    If it has laser lines with poses, samples stand on these; otherwise on the ODOM lines, beside
    which lasers without poses are read.

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
    plan = _survey(path, wanted)
    widths, mounts = mounts_of(plan.beams)

    def samples(tally: Tally, progress: Progress | None) -> Iterator[Samples]:
        tables = [_table(number) for number in range(len(widths))]
        mapping = ColumnMapping(format="csv", tables=tuple(tables))
        told = [
            Interpreter(str(path), table, mapping, beams, tally, handling)
            for table, beams in zip(tables, plan.beams, strict=True)
        ]
        join = Join(str(path), mapping, widths, tally)
        held: list[list[list[float]]] = [[] for _ in tables]

        def hand_over() -> None:
            for number, rows in enumerate(held):
                if rows:
                    block = np.array(rows, dtype=np.float64)
                    roles = tables[number].columns
                    columns = dict(zip(roles, block[:, 1:].T, strict=False))
                    ranges = block[:, 1 + len(roles) :] if widths[number][0] else None
                    join.feed(number, told[number].read(columns, ranges, block[:, 0]))
                    rows.clear()

        for count, (table, row) in enumerate(_rows(path, plan, pose_of, told, tally, progress), 1):
            held[table].append(row)
            if count % CHUNK_ROWS == 0:
                hand_over()
                yield from join.samples()
        hand_over()
        for one in told:
            one.finish()
        yield from join.samples(last=True)

    return Recording(path.name, mounts, samples, path.stat().st_size)


def _table(number: int) -> Table:
    """Return the columns of a table: the first has the poses."""
    columns: dict[Role, str] = {"t": ""}
    if not number:
        columns |= {"x": "", "y": "", "yaw": ""}
    return Table(file=str(number), columns=columns)


def _survey(path: Path, wanted: Sequence[float]) -> _Plan:
    """Return what is read of a log, by its first lines.

    The first laser lines of a kind tell its layout, most of them: one may be damaged. A log without
    any in its beginning is read for its odometry.
    """
    seen: dict[bytes, list[Layout]] = {}
    seats: dict[bytes, float] = {}
    odometry = False
    for number, line in lines(path, Tally()):
        kind = line.split(b" ", 1)[0]
        odometry |= kind == ODOMETRY
        if kind == b"PARAM":
            seats.update(mounted_by(line.split()))
        if kind in (*LASERS, *RAW) and len(seen.get(kind, ())) < _COMPARED:
            with suppress(ValueError, IndexError):
                seen.setdefault(kind, []).append(laid_out(kind, line.split()))
        if number >= _LOOKED_AT and (seen or odometry):
            break
    layouts = {kind: _usual(found) for kind, found in seen.items() if found}
    posed = any(kind in LASERS for kind in layouts)
    if not posed and not odometry:
        raise RecordingError(
            str(path),
            "found no whole line of ODOM, FLASER, RLASER or ROBOTLASER1, expected a CARMEN log",
        )
    layouts = {kind: one for kind, one in layouts.items() if (kind in LASERS) == posed}
    for kind, x in seats.items():
        if kind in layouts:
            layouts[kind] = replace(layouts[kind], x=x)
    # Of several lasers the nearest reading of any stands for a beam.
    every = [
        (kind, index, angle)
        for kind, layout in layouts.items()
        for index, angle in enumerate(layout.angles)
    ]
    used = [every[index] for index in chosen([one[2] for one in every], wanted, math.radians(1))]
    for kind, layout in list(layouts.items()):
        picked = tuple(index for one, index, _ in used if one == kind)
        layouts[kind] = replace(layout, picked=picked)
    return _Plan(layouts, posed)


def _usual(layouts: Sequence[Layout]) -> Layout:
    """Return the layout that most have; the laser sits where the middle ones of these say."""
    keys = [(layout.count, layout.longest, layout.angles) for layout in layouts]
    (most, _), *_ = Counter(keys).most_common(1)
    agree = [layout for layout, key in zip(layouts, keys, strict=True) if key == most]
    x, y = (median(getattr(layout, name) for layout in agree) for name in ("x", "y"))
    return replace(agree[0], x=x, y=y)


def _rows(
    path: Path,
    plan: _Plan,
    pose_of: PoseOf,
    told: Sequence[Interpreter],
    tally: Tally,
    progress: Progress | None,
) -> Iterator[Row]:
    """Yield the rows of all tables, in the order of the lines."""
    layouts = plan.layouts
    widths = [len(layout.picked) for layout in layouts.values()]
    starts = dict(zip(layouts, accumulate([0, *widths[:-1]]), strict=False))
    table_of = {kind: 0 if plan.posed else number for number, kind in enumerate(layouts, 1)}
    others: set[bytes] = set()
    for number, line in lines(path, tally, progress):
        kind = line[: line.find(b" ")]
        table = table_of.get(kind, 0)
        try:
            if kind == ODOMETRY and not plan.posed:
                yield 0, [number, *_odometry(line.split())]
                continue
            if kind not in LASERS and kind not in layouts:
                if kind in RAW or kind == ODOMETRY:
                    tally.add(_UNNEEDED.format(kind.decode()))
                elif _is_kind(kind) and len(others | {kind}) <= _MOST_KINDS:
                    others.add(kind)
                    what = f"{printable(kind.decode())} lines, which are not read"
                    tally.add(what, f"{path}:{number}")
                continue
            words = line.split()
            layout = layouts.get(kind)
            if layout is None or int(words[layout.first - 1]) != layout.count:
                told[table].lose("laser lines of another layout than the others, skipped", number)
                continue
            read = [float(words[layout.first + index]) for index in layout.picked]
            if kind in RAW:
                yield table, [number, float(words[time_word(words, layout)]), *read]
                continue
            t, pose = pose_and_time(words, layout, of_laser=pose_of == "laser")
            ranges = [math.nan] * sum(widths)
            ranges[starts[kind] : starts[kind] + len(read)] = read
            yield 0, [number, t, *pose, *ranges]
        except (ValueError, IndexError):
            told[table].lose(_SKIPPED, number)


def _is_kind(word: bytes) -> bool:
    """Whether a line of an unknown kind begins with this word; comments and noise do not."""
    plain = word.replace(b"_", b"").isalnum() and word.isupper() and len(word) < 30
    return plain and word not in _SAYS_NOTHING


def _odometry(words: Sequence[bytes]) -> list[float]:
    _ = words[9]  # a line that is whole has them all
    return [float(words[7]), float(words[1]), float(words[2]), float(words[3])]
