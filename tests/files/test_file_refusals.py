"""Files that are too large, too deep, cut short or no files: the exact message."""

from __future__ import annotations

import gzip
import io
import os
from pathlib import Path

import pytest

from possmap.errors import LogError
from possmap.logs import read_log, read_stdin
from possmap.settings.limits import Limits

LIMITS = Limits()
SMALL = Limits(limit_file_mib=1 / 1024)  # 1024 bytes

HEADER = b'{"possmap_log": 1, "robot": "r1", "excursion": "a"}\n'
POSE = b'{"seq": %d, "kind": "pose", "x": 0, "y": 0, "heading": 0}\n'
LINES = HEADER + POSE % 0 + POSE % 1
TABLE = b"robot,excursion,seq,kind,x,y,heading\nr1,a,0,pose,0,0,0\nr1,a,1,pose,0,0,0\n"
LOG = b'{"possmap_log": 1,\n"robot": "r1",\n"excursion": "a",\n"records": []}\n'
WHOLE = {"log.json": LOG, "log.jsonl": LINES, "log.csv": TABLE}

CUT = "the last line is cut short; --allow-truncated uses the whole lines before it"


def refusal(path: Path, limits: Limits = LIMITS, allow_truncated: bool = False) -> str:
    """Return why a file is refused, without the folder in front."""
    with pytest.raises(LogError) as caught:
        read_log(path, limits, allow_truncated)
    return str(caught.value).removeprefix(f"{path.parent}/")


def written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


# --- Limits -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["log.json", "log.jsonl", "log.csv"])
def test_a_file_may_be_as_large_as_the_limit_and_no_larger(name: str, tmp_path: Path) -> None:
    problem = "larger than 0.000976562 MiB, decompressed (setting limit_file_mib)"
    for suffix in ("", ".gz"):
        full = WHOLE[name] + b"\n" * (1024 - len(WHOLE[name]))
        assert read_log(written(tmp_path, name + suffix, full), SMALL).deliveries
        path = written(tmp_path, name + suffix, full + b"\n")
        assert refusal(path, SMALL) == f"{name}{suffix}: {problem}"


def test_a_bomb_is_refused_without_being_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.json.gz"
    kibibyte = gzip.compress(b"\n" * 2**20)  # a member holds a thousand times its own size
    path.write_bytes(kibibyte * 4096)  # 4 GiB: it would take many seconds
    assert (
        refusal(path) == "bomb.json.gz: larger than 64 MiB, decompressed (setting limit_file_mib)"
    )


def test_a_stream_is_held_to_the_limit_too() -> None:
    for data in (LINES + b"\n" * 1024, gzip.compress(LINES + b"\n" * 1024)):
        with pytest.raises(LogError, match=r"^stdin: larger than .* \(setting limit_file_mib\)$"):
            read_stdin(io.BytesIO(data), SMALL)


DEPTHS = [
    # (name, log with %s where lists may be nested, line of it, its path, levels around it)
    ("log.json", LOG.replace(b"[]}", b'[],\n"x_a": %s}'), 5, "x_a", 1),
    (
        "log.json",
        LOG.replace(b"[]", b"[\n" + (POSE % 0).replace(b"}", b', "x_a": %s}') + b"]"),
        5,
        "records[0].x_a",
        3,
    ),
    (
        "log.json",
        LOG.replace(b"]}", b'], "carried": [\n{"robot": "b", "excursion": "b", "x_a": %s,\n'
                    b'"records": []}]}'),
        5,
        "carried[0].x_a",
        3,
    ),
    (
        "log.json",
        LOG.replace(b"]}", b'], "carried": [{"robot": "b", "excursion": "b",\n"records": ['
                    + (POSE % 0).replace(b"}", b', "x_a": %s}') + b"]}]}"),
        5,
        "carried[0].records[0].x_a",
        5,
    ),
    ("log.jsonl", LINES.replace(b'"a"}', b'"a", "x_a": %s}'), 1, "x_a", 1),
    ("log.jsonl", LINES + (POSE % 2).replace(b"}", b', "x_a": %s}'), 4, "x_a", 1),
]  # fmt: skip


