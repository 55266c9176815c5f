"""The same evidence is the same bytes, in any order, grouping, encoding or relay (METHOD §3)."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.teams import as_csv, as_jsonl, random_team
from teams import ROBUST, digest, fuse, write_logs

Log = dict[str, Any]
SEEDS = range(40)


def team(seed: int, **settings: object) -> tuple[list[Log], dict[str, Any], np.random.Generator]:
    """Draw logs and settings; every other team's are those of the profile ``robust``."""
    rng = np.random.default_rng(1000 + seed)
    logs, given = random_team(rng)
    given = {**given, **(ROBUST if seed % 2 else {}), **settings}
    if given.get("independence") == "detection":  # discounts have no meaning then
        given |= {"certainty_power": 1.0, "pass_weight": 1.0}
    return logs, given, rng


def cut(log: Log, count: int) -> Log:
    """Return the version of a log that ends after so many records."""
    return {**log, "records": log["records"][:count], "carried": []}


def as_carried(log: Log) -> Log:
    return {key: value for key, value in log.items() if key not in ("carried", "possmap_log")}


@pytest.mark.parametrize("seed", SEEDS)
def test_any_order_and_any_split_into_calls_give_one_digest(seed: int, tmp_path: Path) -> None:
    logs, settings, rng = team(seed)
    paths = write_logs(tmp_path / "logs", logs)
    fuse(paths, tmp_path / "all.possmap", settings)
    expected = digest(tmp_path / "all.possmap")
    for trial in range(3):
        shuffled = [paths[k] for k in rng.permutation(len(paths))]
        stops = sorted(rng.integers(0, len(paths) + 1, size=2).tolist())
        grid = tmp_path / f"{trial}.possmap"
        for part in (shuffled[: stops[0]], shuffled[stops[0] : stops[1]], shuffled[stops[1] :]):
            if part:
                fuse(part, grid, settings)
        assert digest(grid) == expected


@pytest.mark.parametrize("seed", SEEDS)
def test_logs_fused_twice_change_nothing(seed: int, tmp_path: Path) -> None:
    logs, settings, _ = team(seed)
    paths = write_logs(tmp_path / "logs", logs)
    grid = tmp_path / "g.possmap"
    fuse(paths, grid, settings)
    before = grid.read_bytes()
    again = fuse(paths, grid, settings)
    assert again.records_new == 0
    assert grid.read_bytes() == before


@pytest.mark.parametrize("independence", ["detection", "excursion"])
@pytest.mark.parametrize("seed", SEEDS)
def test_relayed_beginnings_and_the_full_log_give_the_digest_of_the_full_log(
    seed: int, independence: str, tmp_path: Path
) -> None:
    logs, settings, rng = team(seed, independence=independence)
    full = [cut(log, len(log["records"])) for log in logs]
    carrier: Log = {"possmap_log": 1, "robot": "carrier", "excursion": "c", "records": []}
    fuse(write_logs(tmp_path / "full", [*full, carrier]), tmp_path / "full.possmap", settings)
    expected = digest(tmp_path / "full.possmap")
    versions = []
    for log in full:
        cuts = rng.integers(0, len(log["records"]) + 1, size=3)
        versions += [cut(log, int(count)) for count in cuts] + [log]
    for trial in range(2):
        some = [versions[k] for k in rng.permutation(len(versions))]
        grid = tmp_path / f"{trial}.possmap"
        fuse(write_logs(tmp_path / "one", some[::2]), grid, settings)
        relayed = {**carrier, "carried": [as_carried(log) for log in some[1::2]]}
        fuse(write_logs(tmp_path / "two", [relayed]), grid, settings)
        fuse(write_logs(tmp_path / "three", full), grid, settings)
        assert digest(grid) == expected


@pytest.mark.parametrize("seed", SEEDS)
def test_any_encoding_gives_one_digest(seed: int, tmp_path: Path) -> None:
    logs, settings, _ = team(seed)
    fuse(write_logs(tmp_path / "logs", logs), tmp_path / "json.possmap", settings)
    expected = digest(tmp_path / "json.possmap")
    lines = tmp_path / "team.ndjson.gz"
    lines.write_bytes(gzip.compress(as_jsonl(logs).encode()))
    fuse([lines], tmp_path / "lines.possmap", settings)
    assert digest(tmp_path / "lines.possmap") == expected
    everything = [*logs, *(carried for log in logs for carried in log.get("carried", []))]
    # A CSV can hold neither a model nor an excursion without a record.
    if all(log["records"] and not log.get("model") for log in everything):
        table = tmp_path / "team.csv"
        table.write_text(as_csv(logs))
        fuse([table], tmp_path / "csv.possmap", settings)
        assert digest(tmp_path / "csv.possmap") == expected


@pytest.mark.parametrize("seed", SEEDS)
def test_a_batch_in_many_transactions_gives_one_digest(seed: int, tmp_path: Path) -> None:
    logs, settings, _ = team(seed)
    paths = write_logs(tmp_path / "logs", logs)
    fuse(paths, tmp_path / "one.possmap", settings)
    fuse(paths, tmp_path / "many.possmap", {**settings, "transaction_records": 1})
    assert digest(tmp_path / "one.possmap") == digest(tmp_path / "many.possmap")


@pytest.mark.parametrize("seed", SEEDS)
def test_a_grid_fused_into_a_new_one_is_the_logs_fused_anew(seed: int, tmp_path: Path) -> None:
    logs, settings, _ = team(seed)
    paths = write_logs(tmp_path / "logs", logs)
    half = len(paths) // 2 or 1
    fuse(paths[:half], tmp_path / "a.possmap", {"resolution": 0.3})
    fuse(paths[half:] or paths, tmp_path / "b.possmap", {"resolution": 0.5})
    fuse([tmp_path / "b.possmap", tmp_path / "a.possmap"], tmp_path / "c.possmap", settings)
    fuse(paths, tmp_path / "d.possmap", settings)
    assert digest(tmp_path / "c.possmap") == digest(tmp_path / "d.possmap")
