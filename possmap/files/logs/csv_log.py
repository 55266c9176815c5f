"""The CSV encoding: one record a row, any number of excursions (docs/logs.md)."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator

from possmap.errors import LogError, did_you_mean, shown
from possmap.files.limits import Limits
from possmap.files.logs.builder import ExcursionBuilder, Header
from possmap.files.logs.delivery import Delivery, LogFile, Origin, refusal
from possmap.files.logs.fields import RULES, Fault, name_of, record_of
from possmap.files.logs.text import LogText

COLUMNS = (
    "robot", "excursion", "seq", "kind", "t", "x", "y", "heading", "x2", "y2", "corner",
    "followed", "hit", "peer", "peer_excursion", "upto", "error_x", "error_y", "error_heading",
)  # fmt: skip
NEEDED = ("robot", "excursion", "seq", "kind")

_WHOLE = frozenset({"seq", "upto"})
_FLAGS = {"true": True, "false": False}
_WORDS = frozenset({"kind", "corner", "peer", "peer_excursion"})
_WHOLE_NUMBER = re.compile(r"-?[0-9]{1,20}")
_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")

assert set(COLUMNS) == {"robot", "excursion", "kind"} | {r.name for k in RULES.values() for r in k}


def read_csv(source: LogText, limits: Limits) -> LogFile:
    """Read every excursion of a CSV file, each as a log of its own; a CSV has no models.

    Raises
    ------
    LogError
        With file and line, for the first thing that cannot be trusted.
    """
    if source.is_cut:
        raise LogError(source.name, "the file is cut short")
    origin = Origin(source.name, source.sha256, source.size)
    excursions: dict[tuple[str, str], tuple[int, ExcursionBuilder]] = {}
    line = 1
    try:
        rows = _rows(source)
        line, header = next(rows, (1, []))
        _check_header(header)
        for line, row in rows:
            if len(row) != len(header):
                raise Fault((), f"found {len(row)} fields, expected {len(header)} as in the header")
            fields = {name: text for name, text in zip(header, row, strict=True) if text}
            name = _name_of(fields)
            _, builder = excursions.setdefault(name, (line, ExcursionBuilder()))
            record = {key: _decoded(key, text) for key, text in fields.items()}
            builder.add(record_of(record, limits.limit_nesting))
    except Fault as fault:
        raise refusal(source.name, line, fault) from None
    return LogFile(
        origin,
        tuple(
            Delivery(
                builder.build(Header(robot, excursion, (), None, "")),
                f"{source.name}:{line}",
                origin,
            )
            for (robot, excursion), (line, builder) in excursions.items()
        ),
    )


def _rows(source: LogText) -> Iterator[tuple[int, list[str]]]:
    """Yield each row that is not blank with the line on which it begins."""
    text = source.text.removeprefix("\ufeff")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 1
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise LogError(f"{source.name}:{line}", f"not CSV: {error}") from None
        if row:
            yield line, row
        line = reader.line_num + 1


def _check_header(header: list[str]) -> None:
    if not header:
        raise Fault((), f"the file is empty, expected a header row: {','.join(COLUMNS)}")
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and separator in header[0]:
            raise Fault((), f"separated by {word}, expected commas")
    for name in header:
        if name not in COLUMNS and not name.startswith("x_"):
            guess = did_you_mean(name, COLUMNS) or f", expected one of {', '.join(COLUMNS)}"
            raise Fault((), f"unknown column {shown(name)}{guess}")
    if len(set(header)) != len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise Fault((), f"the column {shown(twice)} is there twice")
    for name in NEEDED:
        if name not in header:
            raise Fault((), f"the column {name} is missing")


def _name_of(fields: dict[str, str]) -> tuple[str, str]:
    for key in ("robot", "excursion"):
        if key not in fields:
            raise Fault((key,), "is empty, every row names its robot and excursion")
    return (
        name_of("robot", fields.pop("robot")),
        name_of("excursion", fields.pop("excursion")),
    )


def _decoded(key: str, text: str) -> object:
    """Return a field as JSON would hold it; text that does not fit stays text, to be refused."""
    if key in _WORDS or key.startswith("x_"):
        return text
    if key in _WHOLE:
        return int(text) if _WHOLE_NUMBER.fullmatch(text) else text
    if key in ("followed", "hit"):
        return _FLAGS.get(text, text)
    return float(text) if _NUMBER.fullmatch(text) else text