@pytest.mark.parametrize(("name", "log", "line", "path", "around"), DEPTHS)
@pytest.mark.parametrize("brackets", [("[", "]"), ('{"k": ', "}"), ('[1, {"k": ', "}]")])
def test_sixteen_levels_are_allowed_and_no_more(
    name: str, log: bytes, line: int, path: str, around: int, brackets: tuple[str, str],
    tmp_path: Path,
) -> None:  # fmt: skip
    def nested(levels: int) -> bytes:
        opening, closing = brackets
        count, odd = divmod(levels, opening.count("[") + opening.count("{"))
        inner = "[]" if odd else "0"
        return log % (opening * count + inner + closing * count).encode()

    assert read_log(written(tmp_path, name, nested(16 - around)), LIMITS).deliveries
    found = refusal(written(tmp_path, name, nested(17 - around)))
    assert found == f"{name}:{line}: {path}: nested too deep (setting limit_nesting)"
    looser = Limits(limit_nesting=17)
    assert read_log(written(tmp_path, name, nested(17 - around)), looser).deliveries


@pytest.mark.parametrize("limit", [1, 2, 3])
def test_a_limit_below_the_form_of_a_log_leaves_no_room_for_nesting(
    limit: int, tmp_path: Path
) -> None:
    record = (POSE % 0).replace(b"}", b', "x_a": [[[[[[]]]]]]}')
    path = written(tmp_path, "log.json", LOG.replace(b"[]", b"[" + record + b"]"))
    expected = "log.json:4: records[0].x_a: nested too deep (setting limit_nesting)"
    assert refusal(path, Limits(limit_nesting=limit)) == expected


@pytest.mark.parametrize(
    ("name", "log", "place"),
    [
        ("log.json", b'{"x_a": %s', "1: x_a"),
        ("log.json", LOG.replace(b"[]}", b'[],\n"x_a": %s}'), "5: x_a"),
        ("log.json", LOG.replace(b"[]", b'[\n{"seq":\n%s}]'), "5: records[0]"),
        ("log.json", LOG.replace(b"[]}", b'[],\n"carried": [\n{"x_a": %s]}'), "6: carried[0].x_a"),
        ("log.jsonl", LINES + b"%s\n", "4"),
        ("log.jsonl", LINES + (POSE % 2).replace(b"0}", b"%s}"), "4"),
    ],
)
@pytest.mark.parametrize("bracket", [b"[", b'{"a":'])
def test_a_hundred_thousand_levels_are_refused_quietly(
    name: str, log: bytes, place: str, bracket: bytes, tmp_path: Path
) -> None:
    found = refusal(written(tmp_path, name, log % (bracket * 100_000)))
    assert found == f"{name}:{place}: nested too deep (setting limit_nesting)"


# --- Bytes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WHOLE)
def test_bytes_that_are_not_utf_8_are_refused_with_their_line(name: str, tmp_path: Path) -> None:
    wrong = WHOLE[name].replace(b'"a"', b'"\xe4"').replace(b",a,1", b",\xe4,1")
    line = {"log.json": 3, "log.jsonl": 1, "log.csv": 3}[name]
    for suffix in ("", ".gz"):
        found = refusal(written(tmp_path, name + suffix, wrong))
        assert found == f"{name}{suffix}:{line}: found the byte 0xe4, expected UTF-8"


@pytest.mark.parametrize("name", WHOLE)
def test_utf_16_and_unmarked_gz_are_not_utf_8(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, WHOLE[name].decode().encode("utf-16"))
    assert refusal(path) == f"{name}:1: found the byte 0xff, expected UTF-8"
    path = written(tmp_path, name, gzip.compress(WHOLE[name]))
    assert refusal(path) == f"{name}:1: found the byte 0x8b, expected UTF-8"


def test_what_is_no_gz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.json.gz"
    path.write_bytes(LOG)
    found = refusal(path)
    assert found == "log.json.gz: not a gzip file, or damaged: Not a gzipped file (b'{\"')"
    packed = gzip.compress(LOG)
    path.write_bytes(packed[:-8] + b"\0\0\0\0" + packed[-4:])
    assert refusal(path).startswith("log.json.gz: not a gzip file, or damaged: CRC check failed")
    path.write_bytes(packed + b"rubbish")
    assert refusal(path).startswith("log.json.gz: not a gzip file, or damaged: Not a gzipped file")


