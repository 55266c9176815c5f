"""Recordings cut into excursions, each laid where it began."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conversion.drives import samples

from possmap.lab.convert.legs import BEFORE_REFERENCE, LegPiece, Reference, legs
from possmap.lab.convert.samples import Floats, Samples, joined
from possmap.lab.convert.tally import Tally


def track(count: int = 101, step: float = 0.1) -> Samples:
    ranges = np.ones((count, 1))
    return samples(step * np.arange(count), np.zeros(count), np.zeros(count), ranges)


def cut(
    pieces: list[Samples],
    length: float | None = None,
    start: tuple[float, float, float] | None = None,
    reference: Reference | None = None,
    tally: Tally | None = None,
) -> dict[int, list[LegPiece]]:
    way = 0.0
    given: list[tuple[Samples, Floats]] = []
    for part in pieces:
        steps = np.hypot(np.diff(part.x, prepend=part.x[0] if not given else given[-1][0].x[-1]), 0)
        given.append((part, way + np.cumsum(steps)))
        way = float(given[-1][1][-1])
    found: dict[int, list[LegPiece]] = {}
    for piece in legs(given, length, start, reference, tally or Tally()):
        found.setdefault(piece.leg, []).append(piece)
    return found


def test_without_legs_the_recording_is_one_and_stays_where_it_is() -> None:
    whole = track()
    ((piece,),) = cut([whole]).values()
    assert piece.samples.x.tolist() == whole.x.tolist()


def test_legs_are_as_long_as_asked_and_share_the_sample_at_the_cut() -> None:
    found = cut([track()], length=2.5)
    ends = [(leg[0].samples.x[0], leg[-1].samples.x[-1]) for leg in found.values()]
    assert np.array(ends) == pytest.approx(np.array([(0, 2.5), (2.5, 5), (5, 7.5), (7.5, 10)]))
    assert all(leg[0].way[0] == 0 for leg in found.values())


@pytest.mark.parametrize("size", [1, 2, 7, 25, 26, 100])
def test_it_does_not_matter_in_which_pieces_the_track_comes(size: int) -> None:
    whole = track()
    pieces = [whole.part(k, k + size) for k in range(0, len(whole), size)]
    one, other = cut([whole], length=2.5), cut(pieces, length=2.5)
    assert one.keys() == other.keys()
    for leg, parts in other.items():
        there = joined(part.samples for part in parts)
        assert there.x == pytest.approx(one[leg][0].samples.x)
        assert np.isnan(there.ranges).sum() == np.isnan(one[leg][0].samples.ranges).sum()


def test_every_reading_belongs_to_one_leg() -> None:
    found = cut([track()], length=2.5)
    readings = sum(
        int((~np.isnan(part.samples.ranges)).sum()) for leg in found.values() for part in leg
    )
    assert readings == 101


def test_a_start_moves_the_whole_track() -> None:
    ((piece,),) = cut([track()], start=(3, 4, math.pi / 2)).values()
    assert (piece.samples.x[-1], piece.samples.y[-1]) == pytest.approx((3, 14))
    assert piece.samples.yaw[-1] == pytest.approx(math.pi / 2)


def test_each_leg_begins_at_its_own_reference_pose() -> None:
    t = np.arange(0, 10.1, 0.5)
    known = Reference(t, 100 + t, 2 * t, np.full(len(t), math.pi / 2))
    found = cut([track()], length=2.5, reference=known)
    starts = [(leg[0].samples.x[0], leg[0].samples.y[0]) for leg in found.values()]
    there = np.array([(100, 0), (102.5, 5), (105, 10), (107.5, 15)])
    assert np.array(starts) == pytest.approx(there)
    first = found[0][0].samples
    assert first.y[-1] - first.y[0] == pytest.approx(2.5)


def test_samples_before_the_first_reference_pose_are_left_out_and_counted() -> None:
    known = Reference(np.array([3.0, 11.0]), np.zeros(2), np.zeros(2), np.zeros(2), gap=20)
    tally = Tally()
    ((piece,),) = cut([track()], reference=known, tally=tally).values()
    assert piece.samples.t[0] == 3.0 and tally.of(BEFORE_REFERENCE) == 30


def test_no_pose_is_made_up_across_a_gap_of_the_reference() -> None:
    known = Reference(np.array([0.0, 9.0]), np.zeros(2), np.zeros(2), np.zeros(2))
    assert known.at(4.0) is None and known.at(9.0) is not None and known.at(9.1) is None
