"""From samples to records, end to end: what a log claims of a drive whose truth is known."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from conversion.drives import SIDES, drive, samples

from possmap.core.records import PartialMap
from possmap.lab.convert import convert as convert_module
from possmap.lab.convert.convert import ConvertOutcome, Whereabouts, convert
from possmap.lab.convert.orthogonal import Alignment, align
from possmap.lab.convert.samples import Mount, Samples
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.convert.tally import Tally
from possmap.logs.fields import record_of

HALL = [
    (0.0, 0.0, 8.0, 0.0), (8.0, 0.0, 8.0, 6.0), (8.0, 6.0, 0.0, 6.0), (0.0, 6.0, 0.0, 0.0),
    (1.4, 1.4, 6.6, 1.4), (6.6, 1.4, 6.6, 4.6), (6.6, 4.6, 1.4, 4.6), (1.4, 4.6, 1.4, 1.4),
]  # fmt: skip
LAP = [(0.7, 0.7), (7.3, 0.7), (7.3, 5.3), (0.7, 5.3), (0.7, 1.2)]


class Kept:
    """Keeps the logs."""

    def __init__(self) -> None:
        self.logs: list[list[dict[str, Any]]] = []

    def begin(self, leg: int) -> None:
        """Keep it."""
        assert leg == len(self.logs)
        self.logs.append([])

    def record(self, record: dict[str, Any]) -> None:
        """Keep it."""
        self.logs[-1].append(record)

    def end(self) -> None:
        """Keep it."""


def converted(
    track: Sequence[Samples] | Samples,
    mounts: Sequence[Mount] = SIDES,
    place: Whereabouts | None = None,
    tally: Tally | None = None,
    **settings: Any,
) -> tuple[list[list[dict[str, Any]]], ConvertOutcome]:
    pieces = [track] if isinstance(track, Samples) else track
    sink = Kept()
    outcome = convert(
        pieces, mounts, place or Whereabouts(), ConvertSettings(**settings), sink, tally or Tally()
    )
    for log in sink.logs:  # every one is a log by the format's own rules
        PartialMap("r", "1", (), tuple(record_of(record, 16) for record in log))
        seqs = [record["seq"] for record in log]
        assert seqs == list(range(len(log)))
        assert all(a["t"] <= b["t"] + 1e-9 for a, b in itertools.pairwise(log))
    return sink.logs, outcome


def of_kind(log: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    return [record for record in log if record["kind"] == kind]


def off_walls(x: float, y: float) -> float:
    """Return how far a point lies from the hall's walls [m]."""
    found = []
    for x0, y0, x1, y1 in HALL:
        length = math.hypot(x1 - x0, y1 - y0)
        along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
        along = min(length, max(0.0, along))
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        found.append(math.hypot(x - x0 - along * ux, y - y0 - along * uy))
    return min(found)


def test_a_lap_through_a_hall_becomes_four_runs_its_walls_and_its_corners() -> None:
    (log,), outcome = converted(drive(LAP, HALL))
    assert len({(pose["x"], pose["y"]) for pose in of_kind(log, "pose")}) == 5
    walls = of_kind(log, "wall")
    for wall in walls:
        assert off_walls(wall["x"], wall["y"]) < 0.02 and off_walls(wall["x2"], wall["y2"]) < 0.02
        assert wall["followed"] is False
    seen = sum(math.hypot(wall["x2"] - wall["x"], wall["y2"] - wall["y"]) for wall in walls)
    assert 35 < seen < 50  # 44 m of wall, some seen by two beams
    corners = of_kind(log, "corner")
    assert Counter(corner["corner"] for corner in corners) == {"concave": 3, "convex": 3, "end": 1}
    (end,) = (corner for corner in corners if corner["corner"] == "end")
    assert (end["x"], end["y"]) == pytest.approx((1.4, 1.4), abs=0.06)  # not gone around yet
    assert outcome.way == pytest.approx(6.6 + 4.6 + 6.6 + 4.1, abs=0.01)
    assert outcome.strays.worst < 0.05


def test_each_run_has_its_own_piece_of_a_wall_and_they_leave_no_gap() -> None:
    """A long wall seen from a bending track: LOGS.md asks for one record per wall and run."""
    x = np.linspace(0, 8, 161)
    y = 0.25 * np.sin(x)
    wall = 1.2 - y
    read = np.full((161, 3), np.nan)
    read[:, 2] = wall
    (log,), _ = converted(samples(x, y, np.zeros(161), read))
    pieces = of_kind(log, "wall")
    runs = len(of_kind(log, "pose")) - 1
    assert runs > 4 and len(pieces) == runs
    ends = [(piece["x"], piece["x2"]) for piece in pieces]
    assert ends[0][0] == pytest.approx(0, abs=0.01) and ends[-1][1] == pytest.approx(8, abs=0.01)
    for one, other in itertools.pairwise(ends):
        assert one[1] == pytest.approx(other[0], abs=2e-4)
    poses = of_kind(log, "pose")
    order = [record["kind"] for record in log]
    assert order[0] == "pose" and order[-1] == "pose"
    for k, piece in enumerate(pieces):
        between = log.index(poses[k]) < log.index(piece) < log.index(poses[k + 1])
        assert between


