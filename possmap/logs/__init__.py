"""Partial-map logs: one interface to the three encodings, one validation (docs/logs.md)."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from possmap.errors import LogError
from possmap.logs.delivery import Delivery, LogFile, Origin
from possmap.logs.json_lines import read_json_lines
from possmap.logs.json_log import read_json
from possmap.logs.text import LogText, read_stream, read_text
from possmap.settings.limits import Limits

__all__ = [
    "SUFFIXES",
    "Delivery",
    "LogFile",
    "Origin",
    "encoding_of",
    "read_log",
    "read_open",
    "read_stdin",
]

SUFFIXES = (".json", ".jsonl", ".ndjson", ".csv")
"""What a log's name ends with, perhaps with ``.gz`` behind it."""

UNKNOWN_SUFFIX = f"unknown suffix, expected one of {', '.join(SUFFIXES)}, perhaps with .gz"


def encoding_of(path: Path) -> str | None:
    """Return the suffix that tells a log's encoding, or None if the name is not that of a log."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes and suffixes[-1] == ".gz":
        suffixes.pop()
    return suffixes[-1] if suffixes and suffixes[-1] in SUFFIXES else None


def read_log(
    path: Path, limits: Limits, allow_truncated: bool = False, folder: Path = Path()
) -> LogFile:
    """Read one log file, whole.

    folder : in which a relative path is looked up; messages and ledger name the path alone.

    Raises
    ------
    LogError
        ``file:line: field, value found, what was expected``; nothing of the file may be used.
    """
    encoding = encoding_of(path)
    if encoding is None and not (folder / path).exists():
        raise LogError(str(path), "no such file")
    if encoding is None:
        raise LogError(str(path), UNKNOWN_SUFFIX)
    return _parsed(read_text(path, limits, folder), encoding, limits, allow_truncated)


def read_open(
    name: str, path: str, stream: BinaryIO, limits: Limits, allow_truncated: bool = False
) -> LogFile:
    """Read one log, whole, from an open stream.

    Parameters
    ----------
    name
        For messages and the ledger.
    path
        Its suffixes tell the encoding.

    Raises
    ------
    LogError
        As ``read_log``.
    """
    encoding = encoding_of(Path(path))
    if encoding is None:
        raise LogError(name, UNKNOWN_SUFFIX)
    compressed = path.lower().endswith(".gz")
    source = read_stream(name, stream, limits, compressed=compressed)
    return _parsed(source, encoding, limits, allow_truncated)


def _parsed(source: LogText, encoding: str, limits: Limits, allow_truncated: bool) -> LogFile:
    cut_short = None
    if encoding == ".json":
        versions = read_json(source, limits)
    elif encoding == ".csv":
        from possmap.logs.csv_log import read_csv  # the one that few need

        versions = read_csv(source, limits)
    else:
        versions, cut_short = read_json_lines(source, limits, allow_truncated)
    origin = Origin(source.name, source.sha256, source.size)
    deliveries = (
        Delivery.of(one.content, f"{origin.name}:{one.line}", origin, one.carrier)
        for one in versions
    )
    return LogFile(origin, tuple(deliveries), cut_short)


def read_stdin(stream: BinaryIO, limits: Limits, allow_truncated: bool = False) -> LogFile:
    """Read JSON Lines, perhaps compressed, from an open stream."""
    return _parsed(read_stream("stdin", stream, limits), ".jsonl", limits, allow_truncated)
