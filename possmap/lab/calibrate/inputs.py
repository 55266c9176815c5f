"""What a calibration is made of: CSV of trials, simulated teams, or recordings with a truth."""

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
from possmap.lab.calibrate.sensor import alignment, sensor
from possmap.lab.calibrate.trials import Floats, Trial
from possmap.lab.calibrate.trials_file import read_trials, repeated
from possmap.lab.evaluate.tracks import HEADING, X, Y, matched
from possmap.lab.evaluate.true_poses import true_walls
from possmap.logs import encoding_of, read_log
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

TRUTH = "truth.json"


@dataclass(frozen=True, eq=False)
class Material:
    """What a calibration is made of.

    trials : all of them. outings : tracks to hold legs against, of recordings.
    walls : sensor and alignment_spread by robot, where walls are known.
    mounts : angle between the truth's heading and the way driven, by robot [deg].
    pool : whether robots may be pooled; not if they are one robot built differently.
    notes : what was left out, and why.
    """

    trials: list[Trial]
    outings: list[TrueTrack] = field(default_factory=list)
    walls: dict[str, dict[str, ParameterEstimate]] = field(default_factory=dict)
    mounts: dict[str, float] = field(default_factory=dict)
    pool: bool = True
    notes: list[str] = field(default_factory=list)


def of_tables(paths: Sequence[Path]) -> Material:
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
    return Material(trials)


def of_simulation(folder: Path) -> Material:
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
    found = Material([])
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
            outing = _logged(version, track, rows)
            if outing is None:
                continue
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
        own = found.walls.setdefault(robot, {})
        told = sensor(np.concatenate(parts), walls) if len(walls) else None
        if told is not None:
            own["sensor"] = told
        lined = alignment(np.array(along[robot]))
        if lined is not None:
            own["alignment_spread"] = lined
    return found


def _logged(version: PartialMap, track: Floats, rows: dict[int, int]) -> TrueTrack | None:
    """Return the poses of a log that the truth knows; None for fewer than two."""
    if len(rows) < 2:
        return None
    poses = [(version.records[index], track[row]) for index, row in rows.items()]
    logged = np.array([(p.x, p.y, p.heading_deg) for p, _ in poses if isinstance(p, Pose)])
    logged[:, 2] = np.degrees(np.unwrap(np.radians(logged[:, 2])))
    true = np.array([row[[X, Y, HEADING]] for _, row in poses])
    true[:, 2] = np.degrees(np.unwrap(np.radians(true[:, 2])))
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