def test_readings_on_no_wall_stay_beams_and_repeated_ones_are_told_once() -> None:
    read = np.full((60, 1), np.nan)
    read[:20, 0] = 1.0  # standing still, it reads one thing again and again
    read[20:, 0] = np.tile([0.5, 1.7, 1.1, 0.8], 10)
    x = np.concatenate([np.zeros(20), 0.2 * np.arange(40)])
    tally = Tally()
    (log,), _ = converted(samples(x, np.zeros(60), np.zeros(60), read), [Mount(1.57)], tally=tally)
    beams = of_kind(log, "beam")
    assert all(beam.get("hit", True) for beam in beams)
    assert len(beams) == 41 and tally.of("readings that repeat the one before, dropped") == 19


def test_misses_are_kept_on_demand_and_thinned() -> None:
    read = np.full((101, 1), -np.inf)
    track = samples(0.05 * np.arange(101), np.zeros(101), np.zeros(101), read)
    assert not of_kind(converted(track, [Mount(0.0)])[0][0], "beam")
    beams = of_kind(converted(track, [Mount(0.0)], misses=True)[0][0], "beam")
    assert 19 <= len(beams) <= 21
    assert {beam["hit"] for beam in beams} == {False}
    assert {round(beam["x2"] - beam["x"], 6) for beam in beams} == {2.0}


@pytest.mark.parametrize("block", [64, 200, 1000])
def test_the_size_of_a_block_changes_little_and_loses_nothing(
    block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    track = drive(LAP, HALL)
    (whole,), one = converted(track)
    monkeypatch.setattr(convert_module, "BLOCK", block)
    tally = Tally()
    (parts,), other = converted(list(chunks(track, 50)), tally=tally)
    assert other.samples == one.samples == len(track)
    assert other.strays.worst < 0.05
    ends = [(log[0]["x"], log[0]["y"], log[-1]["x"], log[-1]["y"]) for log in (whole, parts)]
    assert ends[0] == ends[1]
    for log in (whole, parts):
        for wall in of_kind(log, "wall"):
            assert off_walls(wall["x"], wall["y"]) < 0.02


def chunks(track: Samples, size: int) -> Iterator[Samples]:
    for start in range(0, len(track), size):
        yield track.part(start, start + size)


def test_an_hour_at_one_place_is_no_run_and_does_not_pile_up() -> None:
    rng = np.random.default_rng(8)
    still = samples(rng.normal(0, 0.002, 36_000), rng.normal(0, 0.002, 36_000), np.zeros(36_000))
    (log,), outcome = converted(list(chunks(still, 4096)), [])
    assert outcome.samples == 36_000
    assert len({(pose["x"], pose["y"]) for pose in of_kind(log, "pose")}) == 1
    assert len(log) <= 10  # one for each block


def test_legs_begin_anew_and_each_is_a_log() -> None:
    logs, outcome = converted(drive(LAP, HALL), legs=5.0)
    assert outcome.legs == len(logs) == 5
    assert outcome.way == pytest.approx(21.9, abs=0.01)
    for one, other in itertools.pairwise(logs):
        assert (one[-1]["x"], one[-1]["y"]) == (other[0]["x"], other[0]["y"])


def bent(track: Samples, degrees_per_metre: float) -> Samples:
    """Return a track as a robot believes it that turns unknowingly."""
    steps = np.hypot(np.diff(track.x, prepend=track.x[0]), np.diff(track.y, prepend=track.y[0]))
    wrong = np.radians(degrees_per_metre) * np.cumsum(steps)
    dx, dy = np.diff(track.x, prepend=track.x[0]), np.diff(track.y, prepend=track.y[0])
    x = track.x[0] + np.cumsum(dx * np.cos(wrong) - dy * np.sin(wrong))
    y = track.y[0] + np.cumsum(dx * np.sin(wrong) + dy * np.cos(wrong))
    return track.moved(x, y, track.yaw + wrong)


def straightened(track: Samples) -> tuple[list[dict[str, Any]], Alignment]:
    _, seen = converted(track)
    found = align(seen.bearings)
    assert found is not None
    (log,), _ = converted(track, place=Whereabouts(alignment=found))
    return log, found


def test_right_angles_take_most_of_a_drift_out_and_few_runs_claim_it() -> None:
    true = drive(LAP + LAP, HALL)
    track = bent(true, 0.4)
    (raw,), _ = converted(track)
    log, found = straightened(track)
    gone = [math.hypot(one[-1]["x"] - 0.7, one[-1]["y"] - 1.2) for one in (raw, log)]
    assert gone[0] > 1.0 and gone[1] < 0.5 * gone[0]
    assert found.share > 0.9
    run, claimed = 0, set()
    for record in log:
        run += record["kind"] == "pose"
        if record.get("followed"):
            claimed.add(run)
    assert 4 <= len(claimed) <= 44 / 3 + 1
