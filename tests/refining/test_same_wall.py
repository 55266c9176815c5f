"""One wall is one wall, two faces are two, and who saw what nobody else saw is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from houses import SETTINGS, Leg, outing
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import findings
from possmap.core.records import Fix, PartialMap, Pose, Wall
from possmap.grid.refined import as_bytes
from possmap.refining.refine import Refinement, refine

CORRIDOR = (2.0, 1.0, 4.0, 1.0)
"""A wall to the left of who goes along +x."""


def refined(outings: Sequence[PartialMap], robots: Sequence[str] = ()) -> Refinement:
    return refine([(one, SETTINGS.model) for one in outings], SETTINGS, robots)


def heights(outings: Sequence[PartialMap], found: Refinement | None = None) -> list[float]:
    """Return the y of the middle of each outing's last wall, as laid out."""
    middles = []
    for one in outings:
        track = found.tracks.get(one.name) if found else None
        laid = findings(one, SETTINGS.model, SETTINGS, track).geometry
        last = max(number for number, record in enumerate(one.records) if isinstance(record, Wall))
        middles.append((laid[last].y + laid[last].y2) / 2)
    return middles


def straying(
    robot: str, strays: float, name: str = "a", wall: tuple[float, float, float, float] = CORRIDOR
) -> PartialMap:
    """Return an outing along the corridor and back."""
    back = Leg(180.0, 4.0, strays, (wall,))
    return outing(robot, name, [Leg(0.0, 4.0, strays, (wall,)), back])


def test_two_robots_that_stray_to_opposite_sides_see_one_wall() -> None:
    outings = [straying("r1", 1.5), straying("r2", -1.5)]
    before = heights(outings)
    found = refined(outings)
    after = heights(outings, found)
    assert abs(before[0] - before[1]) > 0.02
    assert abs(after[0] - after[1]) < 0.25 * abs(before[0] - before[1])
    (wall,) = found.walls
    assert (wall.sightings, wall.excursions) == (4, 2)
    assert wall.line == pytest.approx((2.0, 1.0, 4.0, 1.0), abs=0.05)
    assert all(one.half_after < one.half_before for one in found.outings)


orders = st.permutations([("r1", 1.5), ("r2", -1.5), ("r3", 0.5), ("r4", -0.2)])


@given(orders)
def test_the_order_of_arrival_does_not_change_a_bit(order: list[tuple[str, float]]) -> None:
    first = refined([straying(*one) for one in sorted(order)])
    found = refined([straying(*one) for one in order])
    assert found.walls == first.walls
    assert {name: as_bytes(track) for name, track in found.tracks.items()} == {
        name: as_bytes(track) for name, track in first.tracks.items()
    }


def test_the_two_faces_of_a_thin_wall_stay_two() -> None:
    """0.1 m apart, each seen from its own side."""
    below = [straying(f"r{n}", strays) for n, strays in enumerate((0.5, -0.5))]
    face = (2.0, 1.1, 4.0, 1.1)
    over = [
        outing(
            f"s{n}",
            "a",
            [Leg(90.0, 2.0), Leg(0.0, 4.0, strays, (face,)), Leg(180.0, 4.0, strays, (face,))],
        )
        for n, strays in enumerate((0.5, -0.5))
    ]
    found = refined([*below, *over])
    faces = sorted(wall.line[1] for wall in found.walls)
    assert faces == pytest.approx([1.0, 1.1], abs=0.04)
    assert not found.rivals


def test_who_is_known_to_have_ended_elsewhere_takes_along_who_saw_the_same_wall() -> None:
    outings = [straying("r1", 1.5), straying("r2", -1.5)]
    free = refined(outings)
    one = outings[0]
    last = max(number for number, record in enumerate(one.records) if isinstance(record, Pose))
    end = findings(one, SETTINGS.model, SETTINGS, free.tracks[one.name]).geometry[last]
    fix = Fix(one.records[-1].seq + 1, None, end.x, end.y + 0.04, 0.005, 0.005)
    fixed = [replace(one, records=(*one.records, fix)), outings[1]]
    found = refined(fixed)
    there = findings(fixed[0], SETTINGS.model, SETTINGS, found.tracks[one.name]).geometry[last]
    assert (there.x, there.y) == pytest.approx((fix.x, fix.y), abs=0.01)
    moved = np.subtract(heights(fixed, found), heights(outings, free))
    assert (moved > 0.005).all(), "the other robot, too"