# --- Cut short --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["log.json", "log.csv"])
@pytest.mark.parametrize("allow_truncated", [False, True])
def test_json_and_csv_in_a_cut_gz_are_refused(
    name: str, allow_truncated: bool, tmp_path: Path
) -> None:
    packed = gzip.compress(WHOLE[name])
    path = tmp_path / f"{name}.gz"
    for cut in (1, 4, 8, len(packed) // 2, len(packed) - 2):
        path.write_bytes(packed[:-cut])
        expected = f"{name}.gz: the file is cut short"
        assert refusal(path, allow_truncated=allow_truncated) == expected


@pytest.mark.parametrize("name", ["log.json", "log.csv"])
def test_a_cut_character_is_a_cut_file(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, WHOLE[name] + "ä".encode()[:1])
    assert refusal(path) == f"{name}: the file is cut short"


@pytest.mark.parametrize(
    "end",
    [b"{", b'{"seq": 2, "ki', b'{"seq": 2, "kind": "pose", "x_n": "\xc3', b"\xe2\x82", b"tru"],
)
def test_a_cut_last_line_is_refused_unless_the_user_allows_it(end: bytes, tmp_path: Path) -> None:
    path = written(tmp_path, "log.jsonl", LINES + end)
    assert refusal(path) == f"log.jsonl:4: {CUT}"
    log = read_log(path, LIMITS, allow_truncated=True)
    assert [len(d.version.records) for d in log.deliveries] == [2]
    assert log.cut_short == f"{path}:4"
    assert read_log(written(tmp_path, "log.jsonl", LINES), LIMITS, True).cut_short is None


def test_a_cut_line_before_the_last_is_never_allowed(tmp_path: Path) -> None:
    path = written(tmp_path, "log.jsonl", LINES + b'{"seq": 2, "ki\n' + POSE % 2)
    found = refusal(path, allow_truncated=True)
    assert found == "log.jsonl:4: not JSON: Unterminated string starting at"


@pytest.mark.parametrize("cut", [HEADER[:20], HEADER[:1], b"\xc3"])
def test_a_log_cut_in_its_first_line_holds_nothing(cut: bytes, tmp_path: Path) -> None:
    path = written(tmp_path, "log.jsonl", cut)
    assert refusal(path) == f"log.jsonl:1: {CUT}"
    expected = "log.jsonl:1: the file is empty, expected a header line"
    assert refusal(path, allow_truncated=True) == expected


def test_json_lines_in_a_cut_gz_keep_the_lines_before_the_cut(tmp_path: Path) -> None:
    lines = [HEADER, *(POSE % seq for seq in range(2000))]
    packed = gzip.compress(b"".join(lines))
    path = tmp_path / "log.jsonl.gz"
    counts = []
    for share in (0.3, 0.9, 1.0):
        path.write_bytes(packed[: int(share * (len(packed) - 1))])
        place = refusal(path).removesuffix(f": {CUT}")
        log = read_log(path, LIMITS, allow_truncated=True)
        counts.append(len(log.deliveries[0].version.records))
        assert place == f"log.jsonl.gz:{counts[-1] + 2}"
        assert log.cut_short == f"{tmp_path}/{place}"
    assert 0 < counts[0] < counts[1] < counts[2] == 2000


# --- No files ---------------------------------------------------------------------------------

SUFFIXES = ".json, .jsonl, .ndjson, .csv"


@pytest.mark.parametrize("name", ["log.txt", "log", "log.gz", "log.json.bak", "log.json.gz.gz"])
def test_an_unknown_suffix_is_refused(name: str, tmp_path: Path) -> None:
    expected = f"{name}: unknown suffix, expected one of {SUFFIXES}, perhaps with .gz"
    assert refusal(written(tmp_path, name, LOG)) == expected


def test_folders_and_pipes_are_refused_without_waiting(tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    os.mkfifo(tmp_path / "pipe.jsonl")
    assert refusal(tmp_path / "folder.json") == "folder.json: not a regular file"
    assert refusal(tmp_path / "pipe.jsonl") == "pipe.jsonl: not a regular file"


def test_a_file_that_is_not_there_is_said_to_be_so(tmp_path: Path) -> None:
    found = refusal(tmp_path / "none.json")
    assert found == "none.json: cannot be read: No such file or directory"
    long = "n" * 300 + ".json"
    assert refusal(tmp_path / long) == f"{long}: cannot be read: File name too long"
    found = refusal(tmp_path / "nul\0.json")
    assert found == "nul\\x00.json: cannot be read: embedded null byte"


def test_escape_codes_in_a_file_name_are_not_echoed(tmp_path: Path) -> None:
    path = written(tmp_path, "\x1b[2Jlög\n.json", b"")
    expected = "\\x1b[2Jlög\\n.json:1: not JSON: Expecting value (column 1)"
    assert refusal(path) == expected


def test_no_depth_of_nesting_gets_through_as_a_crash(tmp_path: Path) -> None:
    for depth in range(700, 1010):
        nested = b"[" * depth + b"]" * depth
        record = (POSE % 0).replace(b"0}", nested + b"}")
        path = written(tmp_path, "log.json", LOG.replace(b"[]", b"[" + record + b"]"))
        assert refusal(path).startswith("log.json:4: records[0]")
