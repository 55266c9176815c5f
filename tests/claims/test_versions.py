"""METHOD §3, Identity and Versions: each record once, prefixes agree, conflicts change nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from literal.teams import Log
from teams import digest, fuse
from versions import (
    HINT,
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
from possmap.grid.arrivals import with_news

# --- Versions that agree ----------------------------------------------------------------------


def test_a_longer_version_replaces_a_shorter_one_in_whatever_order(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    short, longer = written(tmp_path, short=prefix(WHOLE, 3), longer=WHOLE)
    assert outcomes(fuse([short], grid, SETTINGS)) == [("fused", 3, 0)]
    before = digest(grid)
    assert outcomes(fuse([longer], grid, SETTINGS)) == [("fused", 3, 3)]
    assert digest(grid) == fused_digest(tmp_path, WHOLE) != before

    other = tmp_path / "other.possmap"
    assert outcomes(fuse([longer, short], other, SETTINGS)) == [("fused", 6, 0), ("known", 0, 3)]
    assert outcomes(fuse([short, longer], other, {})) == [("known", 0, 3), ("known", 0, 6)]
    assert digest(other) == digest(grid)


@pytest.mark.parametrize("count", range(7))
def test_every_prefix_agrees(count: int, tmp_path: Path) -> None:
    start = prefix(WHOLE, count)
    assert fused_digest(tmp_path, start, WHOLE) == fused_digest(tmp_path, WHOLE)
    assert fused_digest(tmp_path, WHOLE, start) == fused_digest(tmp_path, WHOLE)


@pytest.mark.parametrize(
    "same",
    [
        changed(WHOLE, 0, x=0, y=-0.0, heading=-0.0),
        changed(WHOLE, 0, error_x=0, error_y=0.0, error_heading=-0.0),
        changed(WHOLE, 1, followed=True),
        changed(WHOLE, 1, x_note="seen twice"),
        {**WHOLE, "x_firmware": 2, "model": {}},
    ],
    ids=["minus zero", "default errors", "default flag", "own key", "own key of the log"],
)
def test_versions_are_compared_as_read(same: Log, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    fuse(written(tmp_path, first=WHOLE), grid, SETTINGS)
    before = digest(grid)
    assert outcomes(fuse(written(tmp_path, same=same), grid, {})) == [("known", 0, 6)]
    assert digest(grid) == before == fused_digest(tmp_path, same)


def test_an_excursion_carried_home_by_many_counts_once(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    one = {**log_of("r2", 2), "carried": [prefix(WHOLE, 4), prefix(WHOLE, 2)]}
    two = {**log_of("r3", 2), "carried": [prefix(WHOLE, 5)]}
    summary = fuse(written(tmp_path, one=one, two=two, own=WHOLE), grid, SETTINGS)
    assert outcomes(summary) == [("fused", 6, 0), ("fused", 3, 4), ("fused", 1, 5)]
    assert (summary.records_new, summary.records_known) == (10, 9)
    assert digest(grid) == fused_digest(tmp_path, WHOLE, log_of("r2", 2), log_of("r3", 2))
    with possmap.open_grid(grid) as opened:
        parts = [
            (first, came.records - first, came.carrier)
            for came, first in with_news(opened.ledger.came.of(("r1", "a")))
            if first is not None
        ]
    assert parts == [(0, 4, ("r2", "a")), (4, 1, ("r3", "a")), (5, 1, None)]


def test_an_own_log_may_come_back_with_another_robot_or_in_itself(tmp_path: Path) -> None:
    back = {**log_of("r2", 2), "carried": [prefix(WHOLE, 4)]}
    itself = {**prefix(WHOLE, 5), "carried": [WHOLE, prefix(WHOLE, 2)]}
    summary = fuse(written(tmp_path, own=WHOLE, back=back), tmp_path / "a.possmap", SETTINGS)
    assert outcomes(summary) == [("fused", 6, 0), ("fused", 2, 4)]
    summary = fuse(written(tmp_path, itself=itself), tmp_path / "b.possmap", SETTINGS)
    assert outcomes(summary) == [("fused", 6, 0)]
    assert digest(tmp_path / "b.possmap") == fused_digest(tmp_path, WHOLE)


def test_an_empty_log_is_new_once(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    paths = written(tmp_path, empty=prefix(WHOLE, 0))
    assert outcomes(fuse([*paths, *paths], grid, SETTINGS)) == [("fused", 0, 0), ("known", 0, 0)]
    assert outcomes(fuse(paths, grid, {})) == [("known", 0, 0)]


# --- Versions that conflict -------------------------------------------------------------------

CONFLICTS = [
    (changed(WHOLE, 1, y=0.34), "the records of seq 1 differ"),
    (changed(WHOLE, 5, followed=False), "the records of seq 5 differ"),
    (changed(WHOLE, 2, t=7.0), "the records of seq 2 differ"),
    (changed(prefix(WHOLE, 3), 2, heading=90), "the records of seq 2 differ"),
    (changed(WHOLE, 5, seq=9), "seq 5 against seq 9"),
    ({**WHOLE, "model": {"drift": 0.5}}, "their models differ"),
]


@pytest.mark.parametrize(("log", "what"), CONFLICTS)
def test_a_conflict_with_the_grid_is_refused_and_changes_nothing(
    log: Log, what: str, tmp_path: Path
) -> None:
    grid = tmp_path / "site.possmap"
    fuse(written(tmp_path, first=WHOLE), grid, SETTINGS)
    before = grid.read_bytes()
    with possmap.open_grid(grid) as opened:
        fused_at = next(opened.ledger.came.all()).fused_at
    summary = possmap.fuse(written(tmp_path, second=log), grid)
    assert outcomes(summary) == [("refused", 0, 0)]
    assert errors(summary, tmp_path) == [
        "second.json:1: excursion a of robot r1 disagrees with the version from "
        f"first.json, fused {fused_at}: {what}; {way_in()}"
    ]
    assert grid.read_bytes() == before


@pytest.mark.parametrize(("log", "what"), CONFLICTS)
def test_in_one_batch_the_first_holds_and_the_others_are_fused(
    log: Log, what: str, tmp_path: Path
) -> None:
    grid = tmp_path / "site.possmap"
    other = log_of("r2", 4)
    batch = written(tmp_path, first=WHOLE, second=log, third=other)
    summary = possmap.fuse(batch, grid, SETTINGS)
    assert outcomes(summary) == [("fused", 6, 0), ("refused", 0, 0), ("fused", 4, 0)]
    assert errors(summary, tmp_path) == [
        "second.json:1: excursion a of robot r1 disagrees with the version from "
        f"first.json:1: {what}; {way_in()}"
    ]
    assert digest(grid) == fused_digest(tmp_path, WHOLE, other)


def test_the_message_names_what_brought_the_very_record(tmp_path: Path) -> None:
    carrier = {**log_of("r2", 2), "carried": [prefix(WHOLE, 4)]}
    batch = written(
        tmp_path, start=prefix(WHOLE, 2), carrier=carrier, bad=changed(WHOLE, 3, y=0.4), end=WHOLE
    )
    for number, order in enumerate([batch, [*batch[:2], batch[3], batch[2]]]):
        summary = possmap.fuse(order, tmp_path / f"{number}.possmap", SETTINGS)
        assert errors(summary, tmp_path) == [
            "bad.json:1: excursion a of robot r1 disagrees with the version from "
            "carrier.json:1: the records of seq 3 differ; "
            f"{way_in(f'{number}.possmap')}"
        ]


def test_a_log_without_records_is_not_named_as_the_source_of_one(tmp_path: Path) -> None:
    batch = written(tmp_path, empty=prefix(WHOLE, 0), whole=WHOLE, bad=changed(WHOLE, 3, y=0.4))
    summary = possmap.fuse(batch, tmp_path / "site.possmap", SETTINGS)
    assert "the version from whole.json:1: the records" in errors(summary, tmp_path)[0]


@pytest.mark.parametrize(("log", "what"), CONFLICTS)
def test_a_conflict_inside_one_file_refuses_all_of_it(log: Log, what: str, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    other = log_of("r3", 2)
    fuse(written(tmp_path, other=other), grid, SETTINGS)
    before = digest(grid)
    text = json.dumps({**log_of("r2", 2), "carried": [WHOLE, log]})
    path = tmp_path / "both.json"
    path.write_text(text.replace('{"possmap_log"', '\n{"possmap_log"'))
    summary = possmap.fuse([path], grid)
    assert outcomes(summary) == [("refused", 0, 0)]
    assert errors(summary, tmp_path) == [
        "both.json:4: excursion a of robot r1 disagrees with the version from "
        f"both.json:3: {what}; {HINT}"
    ]
    assert digest(grid) == before


def test_a_refused_log_does_not_count_as_known_for_the_next(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    bad = {**log_of("r2", 4), "carried": [changed(WHOLE, 0, y=1.0)]}
    good = {**log_of("r2", 2), "carried": [WHOLE]}
    batch = written(tmp_path, first=prefix(WHOLE, 1), bad=bad, good=good)
    summary = possmap.fuse(batch, grid, SETTINGS)
    assert outcomes(summary) == [("fused", 1, 0), ("refused", 0, 0), ("fused", 7, 1)]
    assert digest(grid) == fused_digest(tmp_path, WHOLE, log_of("r2", 2))


def test_versions_are_judged_in_the_order_given_a_folder_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    b_first = written(folder, b=WHOLE, a=changed(WHOLE, 1, y=0.4))
    by_order = possmap.fuse(b_first, tmp_path / "1.possmap", SETTINGS)
    by_name = possmap.fuse([folder], tmp_path / "2.possmap", SETTINGS)
    assert [Path(log.path).name for log in by_order.logs if log.error] == ["a.json"]
    assert [Path(log.path).name for log in by_name.logs if log.error] == ["b.json"]


# --- Strict and dry ---------------------------------------------------------------------------


@pytest.mark.parametrize("transaction_records", [1, 20_000])
def test_strict_keeps_nothing_of_a_batch_with_a_refused_log(
    transaction_records: int, tmp_path: Path
) -> None:
    grid = tmp_path / "site.possmap"
    fuse(written(tmp_path, known=log_of("r9")), grid, SETTINGS)
    before = digest(grid)
    batch = written(tmp_path, a=WHOLE, b=changed(WHOLE, 1, y=0.4), c=log_of("r2"))
    limit = {"transaction_records": transaction_records}
    summary = possmap.fuse(batch, grid, limit, strict=True)
    assert outcomes(summary) == [("refused", 0, 0)] * 3
    assert errors(summary, tmp_path)[2] == "c.json: not kept, since b.json was refused (--strict)"
    assert errors(summary, tmp_path)[0] == "a.json: not kept, since b.json was refused (--strict)"
    assert errors(summary, tmp_path)[1].startswith("b.json:1: excursion a of robot r1 disagrees")
    assert digest(grid) == before
    assert outcomes(possmap.fuse(batch, grid, limit))[2] == ("fused", 6, 0)


def test_strict_makes_no_grid_of_nothing_and_takes_known_logs(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    batch = written(tmp_path, a=WHOLE, b=changed(WHOLE, 1, y=0.4))
    possmap.fuse(batch, grid, SETTINGS, strict=True)
    assert not grid.exists()
    assert outcomes(possmap.fuse(batch[:1], grid, SETTINGS, strict=True)) == [("fused", 6, 0)]
    assert outcomes(possmap.fuse(batch[:1], grid, strict=True)) == [("known", 0, 6)]


@pytest.mark.parametrize("strict", [False, True])
def test_a_dry_run_says_the_same_and_writes_nothing(strict: bool, tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    batch = written(
        tmp_path, a=prefix(WHOLE, 2), b=changed(WHOLE, 1, y=0.4), c=log_of("r2"), d=WHOLE
    )
    rehearsed = possmap.fuse(batch, grid, SETTINGS, strict=strict, dry_run=True)
    assert not grid.exists()
    done = possmap.fuse(batch, grid, SETTINGS, strict=strict)
    assert rehearsed.logs == done.logs
    fuse(batch[:1], grid, SETTINGS)
    before = grid.read_bytes()
    rehearsed = possmap.fuse(batch[2:], grid, strict=strict, dry_run=True)
    assert grid.read_bytes() == before
    expected = (
        [("known", 0, 6), ("known", 0, 6)] if not strict else [("fused", 6, 0), ("fused", 4, 2)]
    )
    assert outcomes(rehearsed) == expected == outcomes(possmap.fuse(batch[2:], grid, strict=strict))
