"""One log in each of its encodings, and what each encoding allows (docs/logs.md)."""

from __future__ import annotations

import copy
import gzip
import io
import json
import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.teams import Log, as_csv, as_jsonl, random_team

from possmap.core.records import Beam, Corner, Meet, PartialMap, Pose, Record, Wall
from possmap.logs import LogFile, read_log, read_stdin
from possmap.settings.limits import Limits

LIMITS = Limits()

EXAMPLE = """\
{
  "possmap_log": 1,
  "robot": "r1",
  "excursion": "2026-05-04-a",
  "model": {"turn_bias": 1.8, "turn_spread": 0.4},
  "records": [
    {"seq": 0, "kind": "pose", "t": 0.0, "x": 0.0, "y": 0.0, "heading": 0.0},
    {"seq": 1, "kind": "pose", "t": 5.1, "x": 3.05, "y": 0.0, "heading": 0.0},
    {"seq": 2, "kind": "pose", "t": 6.0, "x": 3.05, "y": 0.0, "heading": 90.0},
    {"seq": 3, "kind": "wall", "t": 11.0, "x": 3.17, "y": 0.4, "x2": 3.17, "y2": 2.9},
    {"seq": 4, "kind": "corner", "t": 11.0, "x": 3.17, "y": 2.9, "corner": "end"},
    {"seq": 5, "kind": "pose", "t": 11.2, "x": 3.05, "y": 3.05, "heading": 90.0},
    {"seq": 6, "kind": "meet", "t": 12.0, "peer": "r2", "peer_excursion": "2026-05-04-b", "upto": 41}
  ],
  "carried": [
    {"robot": "r2", "excursion": "2026-05-04-b", "records": []}
  ]
}
"""  # noqa: E501
EXAMPLE_RECORDS: tuple[Record, ...] = (
    Pose(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    Pose(1, 5.1, 3.05, 0.0, 0.0, 0.0, 0.0, 0.0),
    Pose(2, 6.0, 3.05, 0.0, 90.0, 0.0, 0.0, 0.0),
    Wall(3, 11.0, 3.17, 0.4, 3.17, 2.9, True),
    Corner(4, 11.0, 3.17, 2.9, "end"),
    Pose(5, 11.2, 3.05, 3.05, 90.0, 0.0, 0.0, 0.0),
    Meet(6, 12.0, "r2", "2026-05-04-b", 41),
)

HEADER = '{"possmap_log": 1, "robot": "r1", "excursion": "a"}'
START = '{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}'


def write(folder: Path, name: str, data: str | bytes) -> Path:
    path = folder / name
    raw = data.encode() if isinstance(data, str) else data
    path.write_bytes(gzip.compress(raw) if name.endswith(".gz") else raw)
    return path


def read(folder: Path, name: str, data: str | bytes) -> LogFile:
    return read_log(write(folder, name, data), LIMITS)


def versions(log: LogFile) -> list[PartialMap]:
    return [delivery.version for delivery in log.deliveries]


def longest(logs: Sequence[LogFile]) -> list[PartialMap]:
    """Of each excursion the longest version, in the order of first appearance."""
    found: dict[tuple[str, str], PartialMap] = {}
    for version in (version for log in logs for version in versions(log)):
        if version.name not in found or len(version.records) > len(found[version.name].records):
            found[version.name] = version
    return list(found.values())


def one_record(folder: Path, fields: str) -> Record:
    """Read a JSON log of a start pose and one more record."""
    records = f'{START}, {{"seq": 1, {fields}}}'
    text = f'{{"possmap_log": 1, "robot": "r1", "excursion": "a", "records": [{records}]}}'
    return versions(read(folder, "log.json", text))[0].records[1]


def lines(*line: str) -> str:
    return "\n".join(line) + "\n"


# --- The three encodings say the same ---------------------------------------------------------


def test_the_documented_example_reads_field_by_field(tmp_path: Path) -> None:
    path = write(tmp_path, "log.json", EXAMPLE)
    own, carried = read_log(path, LIMITS).deliveries
    assert own.version.name == ("r1", "2026-05-04-a")
    assert own.version.model == (("turn_bias", 1.8), ("turn_spread", 0.4))
    assert own.version.records == EXAMPLE_RECORDS
    assert (own.carrier, own.place) == (None, f"{path}:1")
    assert own.origin.name == str(path) and own.origin.size == len(EXAMPLE.encode())
    assert carried.version == PartialMap("r2", "2026-05-04-b", (), ())
    assert (carried.carrier, carried.place) == (("r1", "2026-05-04-a"), f"{path}:16")


@pytest.mark.parametrize("seed", range(8))
def test_random_logs_are_equal_in_every_encoding(seed: int, tmp_path: Path) -> None:
    logs = copy.deepcopy(random_team(np.random.default_rng(seed))[0])
    own = [read(tmp_path, "log.json", json.dumps(log)) for log in logs]
    for name in ("log.jsonl", "log.ndjson", "log.jsonl.gz", "log.ndjson.gz"):
        for log, expected in zip(logs, own, strict=True):
            found = read(tmp_path, name, as_jsonl([log]))
            assert versions(found) == longest([expected])
            assert found.deliveries[0].carrier is None
            assert {d.carrier for d in found.deliveries[1:]} <= {versions(found)[0].name}
    assert longest([read(tmp_path, "all.jsonl", as_jsonl(logs))]) == longest(own)
    for log, expected in zip(logs, own, strict=True):
        assert versions(read(tmp_path, "log.json.gz", json.dumps(log))) == versions(expected)


@pytest.mark.parametrize("seed", range(8))
def test_random_logs_without_models_are_equal_in_csv(seed: int, tmp_path: Path) -> None:
    logs = random_team(np.random.default_rng(seed))[0]
    for version in [one for log in logs for one in (log, *log.get("carried", []))]:
        version.pop("model", None)
    expected = longest([read(tmp_path, "log.json", json.dumps(log)) for log in logs])
    for name in ("log.csv", "log.csv.gz"):
        # A CSV has no header lines: an excursion without records leaves no trace in it.
        assert versions(read(tmp_path, name, as_csv(logs))) == [v for v in expected if v.records]


def test_gz_in_several_members_is_one_text(tmp_path: Path) -> None:
    data = EXAMPLE.encode()
    path = tmp_path / "log.json.gz"
    path.write_bytes(b"".join(gzip.compress(data[i : i + 100]) for i in range(0, len(data), 100)))
    assert versions(read_log(path, LIMITS))[0].records == EXAMPLE_RECORDS


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_stdin_is_json_lines_perhaps_compressed(pack: Callable[[bytes], bytes]) -> None:
    log = read_stdin(io.BytesIO(pack(lines(HEADER, START).encode())), LIMITS)
    assert versions(log) == [PartialMap("r1", "a", (), (Pose(0, None, 0.0, 0.0, 0.0),))]
    assert log.deliveries[0].place == "stdin:1"


@pytest.mark.parametrize("name", ["LOG.JSON", "a.b.2026.JsonL", "log.CSV.GZ", "x.json.csv"])
def test_a_suffix_counts_whatever_its_case_and_what_comes_before(name: str, tmp_path: Path) -> None:
    text = {
        "json": EXAMPLE,
        "jsonl": lines(HEADER),
        "csv": "robot,excursion,seq,kind,x,y,heading\nr1,a,0,pose,0,0,0\n",
    }[name.lower().removesuffix(".gz").rpartition(".")[2]]
    data = gzip.compress(text.encode()) if name.endswith("GZ") else text.encode()
    (tmp_path / name).write_bytes(data)
    assert read_log(tmp_path / name, LIMITS).deliveries[0].version.robot == "r1"


# --- What every encoding takes for the same value ---------------------------------------------


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ('"kind": "pose", "x": 1, "y": 2, "heading": 3', Pose(1, None, 1.0, 2.0, 3.0, 0, 0, 0)),
        ('"kind": "wall", "x": 1, "y": 2, "x2": 3, "y2": 4', Wall(1, None, 1, 2, 3, 4, True)),
        ('"kind": "beam", "x": 1, "y": 2, "x2": 3, "y2": 4', Beam(1, None, 1, 2, 3, 4, True)),
        ('"kind": "meet", "peer": "b", "peer_excursion": "c"', Meet(1, None, "b", "c", None)),
    ],
)
def test_what_is_absent_has_its_default(fields: str, expected: Record, tmp_path: Path) -> None:
    assert one_record(tmp_path, fields) == expected


