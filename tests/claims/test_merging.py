"""A grid as a log: its ledger fused into another grid, under any settings (METHOD §3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.teams import random_team
from teams import digest, fuse, write_logs
from versions import (
    SETTINGS,
    WHOLE,
    changed,
    errors,
    fused_digest,
    log_of,
    outcomes,
    prefix,
    way_in,
    written,
)

import possmap
from possmap.errors import SettingsError
from possmap.fusing.fuse import FuseSummary
from possmap.grid.arrivals import Arrival


def merged(logs: Sequence[Path], grid: Path, settings: dict[str, Any]) -> FuseSummary:
    summary = possmap.fuse(logs, grid, settings)
    assert not [log.error for log in summary.logs if log.error]
    return summary


@pytest.mark.parametrize("seed", range(12))
def test_a_grid_gives_what_its_logs_give_under_other_settings_too(
    seed: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    logs = random_team(rng)[0]
    old, new = tmp_path / "old.possmap", tmp_path / "new.possmap"
    fuse(write_logs(tmp_path / "logs", logs), old, {"resolution": 0.2, "accept_models": False})
    before = digest(old)
    settings = {"resolution": 0.25, "across": 0.03, "independence": "excursion"}
    summary = merged([old], new, settings)
    assert digest(new) == fused_digest(tmp_path, *logs, settings=settings)
    assert digest(old) == before
    with possmap.open_grid(old) as one, possmap.open_grid(new) as other:
        records = [sum(entry.records for entry in grid.ledger.entries()) for grid in (one, other)]
        known = [list(map(_without_time, grid.ledger.came.all())) for grid in (one, other)]
    assert records[0] == records[1] == summary.records_new
    assert known[0] == known[1]


def _without_time(arrival: Arrival) -> tuple[object, ...]:
    return (arrival.name, arrival.records, arrival.origin, arrival.carrier)


def test_two_grids_merge_in_either_order(tmp_path: Path) -> None:
    whole, other = {**WHOLE, "x_a": 1}, log_of("r2")
    one, two = tmp_path / "one.possmap", tmp_path / "two.possmap"
    fuse(write_logs(tmp_path / "1", [prefix(whole, 3), other]), one, SETTINGS)
    fuse(write_logs(tmp_path / "2", [whole]), two, SETTINGS)
    merged([one, two], tmp_path / "12.possmap", SETTINGS)
    merged([two, one], tmp_path / "21.possmap", SETTINGS)
    into = merged([two], one, {})
    assert outcomes(into) == [("fused", 3, 3)]
    expected = fused_digest(tmp_path, whole, other)
    assert [digest(tmp_path / name) for name in ("12.possmap", "21.possmap", "one.possmap")] == [
        expected
    ] * 3
    assert outcomes(merged([two, one], one, {})) == [("known", 0, 6), ("known", 0, 12)]


def test_a_grid_that_conflicts_is_refused_whole(tmp_path: Path) -> None:
    one, two = tmp_path / "one.possmap", tmp_path / "two.possmap"
    first = fuse(write_logs(tmp_path / "1", [WHOLE]), one, SETTINGS)
    fuse(write_logs(tmp_path / "2", [log_of("r2"), changed(WHOLE, 1, y=0.4)]), two, SETTINGS)
    before = digest(one)
    summary = possmap.fuse([two], one)
    assert outcomes(summary) == [("refused", 0, 0)]
    message = errors(summary, tmp_path)[0]
    assert message.startswith("two.possmap: r1 a: excursion a of robot r1 disagrees with the ")
    assert f"version from {Path(first.logs[0].path).relative_to(tmp_path)}, fused 2" in message
    assert message.endswith(f": the records of seq 1 differ; {way_in('one.possmap')}")
    assert digest(one) == before


def test_what_is_no_grid_is_refused_as_a_log(tmp_path: Path) -> None:
    grid, fake = tmp_path / "site.possmap", tmp_path / "fake.possmap"
    fake.write_text("not a grid at all")
    summary = possmap.fuse([fake, *written(tmp_path, a=WHOLE)], grid, SETTINGS)
    assert outcomes(summary) == [("refused", 0, 0), ("fused", 6, 0)]
    assert errors(summary, tmp_path)[0].startswith("fake.possmap: not a possmap grid")


def test_a_log_keeps_its_own_model_through_a_grid_that_did_not_believe_it(tmp_path: Path) -> None:
    own = {**WHOLE, "model": {"across": 0.2}}
    old, new = tmp_path / "old.possmap", tmp_path / "new.possmap"
    fuse(written(tmp_path, own=own), old, {**SETTINGS, "accept_models": False})
    merged([old], new, {**SETTINGS, "accept_models": True})
    assert digest(new) == fused_digest(tmp_path, own) != fused_digest(tmp_path, WHOLE)


def test_settings_that_differ_from_the_grids_are_refused_with_both_values(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    paths = written(tmp_path, a=WHOLE)
    fuse(paths, grid, SETTINGS)
    with pytest.raises(SettingsError, match=r"resolution, found 0\.2, but .* made with 0\.1 "):
        possmap.fuse(paths, grid, {"resolution": 0.2})
