"""The rows of a CSV file, one by one: a bad one spoils no other."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Iterator
from pathlib import Path

from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping
from possmap.lab.recordings.stream import Progress, lines


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