def test_flags_and_errors_are_taken_as_given(tmp_path: Path) -> None:
    place = '"x": 1, "y": 2, "x2": 3, "y2": 4'
    wall = one_record(tmp_path, f'"kind": "wall", {place}, "followed": false')
    beam = one_record(tmp_path, f'"kind": "beam", {place}, "hit": false')
    pose = one_record(
        tmp_path,
        '"kind": "pose", "x": 1, "y": 2, "heading": 3, '
        '"error_x": 0.1, "error_y": 0.2, "error_heading": 4, "turned": true',
    )
    assert (wall, beam) == (Wall(1, None, 1, 2, 3, 4, False), Beam(1, None, 1, 2, 3, 4, False))
    assert pose == Pose(1, None, 1, 2, 3, 0.1, 0.2, 4, True)


@pytest.mark.parametrize("name", ["log.json", "log.csv"])
@pytest.mark.parametrize("zero", ["0", "0.0", "-0", "-0.0", "-0e5"])
def test_minus_zero_and_whole_numbers_are_plain_doubles(
    zero: str, name: str, tmp_path: Path
) -> None:
    record = f'{{"seq": 0, "kind": "pose", "x": {zero}, "y": 7, "heading": {zero}}}'
    text = {
        "log.json": f'{{"possmap_log": 1, "robot": "r", "excursion": "e", "records": [{record}]}}',
        "log.csv": lines("robot,excursion,seq,kind,x,y,heading", f"r,e,0,pose,{zero},7,{zero}"),
    }[name]
    pose = versions(read(tmp_path, name, text))[0].records[0]
    assert isinstance(pose, Pose)
    assert [repr(v) for v in (pose.x, pose.y, pose.heading_deg)] == ["0.0", "7.0", "0.0"]


