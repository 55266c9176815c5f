"""Trials cut from recordings that have a truth beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from possmap.errors import RecordingError, SettingsError, plural, printable
from possmap.lab.calibrate.cutting import TrueTrack, cut, without_mount
from possmap.lab.calibrate.inputs import Material
from possmap.lab.calibrate.pairing import TOLERANCE_M, TURN_TOLERANCE, Paired, paired
from possmap.lab.convert.legs import Reference
from possmap.lab.convert.samples import Samples, joined, unwrapped
from possmap.lab.convert.simplify import outline
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Source, open_recordings
from possmap.lab.recordings.tick_geometry import geometry_beside
from possmap.logs.fields import NAME

LEAST_OF_A_DAY = 6
"""Recordings of fewer trials each are parts of a day: then all of one folder are one."""


@dataclass(frozen=True, kw_only=True)
class RecordingsRequest:
    """How recordings and their truth are read.

    Attributes
    ----------
    source, truth_source
        How each is read.
    truth
        One recording of the truth, or one for each recording; none: the truth is in the same file.
    robot
        Whose the recordings are; None: named after the file, or ``robot`` for several.
    lag
        By how much the truth's clock is late [s]; None: as found.
    """

    source: Source
    truth_source: Source
    truth: tuple[Path, ...] = ()
    robot: str | None = None
    lag: float | None = None


def of_recordings(
    paths: Sequence[Path],
    request: RecordingsRequest,
    progress: Callable[[int, str], Any] | None = None,
) -> Material:
    """Cut trials from recordings and their truth.

    Recordings of robots that are built differently, as their metadata tell, are never pooled.

    Raises
    ------
    RecordingError, SettingsError
        If one cannot be read, or no truth is of its time.
    """
    if request.truth and len(request.truth) not in (1, len(paths)):
        raise SettingsError(
            f"--truth-recording, found {len(request.truth)} for {len(paths)} recordings, expected "
            "one for all, or one for each"
        )
    robots = _robots(paths, request)
    kinds = Counter(robots)
    found = Material(pool=len(kinds) == 1)
    references: dict[Path, Reference] = {}
    names: list[str] = []
    parts: list[tuple[Path, list[TrueTrack]]] = []
    for number, (path, robot) in enumerate(zip(paths, robots, strict=True)):
        at = path
        if request.truth:
            at = request.truth[number if len(request.truth) > 1 else 0]
        if at not in references:
            true = _samples(at, request.truth_source, progress)
            order = np.argsort(true.t, kind="stable")
            references[at] = Reference(true.t[order], true.x[order], true.y[order], true.yaw[order])
        samples = _samples(path, request.source, progress)
        both = paired(samples, references[at], request.lag, printable(str(path)))
        found.notes.extend(both.notes)
        stem = _name(path)
        name = f"{stem}-{names.count(stem) + 1}" if stem in names else stem
        names.append(stem)
        parts.append((path, list(_outings(both, robot, name))))
    found.outings.extend(_with_days(parts))
    if not found.outings:
        raise RecordingError(
            str(paths[0]), "; ".join(["gave no track with a truth beside it", *found.notes])
        )
    if len(kinds) > 1:
        found.notes.append(
            "recordings of different geometry are not pooled: "
            + ", ".join(f"{robot} ({plural(count, 'recording')})" for robot, count in kinds.items())
        )
    trials = [trial for one in found.outings for trial in cut(one)]
    for robot in dict.fromkeys(one.robot for one in trials):
        own, mount = without_mount([one for one in trials if one.robot == robot])
        found.trials.extend(own)
        if mount:
            found.mounts[robot] = mount
    return found


def _robots(paths: Sequence[Path], request: RecordingsRequest) -> list[str]:
    """Return whose each recording is: robots are told apart by the metadata beside, if any."""
    name = request.robot or (_name(paths[0]) if len(paths) == 1 else "robot")
    ticks = request.source.mapping is not None and request.source.mapping.ticks is not None
    found = []
    for path in paths:
        geometry = geometry_beside(path) if ticks else None
        told = [one for one in (request.robot, geometry and geometry.name) if one]
        found.append(":".join(told)[:64] if geometry else name)
    return found


def _name(path: Path) -> str:
    stem = path.name.removesuffix(".gz").rpartition(".")[0] or path.name
    plain = "".join(ch if NAME.fullmatch(ch) else "-" for ch in stem).strip("-")
    return plain[:40] or "robot"


def _samples(path: Path, source: Source, progress: Callable[[int, str], Any] | None) -> Samples:
    """Read a recording whole: its odometry, without ranges."""
    (recording,) = open_recordings([path], source)
    tally = Tally()
    if progress is None:
        parts = list(recording.samples(tally, None))
    else:
        with progress(recording.size, "read") as tell:
            parts = list(recording.samples(tally, tell))
    if not parts or sum(map(len, parts)) < 2:
        raise RecordingError(recording.name, "gave fewer than two poses, expected a track")
    whole = joined([replace(part, ranges=np.empty((len(part), 0))) for part in parts])
    return whole.moved(whole.x, whole.y, unwrapped(whole.yaw, None))


def _outings(both: Paired, robot: str, name: str) -> Iterator[TrueTrack]:
    """Yield the stretches of a track that have a truth and no jump, as runs and turns."""
    samples, true = both.samples, both.true
    breaks = np.flatnonzero(both.breaks) + 1
    for start, stop in zip([0, *breaks], [*breaks, len(samples)], strict=True):
        if stop - start < 2 or not both.known[start]:
            continue
        line = outline(samples.part(int(start), int(stop)), TOLERANCE_M, TURN_TOLERANCE)
        at = line.index + start
        logged = np.column_stack([line.x, line.y, np.degrees(samples.yaw[at])])
        truth = np.column_stack([true.x[at], true.y[at], np.degrees(true.yaw[at])])
        yield TrueTrack(
            robot, name if start == 0 else f"{name}@{int(start)}", logged, truth,
            np.zeros(max(0, len(at) - 1), dtype=np.bool_),
        )  # fmt: skip


def _with_days(parts: Sequence[tuple[Path, list[TrueTrack]]]) -> Iterator[TrueTrack]:
    """Yield tracks with the day of each: its recording, or its folder where they are short."""
    count = [sum(1 for one in tracks for _ in cut(one)) for _, tracks in parts]
    whole = np.median(count) >= LEAST_OF_A_DAY
    for path, tracks in parts:
        day = path if whole else path.parent
        for one in tracks:
            yield replace(one, day=str(day))
