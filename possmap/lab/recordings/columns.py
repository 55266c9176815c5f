"""Where a value stands: in a row of a CSV file by name or number, in one of JSON by its path."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

from possmap.errors import RecordingError, did_you_mean, plural, shown
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping
from possmap.lab.recordings.stream import Progress, lines

Row: TypeAlias = Any
Getter: TypeAlias = Callable[[Row], Any]

_NAMED = 20
_COMPARED = 1000  # names, for "did you mean": comparing takes its time
_STEPS = re.compile(r"([^.\[\]]+)|\[(-?[0-9]{1,6})\]")
_NUMBER = re.compile(r"[0-9]{1,6}")


class CsvColumns:
    """The columns of a CSV file.

    Parameters
    ----------
    path, line
        For messages.
    first
        The first row.
    header
        Whether it names the columns; they also go by their numbers, from 1.
    """

    def __init__(self, path: Path, line: int, first: Sequence[str], header: bool) -> None:
        self._place = f"{path}:{line}"
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
        raise _missing(self._place, column, self._names, "no header")


class JsonPaths:
    """The values of JSON rows, by paths such as ``pose.x`` or ``raw[0]``.

    Parameters
    ----------
    path, line
        For messages.
    first
        A row that has all values.
    """

    def __init__(self, path: Path, line: int, first: Row) -> None:
        self._place = f"{path}:{line}"
        self._first = first

    def __call__(self, column: str) -> Getter:
        """Return what takes a value out of a row.

        Raises
        ------
        RecordingError
            If the first row has no such value, with those that it has.
        """
        if isinstance(self._first, dict) and column in self._first:
            return itemgetter(column)
        steps: list[str | int] = [name or int(index) for name, index in _STEPS.findall(column)]

        def get(row: Row) -> Any:
            for step in steps:
                row = row[step]
            return row

        try:
            get(self._first)
        except (KeyError, IndexError, TypeError):
            names = list(self._first) if isinstance(self._first, dict) else []
            raise _missing(self._place, column, names, shown(self._first)) from None
        return get


def _missing(place: str, column: str, names: Sequence[str], otherwise: str) -> RecordingError:
    have = ", ".join(shown(name) for name in names[:_NAMED]) or otherwise
    guess = did_you_mean(column, names[:_COMPARED])
    return RecordingError(place, f"column {shown(column)} is missing, found {have}{guess}")


def csv_rows(
    path: Path, mapping: Mapping, tally: Tally, progress: Progress | None
) -> Iterator[tuple[int, list[str]]]:
    """Yield line and fields of each row, the header among them.

    A quoted field ends on its line: what a lost quote can spoil is one row, not all behind it.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    """
    comment, delimiter = mapping.comment.encode(), mapping.delimiter
    for number, line in lines(path, tally, progress):
        if number == 1:
            line = line.removeprefix(codecs.BOM_UTF8)
        if not line.strip() or (comment and line.startswith(comment)):
            continue
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if '"' in text:
            yield number, _unquoted(text, delimiter)
        else:
            yield number, text.split(delimiter)


def _unquoted(text: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        text, delimiter = " ".join(text.split()), " "
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        return []
