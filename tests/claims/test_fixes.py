"""Fixes, and looking back (METHOD §7): an excursion that holds a fix is smoothed, and a unit."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from literal.method import literal_grid, literal_half_widths
from literal.teams import Log, knowing_fixes, random_team, telling_of_turns, walls_settings
from teams import ROBUST, cells, digest, flat_settings, fuse, largest_difference, write_logs

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Fix, Pose, Record
from possmap.core.settings import EvidenceSettings
from possmap.core.walls import SURPRISING
from possmap.errors import LogError
from possmap.fusing.forget import Target, forget
from possmap.fusing.fuse import fuse as fuse_files
from possmap.grid.verify import verify
from possmap.logs import read_log
from possmap.settings.limits import Limits
from possmap.settings.settings import assemble

WAYS = [
    {"independence": independence, "free_fusion": free}
    for independence, free in itertools.product(("detection", "excursion"), ("minimum", "dempster"))
]
"""All that makes a contribution easy, or impossible, to subtract."""


def team(seed: int, **settings: object) -> tuple[list[Log], dict[str, Any]]:
    """Draw logs of robots, some of whose places somebody knew, and settings of `walls`."""
    rng = np.random.default_rng(9000 + seed)
    drawn, given = random_team(rng)
    logs = knowing_fixes(telling_of_turns(drawn, seed), seed)
    chosen = {**given, **(dict(ROBUST) if seed % 2 else walls_settings(rng)), **settings}
    if chosen.get("independence") == "detection":  # discounts have no meaning then
        chosen |= {"certainty_power": 1.0, "pass_weight": 1.0}
    if chosen.get("free_fusion", "minimum") == "minimum":
        chosen |= {"pass_weight": 1.0}
    return logs, chosen


def alone(log: Log, count: int | None = None) -> Log:
    """Return the first records of a log's own excursion."""
    return {**log, "records": log["records"][:count], "carried": []}


def as_carried(log: Log) -> Log:
    return {key: value for key, value in log.items() if key not in ("carried", "possmap_log")}


# --- The smoother ------------------------------------------------------------------------------


@settings(max_examples=20)  # a dense Gaussian takes its time
@given(st.integers(0, 10**9))
def test_looking_back_is_the_conditioning_of_one_gaussian_of_all_states(seed: int) -> None:
    """Places, half-widths and headings of all poses, beside a dense joint Gaussian."""
    logs, settings = team(seed)
    assembled = assemble(flat_settings(settings))
    for log in logs:
        if not any(record["kind"] == "fix" for record in log["records"]):
            continue
        version = read(log)
        robot = assembled.robots.get(version.robot, {})
        model = assembled.evidence.model_in_force(version.model, robot)
        found = estimate(version.records, model, assembled.evidence)
        # The literal list begins with the first pose as logged.
        expected = literal_half_widths(log, settings)[1:]
        for at, error, literal in zip(found.stretches, found.errors, expected, strict=True):
            assert at.end == pytest.approx((literal.x, literal.y), rel=1e-6, abs=1e-6)
            half = (*error.after.rectangle, math.degrees(error.after.heading_half))
            told = (literal.half_x, literal.half_y, literal.heading)
            assert [one**2 for one in half] == pytest.approx(
                [one**2 for one in told], rel=1e-5, abs=1e-7
            )


def read(log: Log) -> Any:
    """Return what the reader makes of a log's own excursion."""
    import json
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "log.json"
        path.write_text(json.dumps(alone(log)))
        return read_log(path, Limits()).deliveries[0].whole


@pytest.mark.parametrize("seed", range(20))
def test_teams_with_fixes_fuse_as_the_literal_method_says(seed: int, tmp_path: Path) -> None:
    logs, settings = team(seed)
    grid = tmp_path / "g.possmap"
    paths = write_logs(tmp_path / "logs", logs)
    fuse(paths[::2], grid, settings)
    fuse(paths[1::2] or paths, grid, {})
    expected = literal_grid(logs, settings)
    necessity, possibility, points = cells(grid)
    assert largest_difference(necessity, expected.necessity, 0.0) < 1e-4
    assert largest_difference(possibility, expected.possibility, 1.0) < 1e-4
    assert largest_difference(points, expected.points, 0.0) < 1e-4


def straight(*fixed: Record) -> list[Record]:
    """Return a run of 10 m along x, and what is known of its end."""
    return [Pose(0, None, 0.0, 0.0, 0.0), Pose(1, None, 10.0, 0.0, 0.0), *fixed]


WALLS = EvidenceSettings(estimator="walls", orthogonal=True)


