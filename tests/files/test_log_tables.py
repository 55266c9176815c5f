"""The two line-by-line encodings: JSON Lines and CSV (docs/logs.md)."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest
from literal.teams import CSV_COLUMNS, as_csv, random_team

from possmap.core.records import Beam, Meet, PartialMap, Pose, Wall
from possmap.logs import LogFile, read_log
from possmap.settings.limits import Limits

LIMITS = Limits()

HEADER = '{"possmap_log": 1, "robot": "r1", "excursion": "a"}'
CARRIED = '{"robot": "r2", "excursion": "b"}'


def read(folder: Path, name: str, text: str, allow_truncated: bool = False) -> LogFile:
    path = folder / name
    path.write_bytes(text.encode())
    return read_log(path, LIMITS, allow_truncated)


def lines(*line: str) -> str:
    return "".join(f"{one}\n" for one in line)


def pose(seq: int, x: float = 0) -> str:
    return f'{{"seq": {seq}, "kind": "pose", "x": {x}, "y": 0, "heading": 0}}'


def found(log: LogFile) -> list[tuple[str, str, int, tuple[str, str] | None, int]]:
    """Of each delivery: robot, excursion, records, carrier, and the line where it begins."""
    return [
        (*d.version.name, len(d.version.records), d.carrier, int(d.place.rpartition(":")[2]))
        for d in log.deliveries
    ]


# --- JSON Lines -------------------------------------------------------------------------------


def test_a_header_with_a_version_begins_a_log_and_one_without_a_carried_excursion(
    tmp_path: Path,
) -> None:
    text = lines(HEADER, pose(0), CARRIED, pose(0), pose(4), HEADER.replace("r1", "r3"), pose(0))
    assert found(read(tmp_path, "log.jsonl", text)) == [
        ("r1", "a", 1, None, 1),
        ("r2", "b", 2, ("r1", "a"), 3),
        ("r3", "a", 1, None, 6),
    ]


def test_naming_an_excursion_opened_before_continues_it_its_own_included(tmp_path: Path) -> None:
    own = '{"robot": "r1", "excursion": "a"}'
    text = lines(HEADER, pose(0), CARRIED, pose(0), own, pose(1, 5), CARRIED, pose(1), pose(2))
    log = read(tmp_path, "log.jsonl", text)
    assert found(log) == [("r1", "a", 2, None, 1), ("r2", "b", 3, ("r1", "a"), 3)]
    assert log.deliveries[0].version.records[1] == Pose(1, None, 5.0, 0.0, 0.0)


def test_each_log_of_a_file_carries_its_own_version_of_an_excursion(tmp_path: Path) -> None:
    other = HEADER.replace("r1", "r3")
    text = lines(HEADER, CARRIED, pose(0), pose(1), other, CARRIED, pose(0))
    assert found(read(tmp_path, "log.jsonl", text)) == [
        ("r1", "a", 0, None, 1),
        ("r2", "b", 2, ("r1", "a"), 2),
        ("r3", "a", 0, None, 5),
        ("r2", "b", 1, ("r3", "a"), 6),
    ]


def test_the_same_log_twice_in_a_file_is_two_versions_of_it(tmp_path: Path) -> None:
    text = lines(HEADER, pose(0), HEADER, pose(0), pose(1))
    assert found(read(tmp_path, "log.jsonl", text)) == [
        ("r1", "a", 1, None, 1),
        ("r1", "a", 2, None, 3),
    ]


@pytest.mark.parametrize("again", ["", ', "model": {"drift": 2.0}', ', "model": {}'])
def test_a_header_that_continues_may_repeat_its_model_or_leave_it_out(
    again: str, tmp_path: Path
) -> None:
    first = '{"robot": "r2", "excursion": "b", "model": {"drift": 2}}'
    text = lines(HEADER, first, pose(0), CARRIED.replace("}", again + "}"), pose(1))
    version = read(tmp_path, "log.jsonl", text).deliveries[1].version
    assert (version.model, len(version.records)) == ((("drift", 2.0),), 2)


def test_every_beginning_of_what_a_robot_appends_is_a_valid_log(tmp_path: Path) -> None:
    written = [HEADER, pose(0), pose(1), CARRIED, pose(0), pose(5)]
    counts = [
        [len(d.version.records) for d in read(tmp_path, "a.jsonl", lines(*written[:n])).deliveries]
        for n in range(1, len(written) + 1)
    ]
    assert counts == [[0], [1], [2], [2, 0], [2, 1], [2, 2]]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n \n", "\r\n\r\n"])
def test_line_ends_of_windows_and_blank_lines_are_fine(end: str, tmp_path: Path) -> None:
    log = read(tmp_path, "log.jsonl", end.join([HEADER, pose(0), CARRIED, pose(0)]))
    assert [(*one[:2], one[2]) for one in found(log)] == [("r1", "a", 1), ("r2", "b", 1)]
    assert log.cut_short is None


def test_every_cut_of_the_last_line_leaves_the_lines_before_it(tmp_path: Path) -> None:
    last = '{"seq": 1, "kind": "pose", "x_n": "ä", "x": 0, "y": 0, "heading": 0}'.encode()
    whole = lines(HEADER, pose(0)).encode()
    path = tmp_path / "log.jsonl"
    for cut in range(1, len(last)):
        path.write_bytes(whole + last[:cut])
        log = read_log(path, LIMITS, allow_truncated=True)
        assert len(log.deliveries[0].version.records) == 1
        assert log.cut_short == f"{path}:3"
    path.write_bytes(whole + last)
    assert len(read_log(path, LIMITS).deliveries[0].version.records) == 2


# --- CSV --------------------------------------------------------------------------------------


def csv_versions(folder: Path, text: str) -> list[PartialMap]:
    return [delivery.version for delivery in read(folder, "log.csv", text).deliveries]


@pytest.mark.parametrize("seed", range(4))
def test_columns_may_stand_in_any_order(seed: int, tmp_path: Path) -> None:
    logs = random_team(np.random.default_rng(seed))[0]
    for version in [one for log in logs for one in (log, *log.get("carried", []))]:
        version.pop("model", None)
    rows = [row.split(",") for row in as_csv(logs).splitlines()]
    order = random.Random(seed).sample(range(len(CSV_COLUMNS)), len(CSV_COLUMNS))
    turned = lines(*(",".join(row[column] for column in order) for row in rows))
    straight = csv_versions(tmp_path, as_csv(logs))
    assert straight
    assert csv_versions(tmp_path, turned) == straight


def test_optional_columns_may_be_missing_and_an_empty_field_is_absent(tmp_path: Path) -> None:
    text = lines(
        "robot,excursion,seq,kind,x,y,heading,x2,y2,followed,t,upto,peer,peer_excursion",
        "r1,a,0,meet,,,,,,,,,b,c",
        "r1,a,1,pose,1,2,3,,,,,,,",
        "r1,a,2,wall,1,2,,3,4,,7.5,,,",
        "r1,a,3,wall,1,2,,3,4,false,,,,",
        "r1,a,4,wall,1,2,,3,4,true,,,,",
    )
    assert csv_versions(tmp_path, text)[0].records == (
        Meet(0, None, "b", "c", None),
        Pose(1, None, 1, 2, 3, 0, 0, 0),
        Wall(2, 7.5, 1, 2, 3, 4, True),
        Wall(3, None, 1, 2, 3, 4, False),
        Wall(4, None, 1, 2, 3, 4, True),
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [("5.", 5.0), (".5", 0.5), ("+5", 5.0), ("-1.5E+2", -150.0), ("0005", 5.0), ("1" * 6, 111111)],
)
def test_numbers_are_written_as_programs_write_them(
    text: str, value: float, tmp_path: Path
) -> None:
    table = lines("robot,excursion,seq,kind,x,y,heading", f"r1,a,0,pose,{text},0,0")
    assert csv_versions(tmp_path, table)[0].records == (Pose(0, None, value, 0, 0),)


POSES = "robot,excursion,seq,kind,x,y,heading\nr1,a,0,pose,1,2,3\nr1,a,1,pose,4,5,6\n"
BLANKS = POSES.replace(",", " ,\t").replace("\n", " \n,,,,,,\n , \n")


@pytest.mark.parametrize(
    "text",
    [
        POSES,
        "\ufeff" + POSES,
        POSES.replace("\n", "\r\n"),
        POSES.replace("\n", "\r"),
        POSES.replace("\n", "\n\n"),
        POSES.rstrip("\n"),
        POSES.replace("pose", '"pose"').replace("robot", '"robot"'),
        '\ufeff"robot"' + POSES.removeprefix("robot"),
        BLANKS,
        POSES.replace("1,2,3", '1, "2", " 3"'),
    ],
    ids=[
        "plain", "mark", "windows", "mac", "blank", "no-end", "quoted", "mark-and-quotes",
        "blanks-and-rows-of-nothing", "blanks-and-quotes",
    ],
)  # fmt: skip
def test_marks_line_ends_blanks_and_quotes_change_nothing(text: str, tmp_path: Path) -> None:
    assert [(v.name, v.records) for v in csv_versions(tmp_path, text)] == [
        (("r1", "a"), (Pose(0, None, 1, 2, 3), Pose(1, None, 4, 5, 6)))
    ]


@pytest.mark.parametrize(
    ("text", "flag"), [("TRUE", True), ("True", True), ("FALSE", False), ("fAlse", False)]
)
def test_flags_are_written_as_spreadsheets_and_python_write_them(
    text: str, flag: bool, tmp_path: Path
) -> None:
    table = lines(
        "robot,excursion,seq,kind,x,y,heading,x2,y2,followed,hit,turned,upto,peer,peer_excursion",
        "r1,a,0,pose,1,0,0,,,,,,,,",
        f"r1,a,1,pose,1,0,0,,,,,{text},,,",
        f"r1,a,2,wall,1,2,,3,4,{text},,,,,",
        f"r1,a,3,beam,1,2,,3,4,,{text},,,,",
        "r1,a,4,meet,,,,,,,,,41.0,b,c",  # as pandas writes whole numbers beside gaps
    )
    assert csv_versions(tmp_path, table)[0].records[1:] == (
        Pose(1, None, 1, 0, 0, turned=flag),
        Wall(2, None, 1, 2, 3, 4, flag),
        Beam(3, None, 1, 2, 3, 4, flag),
        Meet(4, None, "b", "c", 41),
    )


def test_excursions_may_be_interleaved(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        "log.csv",
        lines(
            "robot,excursion,seq,kind,x,y,heading",
            "r1,a,0,pose,1,0,0",
            "r1,b,0,pose,2,0,0",
            "r2,a,0,pose,3,0,0",
            "r1,a,9,pose,4,0,0",
            "r1,b,1,pose,5,0,0",
        ),
    )
    assert found(log) == [
        ("r1", "a", 2, None, 2),
        ("r1", "b", 2, None, 3),
        ("r2", "a", 1, None, 4),
    ]
    assert log.deliveries[0].version.records[1] == Pose(9, None, 4, 0, 0)


def test_own_columns_are_kept_as_text_and_may_run_over_lines(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        "log.csv",
        lines(
            "robot,excursion,seq,kind,x,y,heading,x_note",
            'r1,a,0,pose,1,0,0,"two\nlines, ""quoted"""',
            "r1,a,1,pose,1,0,0,",
            "r2,b,0,pose,1,0,0,7",
        ),
    )
    first, second = log.deliveries[0].version.records
    assert json.loads(first.extra) == {"x_note": 'two\nlines, "quoted"'}
    assert second.extra == ""
    assert json.loads(log.deliveries[1].version.records[0].extra) == {"x_note": "7"}
    assert log.deliveries[1].place.endswith("log.csv:5")
