"""The rows of a CSV file, and where in them a column stands."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from possmap.errors import RecordingError, did_you_mean, plural, shown
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.clocks import stamps
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.roles import Role
from possmap.lab.recordings.stream import Progress, lines

_NAMED = 20
_COMPARED = 1000  # names, for "did you mean": comparing takes its time
_LOOKED_AT = 100  # rows, for decimal commas
_NUMBER = re.compile(r"[0-9]{1,6}")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?[0-9]*,[0-9]+\s*")
_DELIMITERS = (",", ";", "\t", "|", " ")
_SAID = {"\t": "tabs", " ": "blanks"}


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a CSV file is written.

    delimiter : None: any white space. comma : whether decimals stand behind a comma.
    guessed : what was not told, in words; empty where all was.
    """

    delimiter: str | None = ","
    comma: bool = False
    guessed: str = ""


class CsvColumns:
    """The columns of a CSV file.

    Parameters
    ----------
    place
        ``file:line`` of the first row, for messages.
    first
        The first row.
    header
        Whether it names the columns; they also go by their numbers, from 1.
    """

    def __init__(self, place: str, first: Sequence[str], header: bool) -> None:
        self._place = place
        self._names = [name.strip() for name in first] if header else []
        self._count = len(first)

    def index(self, column: str, further: int = 0) -> int:
        """Return the number of a column, from 0, or of the one so many further on.

        Raises
        ------
        RecordingError
            If there is no such column, with those that there are.
        """
        index = self._index(column) + further
        if index >= self._count:
            problem = f"column {index + 1} is missing, found {plural(self._count, 'column')}"
            raise RecordingError(self._place, problem)
        return index

    def _index(self, column: str) -> int:
        if column in self._names:
            return self._names.index(column)
        if _NUMBER.fullmatch(column) and int(column) > 0:
            return int(column) - 1
        raise missing(self._place, column, self._names, "no header")


def missing(place: str, column: str, names: Sequence[str], otherwise: str) -> RecordingError:
    """Return the error of a column that is missing, with those that there are."""
    have = ", ".join(shown(name) for name in names[:_NAMED]) or otherwise
    guess = did_you_mean(column, names[:_COMPARED])
    return RecordingError(place, f"column {shown(column)} is missing, found {have}{guess}")


def dialect_of(path: Path, mapping: Mapping, table: Table) -> Dialect:
    """Return how a file is written: as the mapping says, or by its first rows.

    The first delimiter that shows every column, with a number in it, is taken.
    """
    if mapping.delimiter is not None:
        delimiter = None if mapping.delimiter == " " else mapping.delimiter
        return Dialect(delimiter, mapping.decimal == ",")
    for delimiter in _DELIMITERS:
        said = Dialect(None if delimiter == " " else delimiter)
        fields = list(_fields(path, mapping, said, table.columns))
        comma = delimiter != "," and any(map(_DECIMAL_COMMA.fullmatch, chain(*fields)))
        comma = comma if mapping.decimal is None else mapping.decimal == ","
        if not fields or not _are_numbers(fields[0], mapping, table.columns, comma):
            continue
        what = [f"fields parted by {_SAID.get(delimiter, delimiter)}"] * (delimiter != ",")
        what += ["decimal commas"] * (comma and mapping.decimal is None)
        return Dialect(said.delimiter, comma, " and ".join(what))
    return Dialect(",", mapping.decimal == ",")


def _fields(
    path: Path, mapping: Mapping, dialect: Dialect, columns: MappingABC[Role, str]
) -> Iterator[list[str]]:
    """Yield what stands in the mapped columns of the first rows; nothing if one is missing."""
    rows = csv_rows(path, mapping, dialect, Tally(), None)
    first = next(rows, (0, []))[1]
    header = mapping.header is not False
    try:
        find = CsvColumns("", first, header)
        at = [find.index(column) for column in columns.values()]
    except RecordingError:
        return
    for row in chain(() if header else [first], (row for _, row in islice(rows, _LOOKED_AT))):
        if len(row) > max(at, default=0):
            yield [row[index] for index in at]


def _are_numbers(
    fields: Sequence[str], mapping: Mapping, columns: MappingABC[Role, str], comma: bool
) -> bool:
    try:
        for role, field in zip(columns, fields, strict=True):
            text = field.replace(",", ".") if comma else field
            if role == "t":
                stamps(text, mapping.time_format)
            else:
                float(text)
    except ValueError:
        return False
    return True


def csv_rows(
    path: Path, mapping: Mapping, dialect: Dialect, tally: Tally, progress: Progress | None
) -> Iterator[tuple[int, list[str]]]:
    """Yield line and fields of each row, the header among them.

    A quoted field ends on its line: what a lost quote can spoil is one row, not all behind it.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    """
    comment = ("#" if mapping.comment is None else mapping.comment).encode()
    delimiter = dialect.delimiter
    ends = "\r\n" if delimiter in (";", None) else "\r\n;"
    for number, line in lines(path, tally, progress):
        if number == 1:
            line = line.removeprefix(codecs.BOM_UTF8)
        if not line.strip() or (comment and line.startswith(comment)):
            continue
        text = line.decode("utf-8", "replace").rstrip(ends)
        fields = _unquoted(text, delimiter) if '"' in text else text.split(delimiter)
        yield number, [one.replace(",", ".") for one in fields] if dialect.comma else fields


def _unquoted(text: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        text, delimiter = " ".join(text.split()), " "
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        return []