def test_the_largest_numbers_are_allowed(tmp_path: Path) -> None:
    last = 2**53 - 1
    records = lines(
        HEADER,
        '{"seq": 0, "kind": "pose", "t": -1e12, "x": 1e6, "y": -1000000, "heading": -1e6}',
        f'{{"seq": {last}, "kind": "meet", "t": 1e12, "peer": "{"p" * 64}", '
        f'"peer_excursion": "A-z.0_9:", "upto": {last}}}',
    )
    assert versions(read(tmp_path, "log.jsonl", records))[0].records == (
        Pose(0, -1e12, 1e6, -1e6, -1e6),
        Meet(last, 1e12, "p" * 64, "A-z.0_9:", last),
    )


def test_meets_may_come_before_the_first_pose_and_seq_may_have_gaps(tmp_path: Path) -> None:
    meet = '"kind": "meet", "peer": "b", "peer_excursion": "c"'
    text = lines(HEADER, f'{{"seq": 0, {meet}}}', START.replace('"seq": 0', '"seq": 900'))
    records = versions(read(tmp_path, "log.jsonl", text))[0].records
    assert records == (Meet(0, None, "b", "c"), Pose(900, None, 0, 0, 0))


def test_time_may_stand_still_and_be_left_out_between(tmp_path: Path) -> None:
    rest = '"kind": "pose", "x": 0, "y": 0, "heading": 0'
    times = ['"t": -3, ', "", '"t": -3.0, ', '"t": 9, ']
    text = lines(HEADER, *(f'{{"seq": {n}, {t}{rest}}}' for n, t in enumerate(times)))
    records = versions(read(tmp_path, "log.jsonl", text))[0].records
    assert [record.t for record in records] == [-3.0, None, -3.0, 9.0]


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("log.json", '{"possmap_log": 1, "robot": "r1", "excursion": "a", "records": []}'),
        ("log.jsonl", HEADER),
    ],
)
def test_empty_records_are_valid_and_a_byte_order_mark_before_them(
    name: str, text: str, mark: str, tmp_path: Path
) -> None:
    assert versions(read(tmp_path, name, mark + text)) == [PartialMap("r1", "a", (), ())]


def test_keys_of_a_json_log_may_come_in_any_order(tmp_path: Path) -> None:
    expected = versions(read(tmp_path, "log.json", EXAMPLE))
    rng = random.Random(5)
    for _ in range(20):
        assert versions(read(tmp_path, "log.json", json.dumps(_shuffled(rng, EXAMPLE)))) == expected


def _shuffled(rng: random.Random, text: str) -> Log:
    def shuffle(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        rng.shuffle(pairs)
        return dict(pairs)

    log: Log = json.loads(text, object_pairs_hook=shuffle)
    return log


def test_own_keys_are_kept_and_not_compared(tmp_path: Path) -> None:
    text = EXAMPLE.replace('"kind": "wall"', '"kind": "wall", "x_note": {"a": [null, 1e3]}')
    text = text.replace('"robot": "r2"', '"x_battery": "low", "robot": "r2"')
    own, carried = versions(read(tmp_path, "log.json", text))
    assert own.records == EXAMPLE_RECORDS
    assert json.loads(own.records[3].extra) == {"x_note": {"a": [None, 1000.0]}}
    assert json.loads(carried.extra) == {"x_battery": "low"}
    assert carried == PartialMap("r2", "2026-05-04-b", (), ())


def test_a_json_log_may_carry_one_excursion_in_two_versions_and_its_own(tmp_path: Path) -> None:
    log = json.loads(EXAMPLE)
    short = {"robot": "r1", "excursion": "2026-05-04-a", "records": log["records"][:2]}
    longer = {**short, "possmap_log": 1, "records": log["records"][:4]}
    log["carried"] = [longer, short]
    found = read(tmp_path, "log.json", json.dumps(log))
    assert [len(version.records) for version in versions(found)] == [7, 4, 2]
    assert [d.carrier for d in found.deliveries] == [None, *[("r1", "2026-05-04-a")] * 2]
