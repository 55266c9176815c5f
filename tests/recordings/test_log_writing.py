"""Logs written record by record: read back they are the same, or nothing is left of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from possmap.errors import OutputError
from possmap.logs import read_log
from possmap.logs.writing import LogWriter, writing
from possmap.settings.limits import Limits

Log = tuple[dict[str, Any], Iterable[dict[str, Any]]]

POSE = {"kind": "pose", "x": 0.5, "y": -1.25, "heading": 90.0}
RECORDS: list[dict[str, Any]] = [
    {"seq": 0, **POSE, "t": 0.125, "error_x": 0.1, "error_heading": 2.0, "x_yaw": -179.99},
    {"seq": 1, "kind": "wall", "t": 1.0, "x": 0.0, "y": 1e-4, "x2": 2.0, "y2": 3.0,
     "followed": False},
    {"seq": 2, "kind": "wall", "x": 0.0, "y": 0.0, "x2": 2.0, "y2": 3.0, "followed": True},
    {"seq": 3, "kind": "beam", "t": 1.5, "x": 0.0, "y": 0.0, "x2": 2.0, "y2": 3.0},
    {"seq": 4, "kind": "beam", "t": 1.5, "x": 0.0, "y": 0.0, "x2": 2.0, "y2": 3.0, "hit": False},
    {"seq": 5, "kind": "corner", "t": 1.75, "x": 0.0, "y": 0.0, "corner": "concave"},
    {"seq": 6, **POSE, "t": 1234567890.123456, "x_yaw": 12.5},
]  # fmt: skip
ONE: Log = ({"robot": "r:1", "excursion": "a"}, RECORDS)
TWO: Log = ({"robot": "r:1", "excursion": "b"}, RECORDS[:1])
OTHER: Log = ({"robot": "r2", "excursion": "a"}, [])
MODEL: Log = (
    {"robot": "r1", "excursion": "m", "model": {"turn_bias": 1.5, "factor": 2.0},
     "x_source": "drive é.bag"},
    RECORDS,
)  # fmt: skip


def write(path: Path, *logs: Log, overwrite: bool = False) -> None:
    with writing(path, overwrite) as writer:
        for head, records in logs:
            tell(writer, head, records)


def tell(writer: LogWriter, head: dict[str, Any], records: Iterable[dict[str, Any]]) -> None:
    writer.begin(head)
    for record in records:
        writer.record(record)
    writer.end()


def excursions(*paths: Path) -> Iterator[tuple[str, str, list[Any], Any]]:
    """Yield robot, excursion, records and model of everything that files hold."""
    for path in paths:
        for delivery in read_log(path, Limits()).deliveries:
            version = delivery.version
            yield version.robot, version.excursion, list(version.records), version.model


def everything(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


SUFFIXES = [".json", ".jsonl", ".ndjson", ".csv"]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Return the records as read from JSON that nobody of possmap wrote."""
    path = tmp_path_factory.mktemp("plain") / "log.json"
    path.write_text(json.dumps({"possmap_log": 1, **ONE[0], "records": RECORDS}))
    ((_, _, records, _),) = excursions(path)
    assert len(records) == len(RECORDS)
    return records


