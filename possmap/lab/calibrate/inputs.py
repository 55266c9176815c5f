"""What a calibration is made of: CSV of trials, and simulated teams with the walls they saw."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from possmap.core.records import PartialMap, Pose
from possmap.core.track import stretches
from possmap.errors import LogError, RecordingError
from possmap.lab.calibrate.cutting import TrueTrack, cut
from possmap.lab.calibrate.estimates import ParameterEstimate
from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import limit_factor, rectangle_factor
from possmap.lab.calibrate.reml import Interval
from possmap.lab.calibrate.trials import Floats, Trial
from possmap.lab.calibrate.trials_file import read_trials, repeated
from possmap.lab.evaluate.frame import distances
from possmap.lab.evaluate.tracks import HEADING, X, Y, matched
from possmap.lab.evaluate.true_poses import true_walls
from possmap.logs import encoding_of, read_log
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

TRUTH = "truth.json"

FARTHEST_M = 0.3
"""What is seen farther from every wall is of something else."""

ROUNDED_DEG = 0.02
"""Logs and truths are written to 0.01°: less is nothing."""


@dataclass(frozen=True, eq=False)
class Material:
    """What a calibration is made of.

    trials : all of them. outings : tracks to hold legs against, of recordings.
    walls : sensor and alignment_spread by robot, where walls are known.
    mounts : angle between the truth's heading and the way driven, by robot [deg].
    pool : whether robots may be pooled; not if they are one robot built differently.
    notes : what was left out, and why.
    """

    trials: list[Trial] = field(default_factory=list)
    outings: list[TrueTrack] = field(default_factory=list)
    walls: dict[str, dict[str, ParameterEstimate]] = field(default_factory=dict)
    mounts: dict[str, float] = field(default_factory=dict)
    pool: bool = True
    notes: list[str] = field(default_factory=list)


def add_tables(found: Material, paths: Sequence[Path]) -> None:
    """Read files of trials.

    Raises
    ------
    LogError
        If one cannot be read, or trials stand in them twice.
    """
    trials = [trial for path in paths for trial in read_trials(path)]
    again = repeated(trials)
    if again:
        earlier, later = again[0]
        raise LogError(
            later.place,
            f"repeats {earlier.place} in all numbers, as {len(again)} of {len(trials)} trials "
            "repeat an earlier one; expected each trial once",
        )
    found.trials.extend(trials)


def add_simulation(found: Material, folder: Path) -> None:
    """Cut trials from logs and the truth beside them, as ``possmap simulate`` writes both.

    Raises
    ------
    LogError
        If one cannot be read.
    RecordingError
        If no log has a track in the truth.
    """
    true = read_truth(folder / TRUTH, Limits())
    inside = folder / "logs" if (folder / "logs").is_dir() else folder
    paths = sorted(path for path in inside.iterdir() if encoding_of(path) and path.name != TRUTH)
    ends: dict[str, list[Floats]] = {}
    along: dict[str, list[float]] = {}
    seen: set[tuple[str, str]] = set()
    for path in paths:
        for delivery in read_log(path, Limits()).deliveries:
            version = delivery.version
            track = true.tracks.get(version.name)
            if delivery.carrier is not None or track is None or version.name in seen:
                continue
            seen.add(version.name)
            rows = matched(version, track)
            if len(rows) < 2:
                continue
            outing = _logged(version, track, rows)
            found.trials.extend(cut(outing, math.inf))
            laid = true_walls(version, track, rows)
            ends.setdefault(version.robot, []).append(laid.reshape(-1, 2))
            along.setdefault(version.robot, []).extend(_lined_up(outing))
    if not seen:
        raise RecordingError(
            str(folder), "no log in it has a track in its truth.json, expected logs beside it"
        )
    walls = np.array(true.walls, dtype=np.float64).reshape(-1, 4)
    for robot, parts in ends.items():
        told = {
            "sensor": sensor(np.concatenate(parts), walls) if len(walls) else None,
            "alignment_spread": alignment(np.array(along[robot])),
        }
        own = found.walls.setdefault(robot, {})
        own |= {name: one for name, one in told.items() if one is not None}


def _logged(version: PartialMap, track: Floats, rows: dict[int, int]) -> TrueTrack:
    """Return the poses of a log that the truth knows."""
    poses = [(version.records[index], track[row]) for index, row in rows.items()]
    logged = np.array([(p.x, p.y, p.heading_deg) for p, _ in poses if isinstance(p, Pose)])
    true = np.array([row[[X, Y, HEADING]] for _, row in poses])
    for some in (logged, true):
        some[:, 2] = np.degrees(np.unwrap(np.radians(some[:, 2])))
    ends = {one.end_index: one.is_followed for one in stretches(version.records)}
    followed = np.array([ends.get(index, False) for index in rows][1:], dtype=np.bool_)
    return TrueTrack(version.robot, version.excursion, logged, true, followed, exact=True)


def _lined_up(outing: TrueTrack) -> Iterator[float]:
    """Yield by how much a robot's way along walls truly lies off what it believes [deg]."""
    for start in np.flatnonzero(outing.followed):
        here, there = (
            poses[start + 1, :2] - poses[start, :2] for poses in (outing.logged, outing.true)
        )
        if math.hypot(*here) >= 0.5:
            off = math.degrees(math.atan2(there[1], there[0]) - math.atan2(here[1], here[0]))
            yield math.remainder(off, 360.0)


def sensor(ends: Floats, walls: Floats) -> ParameterEstimate | None:
    """Return the sensor's half-width: of ends of walls seen, (m, 2), laid at the true poses [m]."""
    apart = distances(ends, walls)
    return _half_width(apart[apart <= FARTHEST_M])


def alignment(off: Floats) -> ParameterEstimate | None:
    """Return the half-width of headings along followed walls: true less logged [deg], shape (n,).

    What is rounding of the files counts as nothing.
    """
    found = _half_width(off)
    if found is not None and found.value < ROUNDED_DEG:
        return ParameterEstimate(0.0, 0.0, found.high, 0.0, found.trials)
    return found


def _half_width(errors: Floats) -> ParameterEstimate | None:
    """Return the half-width of errors about 0; None for too few."""
    if len(errors) < LEAST:
        return None
    deviation = math.sqrt(float((errors**2).mean()))
    limits = Interval.chi_square(limit_factor() * deviation, len(errors))
    return ParameterEstimate(*limits[:3], rectangle_factor(len(errors)) * deviation, len(errors))
