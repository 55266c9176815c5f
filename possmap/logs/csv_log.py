"""The CSV encoding: one record a row, any number of excursions (docs/logs.md)."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterator

from possmap.core.records import FIELDS
from possmap.errors import LogError, did_you_mean, shown
from possmap.logs.delivery import refusal
from possmap.logs.excursion import GrowingExcursion, Header, LoggedVersion, too_many
from possmap.logs.fields import Fault, name_of, record_of
from possmap.logs.text import LogText
from possmap.settings.limits import Limits

_TYPES = {field.name: field.type for fields in FIELDS.values() for field in fields}
_FIRST = (
    "robot", "excursion", "seq", "kind", "t", "x", "y", "heading", "x2", "y2", "corner",
    "followed", "hit", "peer", "peer_excursion", "upto",
)  # fmt: skip
COLUMNS = (*_FIRST, *(name for name in _TYPES if name not in _FIRST))
NEEDED = ("robot", "excursion", "seq", "kind")

_FLAGS = {"true": True, "false": False}
_WHOLE_NUMBER = re.compile(r"(-?[0-9]{1,20})(\.0*)?")  # of a column with gaps pandas makes 41.0
_BLANK = re.compile(r"[^\S\r\n]")
_OF_NUMBERS = "0123456789.+-eE"


def read_csv(source: LogText, limits: Limits) -> list[LoggedVersion]:
    """Read every excursion of a CSV file, each as a log of its own; a CSV has no models.

    Raises
    ------
    LogError
        With file and line, for the first thing that cannot be trusted.
    """
    source.check_whole()
    excursions: dict[tuple[str, str], GrowingExcursion] = {}
    line = 1
    try:
        rows = _rows(source)
        line, header = next(rows, (1, []))
        _check_header(header)
        robot_at, excursion_at = header.index("robot"), header.index("excursion")
        columns = [
            (at, name, _decoder(name))
            for at, name in enumerate(header)
            if at not in (robot_at, excursion_at)
        ]
        for line, row in rows:
            if len(row) != len(header):
                raise Fault((), f"found {len(row)} fields, expected {len(header)} as in the header")
            name = (row[robot_at], row[excursion_at])
            if name not in excursions:
                _check_name(*name)
                if len(excursions) == limits.limit_file_excursions:
                    raise too_many(len(excursions))
                excursions[name] = GrowingExcursion(line)
            record = {key: decoded(row[at]) for at, key, decoded in columns if row[at]}
            excursions[name].add(record_of(record, limits.limit_nesting))
        if not excursions:
            raise Fault((), "a header row and no records below it")
    except Fault as fault:
        raise refusal(source.name, line, fault) from None
    return [one.version(Header(*name, (), None, {})) for name, one in excursions.items()]


def _rows(source: LogText) -> Iterator[tuple[int, list[str]]]:
    """Yield each row that has a value, without blanks around them, and the line where it begins."""
    text = io.StringIO(source.text, newline="")
    reader = csv.reader(text, strict=True, skipinitialspace=True)
    has_blanks = _BLANK.search(source.text) is not None
    line = 1
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise LogError(f"{source.name}:{line}", f"not CSV: {error}") from None
        if has_blanks:
            row = [field.strip() for field in row]
        if any(row):
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
        (twice, _), *_ = Counter(header).most_common(1)
        raise Fault((), f"the column {shown(twice)} is there twice")
    for name in NEEDED:
        if name not in header:
            raise Fault((), f"the column {name} is missing")


def _check_name(robot: str, excursion: str) -> None:
    for key, name in (("robot", robot), ("excursion", excursion)):
        if not name:
            raise Fault((key,), "is empty, every row names its robot and excursion")
        name_of(key, name)


def _decoder(key: str) -> Callable[[str], object]:
    """Return what makes of a column's fields what JSON would hold.

    Text that does not fit stays text, to be refused.
    """
    found: type = _TYPES.get(key, str)
    decoders: dict[type, Callable[[str], object]] = {int: _whole, bool: _flag, float: _number}
    return decoders.get(found, str)


def _flag(text: str) -> bool | str:
    return _FLAGS.get(text.lower(), text)


def _whole(text: str) -> int | str:
    found = _WHOLE_NUMBER.fullmatch(text)
    return int(found[1]) if found else text


def _number(text: str) -> float | str:
    # Of these characters float() takes what JSON takes, and numbers such as .5, 1. and +1.
    if text.strip(_OF_NUMBERS):
        return text
    try:
        return float(text)
    except ValueError:
        return text