def test_a_fix_at_the_end_says_what_every_error_must_have_added_up_to() -> None:
    track: list[Record] = [Pose(n, None, float(n), 0.0, 0.0) for n in range(11)]
    believed = estimate(track, ErrorModel(), WALLS)
    found = estimate([*track, Fix(11, None, 10.0, 0.3, 0.01, 0.01)], ErrorModel(), WALLS)
    # The heading was wrong from the first: the track bends by what it missed, all along.
    ends = [one.end[1] for one in found.stretches]
    assert ends == pytest.approx([0.03 * n for n in range(1, 11)], abs=1e-3)
    for before, after in zip(believed.errors, found.errors, strict=True):
        assert after.end.half_y < before.end.half_y
    assert found.errors[-1].end.half_y == pytest.approx(0.01, rel=0.01)


def test_the_surprise_of_a_fix_is_kept_and_it_is_used_all_the_same() -> None:
    half = estimate(straight(), ErrorModel(), WALLS).errors[-1].end.half_y
    root = math.sqrt(half**2 + 0.1**2) / ErrorModel().factor  # √V
    for times in (3.6, 3.8):  # √13.8 = 3.71
        fix = Fix(2, None, 10.0, times * root, 0.1, 0.1)
        found = estimate(straight(fix), ErrorModel(), WALLS)
        told = found.observations
        assert told.surprise == pytest.approx(times**2)
        assert (told.fixes, told.surprising) == (1, times**2 > SURPRISING)
        assert found.stretches[-1].end[1] > 0.5 * times * root


def test_a_heading_is_known_but_for_whole_turns() -> None:
    for turns in (-2, 0, 1):
        fix = Fix(2, None, 10.0, 0.0, 1.0, 1.0, 360.0 * turns + 1.0, 0.1)
        found = estimate(straight(fix), ErrorModel(), WALLS)
        assert found.stretches[-1].heading_deg == pytest.approx(1.0, abs=0.01)
        assert found.stretches[-1].end[1] == pytest.approx(10 * math.radians(1.0), abs=0.01)


@pytest.mark.parametrize("estimator", ["linear", "heading"])
@pytest.mark.parametrize("seed", range(6))
def test_other_estimators_ignore_fixes(seed: int, estimator: str, tmp_path: Path) -> None:
    logs, settings = team(seed, estimator=estimator)
    without = [
        {**log, "records": [one for one in log["records"] if one["kind"] != "fix"]}
        for log in map(alone, logs)
    ]
    for name, some in (("with", list(map(alone, logs))), ("without", without)):
        fuse(write_logs(tmp_path / name, some), tmp_path / f"{name}.possmap", settings)
    assert cells(tmp_path / "with.possmap") == cells(tmp_path / "without.possmap")


# --- The ledger --------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS, ids=lambda way: "-".join(way.values()))
@pytest.mark.parametrize("seed", range(4))
def test_versions_in_any_order_split_and_relayed_give_the_digest_of_the_longest(
    seed: int, way: dict[str, str], tmp_path: Path
) -> None:
    logs, settings = team(seed, **way)
    rng = np.random.default_rng(seed)
    full = [alone(log) for log in logs]
    carrier: Log = {"possmap_log": 1, "robot": "carrier", "excursion": "c", "records": []}
    fuse(write_logs(tmp_path / "full", [*full, carrier]), tmp_path / "full.possmap", settings)
    expected = digest(tmp_path / "full.possmap")
    versions = list(full)
    for log in full:
        versions += [alone(log, int(n)) for n in rng.integers(0, len(log["records"]) + 1, size=3)]
    for trial in range(2):
        some = [versions[k] for k in rng.permutation(len(versions))]
        grid = tmp_path / f"{trial}.possmap"
        paths = write_logs(tmp_path / "one", some[::2])
        fuse(paths, grid, {**settings, "transaction_records": 1 if trial else 10**6})
        relayed = {**carrier, "carried": [as_carried(log) for log in some[1::2]]}
        fuse(write_logs(tmp_path / "two", [relayed]), grid, {})
        fuse(write_logs(tmp_path / "three", full), grid, {})
        assert digest(grid) == expected
        fuse(write_logs(tmp_path / "four", [alone(log, 5) for log in full]), grid, {})
        assert digest(grid) == expected  # a prefix that comes later changes nothing
        assert verify(grid, full=True).is_sound


@pytest.mark.parametrize("way", WAYS, ids=lambda way: "-".join(way.values()))
@pytest.mark.parametrize("seed", range(4))
def test_a_file_with_the_fix_forgotten_leaves_the_grid_of_the_file_without(
    seed: int, way: dict[str, str], tmp_path: Path
) -> None:
    logs, settings = team(seed, **way)
    full = [alone(log) for log in logs]
    firsts = [next((n for n, one in enumerate(log["records"]) if one["kind"] == "fix"), None)
              for log in full]  # fmt: skip
    short = [alone(log, n) for log, n in zip(full, firsts, strict=True)]
    fuse(write_logs(tmp_path / "short", short), tmp_path / "short.possmap", settings)
    expected = digest(tmp_path / "short.possmap")
    grid = tmp_path / "site.possmap"
    fuse(write_logs(tmp_path / "short", short), grid, settings)
    paths = write_logs(tmp_path / "full", full)
    fuse(paths, grid, {})
    for path, first in zip(paths, firsts, strict=True):
        if first is not None:
            forget(grid, Target(brought_by=str(path)))
    assert digest(grid) == expected
    assert verify(grid, full=True).is_sound


