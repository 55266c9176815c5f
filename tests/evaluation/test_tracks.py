"""Rectangles along true tracks, and the map that true poses would give."""

from __future__ import annotations

import numpy as np
import pytest
from troupes import NO_ERRORS, drive, excursions, shipped_world

from possmap.core.evidence import findings
from possmap.core.lattice import Window
from possmap.core.model import ErrorModel
from possmap.core.records import PartialMap, Pose
from possmap.core.settings import EvidenceSettings
from possmap.lab.evaluate.distance import squared_distances
from possmap.lab.evaluate.raster import cells_of
from possmap.lab.evaluate.tracks import apart, matched, rectangles, track_errors
from possmap.lab.evaluate.true_poses import true_walls
from possmap.logs.fields import record_of


def straight(ends: list[tuple[float, float]]) -> PartialMap:
    """Return a log of runs along x, a second each."""
    poses = [Pose(k, float(k), x, y, 0.0) for k, (x, y) in enumerate(ends)]
    return PartialMap("r1", "a", (), tuple(poses))


def test_a_pose_finds_its_row_by_its_time_and_each_row_is_found_once() -> None:
    version = straight([(0, 0), (1, 0), (2, 0)])
    again = Pose(3, 2.0, 2.0, 0.0, 90.0)
    version = PartialMap("r1", "a", (), (*version.records, again))
    track = np.zeros((5, 7))
    track[:, 0] = [0, 0.5, 2, 2, 9]
    assert matched(version, track) == {0: 0, 2: 2, 3: 3}
    track[:, 4] = [0.5, 0, 2, 2, 0]
    assert apart(version, track, matched(version, track)).tolist() == [0.5, 0, 0]


def test_coverage_counts_poses() -> None:
    """By hand: ±0.01 m a metre; the truth leaves the rectangle in the last of 1 + 1 + 2 m."""
    model = ErrorModel(along=0.01, across=0.01, turn_spread=0)
    version = straight([(0, 0), (1, 0), (2, 0), (4, 0)])
    track = np.zeros((4, 7))
    track[:, 0] = [0, 1, 2, 3]
    track[:, 1] = [0, 1, 2, 4]
    track[3, 2] = 0.05
    found = findings(version, model, EvidenceSettings())
    errors = track_errors(version, found, track, matched(version, track))
    assert errors.inside.tolist() == [1, 1, 1, 0]
    summed = rectangles([errors])
    assert summed is not None
    assert (summed.coverage, summed.poses) == (0.75, 4)
    assert summed.mean_half_width == pytest.approx((0 + 0.01 + 0.02 + 0.04) / 4)
    assert rectangles([]) is None


@pytest.mark.parametrize("exact", [True, False])
def test_records_laid_at_true_poses_lie_on_true_walls(exact: bool) -> None:
    """Without errors to within rounding; with them, since poses are all that was wrong."""
    world = shipped_world("figure8")
    mission = drive(world, robots=2, minutes=4, seed=3, **(NO_ERRORS if exact else {}))
    window = Window(-250, 250, -250, 250)
    near = squared_distances(cells_of(world.walls, window, 0.05), 3)
    seen = 0
    for one in excursions(mission):
        version = PartialMap(
            one.robot,
            one.excursion,
            (),
            tuple(record_of(record, 16) for record in one.book.as_log()["records"]),
        )
        track = np.array(one.track)
        laid = true_walls(version, track, matched(version, track))
        seen += len(laid)
        drawn = cells_of(laid, window, 0.05)
        right = float((near[drawn] <= (2 if exact else 9)).mean())
        assert right > (0.99 if exact else 0.9)
    assert seen > 20