@pytest.mark.parametrize("number", [0, -1])
def test_a_heading_that_was_known_turns_the_run_beside_it(number: int) -> None:
    outings = [straying("r1", 1.5), straying("r2", -1.5)]
    one = outings[0]
    places = [at for at, record in enumerate(one.records) if isinstance(record, Pose)]
    pose, at = one.records[places[number]], places[number] + 1
    assert isinstance(pose, Pose)
    turned = []
    for off in (0.0, 0.5):
        fix = Fix(pose.seq, None, pose.x, pose.y, 5.0, 5.0, pose.heading_deg + off, 0.05)
        known = replace(one, records=(*one.records[:at], fix, *one.records[at:]))
        track = refined([known, outings[1]]).tracks[one.name]
        run = track[1] if number == 0 else track[-1]
        turned.append(np.degrees(run.heading_error))
    assert turned[1] - turned[0] == pytest.approx(0.5, abs=0.05)


def test_a_wrong_wall_planted_on_purpose_is_named() -> None:
    """Of five outings one tells of a wall half a metre nearer than all others see it."""
    honest = [straying(f"r{n}", strays) for n, strays in enumerate((0.4, -0.4, 0.2, -0.2))]
    planted = outing("liar", "x", [Leg(0.0, 4.0, 0.0, ((2.0, 0.5, 4.0, 0.5),))])
    found = refined([*honest, planted])
    (rival,) = found.rivals
    assert rival.by == (("liar", "x"),)
    assert rival.apart == pytest.approx(0.5, abs=0.05)
    assert rival.others == 4
    assert heights(honest, found) == pytest.approx([1.0] * 4, abs=0.05)


def test_a_shelf_that_was_moved_between_two_nights_is_named() -> None:
    nights = [straying("r1", 0.3, "n1"), straying("r2", -0.3, "n1"), straying("r3", 0.1, "n1")]
    moved = (2.0, 0.7, 4.0, 0.7)
    nights += [straying("r1", 0.3, "n2", moved), straying("r2", -0.3, "n2", moved)]
    found = refined(nights)
    (rival,) = found.rivals
    assert rival.by == (("r1", "n2"), ("r2", "n2"))
    assert rival.apart == pytest.approx(0.3, abs=0.05)


def test_who_saw_too_little_stays_where_he_was() -> None:
    lonely = outing("r9", "a", [Leg(0.0, 3.0)])
    found = refined([straying("r1", 0.5), straying("r2", -0.5), lonely])
    told = {one.robot: one for one in found.outings}
    assert told["r9"].alone == "few sightings"
    assert told["r9"].half_after == told["r9"].half_before
    assert ("r9", "a") not in found.tracks


def test_a_building_that_is_not_what_axes_says_is_left_alone() -> None:
    """Ten walls that stand at 30°: the filter stops believing them, and so does refining."""
    slanted = [Leg(0.0, 2.0, 0.0, ((2.0 * n, 1.0, 2.0 * n + 1.7, 2.0),)) for n in range(10)]
    found = refined([straying("r1", 0.5), straying("r2", -0.5), outing("r9", "a", slanted)])
    assert [one.alone for one in found.outings] == ["", "", "its walls are not along the axes"]


def test_only_the_robots_that_are_named_are_moved() -> None:
    outings = [
        straying(robot, strays) for robot, strays in (("r1", 1.0), ("r2", -1.0), ("r3", 0.0))
    ]
    found = refined(outings, ["r1", "r2"])
    assert [one.alone for one in found.outings] == ["", "", "not asked for"]
    assert set(found.tracks) == {("r1", "a"), ("r2", "a")}


def test_a_track_that_never_ran_is_left_alone() -> None:
    found = refined([outing("r1", "a", [])])
    assert [one.alone for one in found.outings] == ["it never ran"]
    assert not found.tracks


def test_axes_that_are_turned_turn_all_of_it() -> None:
    """The same house, seen in a frame that is turned by 30°."""
    from dataclasses import replace

    outings = [straying("r1", 1.5), straying("r2", -1.5)]
    turned = replace(SETTINGS, axes=30.0)
    spun = [_turned(one, 30.0) for one in outings]
    straight = refined(outings)
    found = refine([(one, SETTINGS.model) for one in spun], turned)
    unit = complex(np.cos(np.pi / 6), np.sin(np.pi / 6))
    for one in outings:
        here = [complex(p.x, p.y) * unit for p in straight.tracks[one.name]]
        there = [complex(p.x, p.y) for p in found.tracks[one.name]]
        assert there == pytest.approx(here, abs=1e-6)


def _turned(one: PartialMap, degrees: float) -> PartialMap:
    from dataclasses import replace

    unit = complex(np.cos(np.radians(degrees)), np.sin(np.radians(degrees)))
    records = []
    for record in one.records:
        at = complex(record.x, record.y) * unit  # type: ignore[union-attr]
        if isinstance(record, Wall):
            end = complex(record.x2, record.y2) * unit
            records.append(replace(record, x=at.real, y=at.imag, x2=end.real, y2=end.imag))
        else:
            heading = record.heading_deg + degrees  # type: ignore[union-attr]
            records.append(replace(record, x=at.real, y=at.imag, heading_deg=heading))  # type: ignore[call-arg]
    return PartialMap(one.robot, one.excursion, one.model, tuple(records))