@pytest.mark.parametrize("seed", range(4))
def test_a_ledger_with_fixes_fused_into_a_new_grid_is_the_logs_fused_anew(
    seed: int, tmp_path: Path
) -> None:
    logs, settings = team(seed)
    paths = write_logs(tmp_path / "logs", logs)
    fuse(paths, tmp_path / "a.possmap", {"resolution": 0.3})
    fuse([tmp_path / "a.possmap"], tmp_path / "b.possmap", settings)
    fuse(paths, tmp_path / "c.possmap", settings)
    assert digest(tmp_path / "b.possmap") == digest(tmp_path / "c.possmap")


@pytest.mark.thorough
def test_processes_restamp_what_one_process_restamps(tmp_path: Path) -> None:
    logs, settings = team(3)
    full = [alone(log) for log in logs]
    short = [alone(log, len(log["records"]) // 2) for log in full]
    for name, jobs in (("one", 1), ("two", 2)):
        grid = tmp_path / f"{name}.possmap"
        fuse(write_logs(tmp_path / "short", short), grid, settings)
        paths = write_logs(tmp_path / "full", full)
        assert not fuse_files([str(path) for path in paths], grid, jobs=jobs).count("refused")
    assert digest(tmp_path / "one.possmap") == digest(tmp_path / "two.possmap")


def test_a_kill_in_the_middle_of_a_restamp_leaves_the_old_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from possmap.fusing import fuse as fusing

    logs, settings = team(1)
    full = [alone(log) for log in logs]
    short = [alone(log, len(log["records"]) // 2) for log in full]
    grid = tmp_path / "site.possmap"
    fuse(write_logs(tmp_path / "short", short), grid, settings)
    before = digest(grid)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    paths = write_logs(tmp_path / "full", full)
    with monkeypatch.context() as patched:
        patched.setattr(fusing, "by_tile", killed)  # what was there is taken out already
        with pytest.raises(KeyboardInterrupt):
            fuse(paths, grid, {})
    assert digest(grid) == before
    assert verify(grid, full=True).is_sound
    fuse(paths, grid, {})
    fuse(paths, tmp_path / "anew.possmap", settings)
    assert digest(grid) == digest(tmp_path / "anew.possmap")


# --- The door ----------------------------------------------------------------------------------

FIX = '"kind": "fix", "x": 1, "y": 2, "error_x": 0.05, "error_y": 0.05'
POSE = '"kind": "pose", "x": 0, "y": 0, "heading": 0'


NOT_POSITIVE = "expected a number > 0"


@pytest.mark.parametrize(
    ("first", "fix", "problem"),
    [
        ("", FIX, "3: records[0].kind: expected a pose before the first fix"),
        (
            POSE,
            FIX.replace('"error_x": 0.05, ', ""),
            "4: records[1]: error_x is missing, a fix needs it",
        ),
        (POSE, FIX.replace("0.05", "0", 1), f"4: records[1].error_x: found 0, {NOT_POSITIVE}"),
        (POSE, FIX.replace("0.05", "-1", 1), f"4: records[1].error_x: found -1, {NOT_POSITIVE}"),
        (
            POSE,
            f'{FIX}, "heading": 3',
            "4: records[1]: error_heading is missing, a fix with heading needs it",
        ),
        (
            POSE,
            f'{FIX}, "error_heading": 3',
            "4: records[1]: heading is missing, a fix with error_heading needs it",
        ),
        (
            POSE,
            f'{FIX}, "heading": 3, "error_heading": 0',
            "4: records[1].error_heading: found 0, expected a number > 0",
        ),
        (POSE, f'{FIX}, "x2": 3', '4: records[1].x2: unknown key "x2" of a fix, did you mean "x"?'),
    ],
)  # fmt: skip
def test_a_fix_that_cannot_be_trusted_is_refused_with_its_line(
    first: str, fix: str, problem: str, tmp_path: Path
) -> None:
    records = [f'{{"seq": {n}, {one}}}' for n, one in enumerate(filter(None, (first, fix)))]
    path = tmp_path / "log.json"
    path.write_text(
        '{"possmap_log": 1, "robot": "r1",\n"excursion": "a", "records": [\n'
        + ",\n".join(records)
        + "]}"
    )
    with pytest.raises(LogError) as caught:
        read_log(path, Limits())
    assert str(caught.value) == f"{path}:{problem}"