@pytest.mark.parametrize("packed", ["", ".gz"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read_back(
    tmp_path: Path, plain: list[Any], suffix: str, packed: str
) -> None:
    path = tmp_path / f"log{suffix}{packed}"
    write(path, ONE)
    assert [found[:3] for found in excursions(path)] == [("r:1", "a", plain)]
    assert everything(tmp_path) == [path.name]
    assert path.read_bytes().startswith(b"\x1f\x8b") == bool(packed)


def test_a_folder_gets_a_file_for_each(tmp_path: Path, plain: list[Any]) -> None:
    write(tmp_path / "out", ONE, TWO, OTHER)
    assert everything(tmp_path / "out") == ["r-1_a.json", "r-1_b.json", "r2_a.json"]
    found = [one[:3] for one in excursions(*sorted((tmp_path / "out").iterdir()))]
    assert found == [("r:1", "a", plain), ("r:1", "b", plain[:1]), ("r2", "a", [])]
    assert everything(tmp_path)[0] == "out"


def test_names_that_a_file_system_holds_for_one_get_a_file_each(tmp_path: Path) -> None:
    logs: list[Log] = [({"robot": robot, "excursion": "a"}, []) for robot in ("r:1", "r-1", "r_1")]
    write(tmp_path / "out", *logs)
    assert everything(tmp_path / "out") == ["r-1_a+.json", "r-1_a.json", "r_1_a.json"]
    assert {one[0] for one in excursions(*(tmp_path / "out").iterdir())} == {"r:1", "r-1", "r_1"}


@pytest.mark.parametrize("suffix", SUFFIXES[:3])
def test_a_model_and_a_source_are_kept_where_there_is_a_place(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    write(path, MODEL)
    text = path.read_text()
    assert '"turn_bias": 1.5' in text
    assert '"x_source": "drive \\u00e9.bag"' in text
    ((*_, model),) = excursions(path)
    assert dict(model) == MODEL[0]["model"]


def test_a_csv_has_every_column_and_the_bodys_heading(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    write(path, ONE)
    lines = path.read_text().splitlines()
    assert lines[0] == (
        "robot,excursion,seq,kind,t,x,y,heading,x2,y2,corner,followed,hit,peer,peer_excursion,"
        "upto,error_x,error_y,error_heading,turned,x_yaw"
    )
    assert lines[1] == "r:1,a,0,pose,0.125,0.5,-1.25,90.0,,,,,,,,,0.1,,2.0,,-179.99"
    assert lines[2] == "r:1,a,1,wall,1.0,0.0,0.0001,,2.0,3.0,,false,,,,,,,,,"


class OopsError(Exception):
    """Something that goes wrong while a log is written."""


@pytest.mark.parametrize("name", [f"log{a}{b}" for a in SUFFIXES for b in ("", ".gz")] + ["out"])
@pytest.mark.parametrize("stage", [0, 1, 2, 3])
def test_nothing_is_left_when_the_block_fails(tmp_path: Path, name: str, stage: int) -> None:
    def fail(writer: LogWriter) -> None:
        for number, step in enumerate([
            lambda: None,
            lambda: writer.begin(ONE[0]),
            lambda: writer.record(RECORDS[0]),
            writer.end,
        ]):  # fmt: skip
            step()
            if number == stage:
                raise OopsError

    with pytest.raises(OopsError), writing(tmp_path / name, overwrite=False) as writer:
        fail(writer)
    assert everything(tmp_path) == []


def test_a_folder_keeps_its_other_logs(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, ONE, TWO)
    (out / "notes.txt").write_text("mine")
    before = (out / "r-1_b.json").read_bytes()
    write(out, (ONE[0], []), OTHER, overwrite=True)
    assert everything(out) == ["notes.txt", "r-1_a.json", "r-1_b.json", "r2_a.json"]
    assert (out / "r-1_b.json").read_bytes() == before
    ((*_, records, _),) = excursions(out / "r-1_a.json")
    assert records == []


@pytest.mark.parametrize("name", ["log.jsonl", "log.csv", "log.json", "log.jsonl.gz", "logs"])
def test_no_log_becomes_larger_than_fuse_takes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("possmap.logs.writing.Limits", lambda: Limits(limit_file_mib=0.01))
    problem = r"becomes larger than 0.01 MiB, which fuse does not take \(limit_file_mib\)"
    records = [{"seq": seq, **POSE} for seq in range(1000)]
    with pytest.raises(OutputError, match=problem):
        write(tmp_path / name, ({"robot": "r1", "excursion": "a"}, records))
    assert list(tmp_path.iterdir()) == []
