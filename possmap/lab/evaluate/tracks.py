"""Error rectangles held against the true tracks: how many hold them, and how large they are."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.evidence import Findings
from possmap.core.records import PartialMap, Pose
from possmap.lab.evaluate.raster import Floats

SAME_TIME_S = 1e-6
"""A pose and a row of the track are of one moment if they are no further apart [s]."""

ROUNDED_M = 1e-3
"""What rounding, in the log and in the truth, may add to an error [m]."""

T, X, Y, HEADING, BELIEVED_X, BELIEVED_Y, BELIEVED_HEADING = range(7)
"""The columns of a true track (docs/logs.md, "The truth file"); headings in degrees."""


def matched(version: PartialMap, track: Floats) -> dict[int, int]:
    """Return the row of the true track for each pose record that has one: index -> row.

    They share their ``t``. Of several at one moment the first goes with the first.
    """
    rows: dict[int, list[int]] = defaultdict(list)
    for row, t in enumerate(track[:, T].tolist()):
        rows[round(t / SAME_TIME_S)].append(row)
    found: dict[int, int] = {}
    for index, record in enumerate(version.records):
        if isinstance(record, Pose) and record.t is not None:
            waiting = rows.get(round(record.t / SAME_TIME_S))
            if waiting:
                found[index] = waiting.pop(0)
    return found


def apart(version: PartialMap, track: Floats, rows: Mapping[int, int]) -> Floats:
    """Return how far each matched pose, as logged, lies from what the truth says was believed."""
    logged = [version.records[index] for index in rows]
    places = np.array([(pose.x, pose.y) for pose in logged if isinstance(pose, Pose)])
    believed = track[list(rows.values())][:, [BELIEVED_X, BELIEVED_Y]]
    distances: Floats = np.hypot(*(places.reshape(-1, 2) - believed).T)
    return distances


@dataclass(frozen=True, eq=False)
class TrackErrors:
    """One excursion's poses, truth against rectangle; arrays of one length.

    error_x, error_y : true place minus corrected place [m].
    half_x, half_y : the rectangle's half-widths [m].
    """

    robot: str
    excursion: str
    error_x: Floats
    error_y: Floats
    half_x: Floats
    half_y: Floats

    @property
    def inside(self) -> Floats:
        """Whether the true place lies in the rectangle, 1 or 0."""
        covered = np.abs(self.error_x) <= self.half_x + ROUNDED_M
        covered &= np.abs(self.error_y) <= self.half_y + ROUNDED_M
        return covered.astype(np.float64)


def track_errors(
    version: PartialMap, found: Findings, track: Floats, rows: Mapping[int, int]
) -> TrackErrors:
    """Hold each matched pose against the truth."""
    known = [(index, row) for index, row in rows.items() if index in found.geometry]
    placed = [found.geometry[index] for index, _ in known]
    true = track[[row for _, row in known]].reshape(-1, track.shape[1])
    return TrackErrors(
        version.robot,
        version.excursion,
        true[:, X] - np.array([at.x for at in placed]),
        true[:, Y] - np.array([at.y for at in placed]),
        np.array([at.rect.half_x for at in placed]),
        np.array([at.rect.half_y for at in placed]),
    )


@dataclass(frozen=True, slots=True)
class Rectangles:
    """How honest the rectangles are.

    coverage : share of the true positions at poses that lie in theirs.
    mean_half_width : mean of (hx + hy)/2 [m].
    """

    coverage: float
    mean_half_width: float
    poses: int


def rectangles(tracks: Sequence[TrackErrors]) -> Rectangles | None:
    """Sum up the tracks; None without any matched pose."""
    if not any(len(one.half_x) for one in tracks):
        return None
    inside = np.concatenate([one.inside for one in tracks])
    half = np.concatenate([(one.half_x + one.half_y) / 2 for one in tracks])
    return Rectangles(float(inside.mean()), float(half.mean()), len(inside))
