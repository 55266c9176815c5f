"""Hostile logs."""

from __future__ import annotations

import gzip
from collections.abc import Callable

from fuzz.making import MIB, Case, text, zipped

HEAD = '{"possmap_log": 1, "robot": "a", "excursion": "1"}\n'
POSE = '{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}\n'
COLUMNS = "robot,excursion,seq,kind,x,y,heading"
LIMIT = "larger than 64 MiB, decompressed (setting limit_file_mib)"
SMALL = LIMIT.replace("64", "8")
MANY = "found more than 100000 excursions (setting limit_file_excursions)"
DEEP = "nested too deep (setting limit_nesting)"


def lines(*records: str) -> Callable[[], bytes]:
    """Return what makes JSON Lines with a header."""
    return lambda: (HEAD + "\n".join(records) + "\n").encode()


def log_of(extra: str) -> Callable[[], bytes]:
    """Return what makes a JSON log with one more key."""
    return text(HEAD.rstrip()[:-1], ', "records": [], ', extra, "}")


LOGS: tuple[Case, ...] = (
    Case(
        "200 MiB of blanks, 200 KiB compressed",
        "gz",
        "a.jsonl.gz",
        lambda: zipped(b" " * MIB for _ in range(200)),
        LIMIT,
    ),
    Case(
        "a gzip header without end",
        "gz",
        "a.jsonl.gz",
        lambda: b"\x1f\x8b\x08\x08" + bytes(6) + b"a" * (9 * MIB),
        SMALL,
        limit_mib=8,
    ),
    Case(
        "half a million empty gzip members",
        "gz",
        "a.jsonl.gz",
        lambda: gzip.compress(b"", mtime=0) * 500_000,
        SMALL,
        limit_mib=8,
    ),
    Case(
        "zeros behind a gzip member",
        "gz",
        "a.jsonl.gz",
        lambda: gzip.compress(HEAD.encode()) + bytes(9 * MIB),
        SMALL,
        limit_mib=8,
    ),
    Case(
        "a JSON nested a million deep",
        "json",
        "a.json",
        text(HEAD.rstrip()[:-1], ', "x_a": ', "[" * 10**6),
        f"x_a: {DEEP}",
    ),
    Case(
        "own keys nested 900 deep",
        "jsonl",
        "a.jsonl",
        lines(POSE.rstrip()[:-1] + ', "x_a": ' + "[" * 900 + "]" * 900 + "}"),
        f"2: x_a: {DEEP}",
    ),
    Case(
        "a number of a million digits",
        "json",
        "a.json",
        log_of(f'"x_a": {"9" * 10**6}'),
        "1: x_a: a number of more than 4300 digits",
    ),
    Case(
        "a number beyond doubles",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip().replace("0,", "1e400,", 1)),
        "2: seq: found Infinity, expected a whole number",
    ),
    Case(
        "a seq of 400 digits",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip().replace("0,", "9" * 400 + ",", 1)),
        "expected 0 to 2^53 - 1",
    ),
    Case(
        "a place at the largest double",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip().replace('"x": 0', '"x": 1.7e308')),
        "2: x: found 1.7e+308, expected a number within ±1e6",
    ),
    Case(
        "NaN in a key of one's own",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip()[:-1] + ', "x_a": [NaN]}'),
        "2: x_a: found NaN, expected a finite number",
    ),
    Case(
        "escape codes for a name",
        "jsonl",
        "a.jsonl",
        text(HEAD.replace('"a"', '"\\u001b[2J"')),
        '1: robot: found "\\u001b[2J", expected 1 to 64 characters of A-Z a-z 0-9 . _ : -',
    ),
    Case(
        "SQL for a name",
        "csv",
        "a.csv",
        text(COLUMNS, "\n'); DROP TABLE record; --,1,0,pose,0,0,0\n"),
        "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -",
    ),
    Case(
        "a path for a name",
        "csv",
        "a.csv",
        text(COLUMNS, "\n../../etc/passwd,1,0,pose,0,0,0\n"),
        "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -",
    ),
    Case(
        "a million columns, the last one twice",
        "csv",
        "a.csv",
        lambda: (COLUMNS + "".join(f",x_{n}" for n in range(10**6)) + ",x_a,x_a\n").encode(),
        '1: the column "x_a" is there twice',
    ),
    Case(
        "a field of 16 MiB",
        "csv",
        "a.csv",
        text(COLUMNS, ",x_a\na,1,0,pose,0,0,0,", "a" * 16 * MIB, "\n"),
        "not CSV: field larger than field limit (131072)",
    ),
    Case(
        "16 MiB of commas",
        "csv",
        "a.csv",
        text(COLUMNS, "\n", "," * 16 * MIB, "\n"),
        "1: a header row and no records below it",
    ),
    Case(
        "a quotation without end",
        "csv",
        "a.csv",
        text(COLUMNS, '\n"', "\n" * MIB),
        "not CSV: field larger than field limit (131072)",
    ),
    Case(
        "150,000 excursions in one CSV",
        "csv",
        "a.csv",
        lambda: (
            COLUMNS + "\n" + "".join(f"a,{n},0,pose,0,0,0\n" for n in range(150_000))
        ).encode(),
        f"100002: {MANY}",
    ),
    Case(
        "150,000 logs in one file",
        "jsonl",
        "a.jsonl",
        lambda: "".join(HEAD.replace('"1"', f'"{n}"') for n in range(150_000)).encode(),
        f"100001: {MANY}",
    ),
    Case(
        "150,000 carried logs",
        "json",
        "a.json",
        lambda: log_of(
            '"carried": ['
            + ", ".join(f'{{"robot":"a","excursion":"{n}","records":[]}}' for n in range(150_000))
            + "]"
        )(),
        f"1: carried[99999]: {MANY}",
    ),
    Case(
        "a header line continued 100,000 times, each time with a new key",
        "jsonl",
        "a.jsonl",
        lambda: (
            HEAD + "".join(f'{{"robot":"a","excursion":"1","x_{n}":0}}\n' for n in range(100_000))
        ).encode(),
        None,
    ),
    Case(
        "500,000 keys in one record",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip()[:-1] + "".join(f', "x_{n}": 0' for n in range(500_000)) + "}"),
        None,
    ),
    Case(
        "one key 500,000 times",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip()[:-1] + ', "x_a": 0' * 500_000 + "}"),
        '2: x_a: the key "x_a" is given twice',
    ),
    Case(
        "one line of 64 MiB, an unknown key",
        "jsonl",
        "a.jsonl",
        text('{"', "k" * (64 * MIB - 100), '": 1}\n'),
        "expected a header line with possmap_log, robot and excursion first",
    ),
    Case(
        "one line of 60 MiB that is text",
        "jsonl",
        "a.jsonl",
        text(HEAD.strip()[:-1], ', "x_a": "', "k" * (60 * MIB), '"}\n'),
        None,
    ),
    Case(
        "8 million empty lists",
        "jsonl",
        "a.jsonl",
        lines(POSE.strip()[:-1] + ', "x_a": [' + "[]," * 8_000_000 + "0]}"),
        "found 8000003 objects and lists, expected at most 2000000 (setting limit_file_objects)",
    ),
    Case(
        "as many objects as may be",
        "json",
        "a.json",
        log_of('"x_a": [' + '{"a":1},' * 1_999_990 + "0]"),
        None,
    ),
    Case(
        "8 MiB of line ends",
        "jsonl",
        "a.jsonl",
        lambda: b"\n" * (8 * MIB),
        "1: the file is empty, expected a header line",
    ),
    Case(
        "bytes that are no UTF-8",
        "json",
        "a.json",
        lambda: b'{"\xff"',
        "1: found the byte 0xff, expected UTF-8",
    ),
    Case("a stream without end", "stdin", "/dev/zero", lambda _: None, LIMIT, writes=True),
)
