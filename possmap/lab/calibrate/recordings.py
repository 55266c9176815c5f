"""Trials cut from recordings that have a truth beside them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from possmap.errors import RecordingError, SettingsError, plural, printable
from possmap.lab.calibrate.cutting import TrueTrack, cut, without_mount
from possmap.lab.calibrate.inputs import Material
from possmap.lab.calibrate.trials import Floats, Trial
from possmap.lab.convert.legs import Reference
from possmap.lab.convert.samples import Samples, joined, unwrapped
from possmap.lab.convert.simplify import outline
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Recording, Source, open_recordings
from possmap.lab.recordings.tick_geometry import geometry_beside
from possmap.logs.fields import NAME

TOLERANCE_M, TURN_TOLERANCE = 0.05, math.radians(15.0)
"""How runs are told from turns: as ``possmap convert`` does it."""

JUMP_M, JUMP_DEG, JUMP_DEVIATIONS = 0.2, 15.0, 10.0
"""From one sample to the next, truth and odometry never part by more than this, and by so many
robust deviations of all steps, unless one of the two jumps."""


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
    """

    source: Source
    truth_source: Source
    truth: tuple[Path, ...] = ()
    robot: str | None = None


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
    found = Material([], pool=len(kinds) == 1)
    references: dict[Path, Reference] = {}
    used: set[str] = set()
    for number, (path, robot) in enumerate(zip(paths, robots, strict=True)):
        at = path
        if request.truth:
            at = request.truth[number if len(request.truth) > 1 else 0]
        if at not in references:
            references[at] = _reference(at, request.truth_source, progress)
        (recording,) = open_recordings([path], request.source)
        samples = _samples(recording, progress)
        label = _unused(_name(path), used)
        for part in _outings(samples, references[at], robot, label, printable(str(path)), found):
            found.outings.append(part)
            found.trials.extend(cut(part))
    if not found.outings:
        raise RecordingError(
            str(paths[0]), "; ".join(["gave no track with a truth beside it", *found.notes])
        )
    if len(kinds) > 1:
        found.notes.append(
            "recordings of different geometry are not pooled: "
            + ", ".join(f"{robot} ({plural(count, 'recording')})" for robot, count in kinds.items())
        )
    _take_mounts_out(found)
    return found


def _take_mounts_out(found: Material) -> None:
    turned: list[Trial] = []
    for robot in dict.fromkeys(one.robot for one in found.trials):
        own, mount = without_mount([one for one in found.trials if one.robot == robot])
        turned += own
        if mount:
            found.mounts[robot] = mount
    found.trials[:] = turned


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


def _unused(name: str, used: set[str]) -> str:
    found, number = name, 1
    while found in used:
        number += 1
        found = f"{name}-{number}"
    used.add(found)
    return found


def _samples(recording: Recording, progress: Callable[[int, str], Any] | None) -> Samples:
    """Read a recording whole: its odometry, without ranges."""
    tally = Tally()
    if progress is None:
        parts = list(recording.samples(tally, None))
    else:
        with progress(recording.size, "read") as tell:
            parts = list(recording.samples(tally, tell))
    if not parts or sum(map(len, parts)) < 2:
        raise RecordingError(recording.name, "gave fewer than two poses, expected a track")
    empty = [replace(part, ranges=np.empty((len(part), 0))) for part in parts]
    whole = joined(empty)
    return whole.moved(whole.x, whole.y, unwrapped(whole.yaw, None))


def _reference(path: Path, source: Source, progress: Callable[[int, str], Any] | None) -> Reference:
    (recording,) = open_recordings([path], source)
    true = _samples(recording, progress)
    order = np.argsort(true.t, kind="stable")
    return Reference(true.t[order], true.x[order], true.y[order], true.yaw[order])


def _outings(
    samples: Samples, true: Reference, robot: str, name: str, path: str, found: Material
) -> Iterator[TrueTrack]:
    """Yield the stretches of a track that have a truth and no jump, as runs and turns."""
    samples = _at_stamps(samples, true)
    after = np.minimum(np.searchsorted(true.t, samples.t), len(true.t) - 1)
    before = np.maximum(after - 1, 0)
    exact = true.t[after] == samples.t
    inside = (samples.t >= true.t[0]) & (samples.t <= true.t[-1])
    known = inside & (exact | (true.t[after] - true.t[before] <= true.gap))
    missing = int((~known).sum())
    if missing:
        found.notes.append(f"{path}: {missing} of {len(samples)} samples have no truth, left out")
    x, y, yaw = (np.interp(samples.t, true.t, column) for column in (true.x, true.y, true.yaw))
    jumps = known[1:] & known[:-1] & _jumps(samples, x, y, yaw, known)
    if jumps.any():
        first = float(samples.t[1:][jumps][0])
        found.notes.append(
            f"{path}: truth and odometry part in one step {int(jumps.sum())} times (first at "
            f"t = {first:.2f} s): a jump of one of them; trials end before and begin after it"
        )
    breaks = np.flatnonzero(jumps | ~known[1:] | ~known[:-1]) + 1
    for start, stop in zip([0, *breaks], [*breaks, len(samples)], strict=True):
        if stop - start < 2 or not known[start]:
            continue
        piece = samples.part(int(start), int(stop))
        line = outline(piece, TOLERANCE_M, TURN_TOLERANCE)
        at = line.index + start
        logged = np.column_stack([line.x, line.y, np.degrees(samples.yaw[at])])
        truth = np.column_stack([x[at], y[at], np.degrees(yaw[at])])
        yield TrueTrack(
            robot, name if start == 0 else f"{name}@{int(start)}", logged, truth,
            np.zeros(max(0, len(at) - 1), dtype=np.bool_),
        )  # fmt: skip


def _at_stamps(samples: Samples, true: Reference) -> Samples:
    """Return the odometry at the truth's stamps, if it is the one of the two that knows more.

    Between stamps one interpolates; where the robot begins to turn that is wrong, and the less so
    the closer the stamps.
    """
    if len(samples) < 2 or len(true.t) < 2:
        return samples
    if np.median(np.diff(true.t)) <= 1.5 * np.median(np.diff(samples.t)):
        return samples
    own, which = np.unique(samples.t, return_index=True)
    t = np.unique(true.t[(true.t >= own[0]) & (true.t <= own[-1])])
    after = np.minimum(np.searchsorted(own, t), len(own) - 1)
    t = t[(own[after] == t) | (own[after] - own[np.maximum(after - 1, 0)] <= true.gap)]
    if len(t) < 2:
        return samples
    x, y, yaw = (np.interp(t, own, one[which]) for one in (samples.x, samples.y, samples.yaw))
    return Samples(t, x, y, yaw, np.empty((len(t), 0)))


def _jumps(samples: Samples, x: Floats, y: Floats, yaw: Floats, known: Any) -> Any:
    """Return after which samples truth and odometry part by more than they ever do."""
    logged = np.hypot(np.diff(samples.x), np.diff(samples.y))
    apart = np.hypot(np.diff(x), np.diff(y)) - logged
    turned = np.degrees(np.diff(yaw) - np.diff(samples.yaw))
    both = known[1:] & known[:-1]
    found = np.zeros(len(apart), dtype=np.bool_)
    for values, least in ((apart, JUMP_M), (turned, JUMP_DEG)):
        if both.any():
            middle = np.median(values[both])
            spread = 1.4826 * np.median(np.abs(values[both] - middle))
            found |= np.abs(values - middle) > max(least, JUMP_DEVIATIONS * spread)
    return found
