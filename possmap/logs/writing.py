"""Logs written record by record, in any of the three encodings (docs/logs.md)."""

from __future__ import annotations

import csv
import gzip
import io
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TextIO, cast

from possmap.atomic import replacing
from possmap.errors import OutputError, printable
from possmap.logs import SUFFIXES, encoding_of
from possmap.logs.csv_log import COLUMNS
from possmap.settings.limits import Limits

EXTRA_COLUMN = "x_yaw"
"""A pose's key that a CSV has a column for."""

LEG = "-leg-"
"""What stands before a leg's number in the name of its excursion."""


class LogWriter(Protocol):
    """Writes excursions, one after the other."""

    def begin(self, head: Mapping[str, Any]) -> None:
        """Begin an excursion: robot, excursion, perhaps a model, ``x_`` keys."""

    def record(self, record: Mapping[str, Any]) -> None:
        """Write its next record."""

    def end(self) -> None:
        """End the excursion."""


class _Bounded(io.TextIOWrapper):
    """The text of a log, no larger than a reader takes unasked."""

    def __init__(self, stream: BinaryIO, path: Path) -> None:
        super().__init__(stream, encoding="utf-8", newline="\n")
        self._path, self._mib = path, Limits().limit_file_mib
        self._left = int(self._mib * 2**20)  # of characters: all are ASCII

    def write(self, text: str) -> int:
        self._left -= len(text)
        if self._left < 0:
            raise OutputError(
                f"{printable(str(self._path))}: becomes larger than {self._mib:g} MiB, which fuse "
                "does not take (limit_file_mib); --legs and a folder make several logs of it"
            )
        return super().write(text)


class _Json:
    """One log as JSON that people can read: one record a line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._first = True

    def begin(self, head: Mapping[str, Any]) -> None:
        text = json.dumps({"possmap_log": 1, **head})[:-1]
        self._stream.write(f'{text},\n  "records": [')

    def record(self, record: Mapping[str, Any]) -> None:
        self._stream.write(("\n" if self._first else ",\n") + f"    {json.dumps(record)}")
        self._first = False

    def end(self) -> None:
        self._stream.write("\n  ]}\n")


class _JsonLines:
    """Any number of logs, one behind the other."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def begin(self, head: Mapping[str, Any]) -> None:
        self.record({"possmap_log": 1, **head})

    def record(self, record: Mapping[str, Any]) -> None:
        self._stream.write(json.dumps(record) + "\n")

    def end(self) -> None:
        """Nothing is left to write."""


class _Csv:
    """Any number of excursions in one table; models have no place in it."""

    def __init__(self, stream: TextIO) -> None:
        columns = [*COLUMNS, EXTRA_COLUMN]
        self._rows = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
        self._rows.writeheader()
        self._name: dict[str, Any] = {}

    def begin(self, head: Mapping[str, Any]) -> None:
        self._name = {"robot": head["robot"], "excursion": head["excursion"]}

    def record(self, record: Mapping[str, Any]) -> None:
        flags = {k: str(v).lower() for k, v in record.items() if isinstance(v, bool)}
        self._rows.writerow({**self._name, **record, **flags})

    def end(self) -> None:
        """Nothing is left to write."""


class _Folder:
    """A folder of logs, a JSON file for each excursion."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._open = ExitStack()
        self._log: _Json | None = None
        self._names: set[str] = set()

    def begin(self, head: Mapping[str, Any]) -> None:
        # A colon may stand in a robot's name, but not in a file's on every system.
        name = f"{head['robot']}_{head['excursion']}.json".replace(":", "-")
        while name in self._names:
            name = name.replace(".json", "+.json")
        self._names.add(name)
        path = self._folder / name
        stream = self._open.enter_context(_Bounded(path.open("wb"), Path(name)))
        self._log = _Json(stream)
        self._log.begin(head)

    def record(self, record: Mapping[str, Any]) -> None:
        if self._log is not None:
            self._log.record(record)

    def end(self) -> None:
        if self._log is not None:
            self._log.end()
        self.close()

    def close(self) -> None:
        """Close the file of an excursion that was not ended."""
        self._log = None
        self._open.close()


def is_folder(path: Path) -> bool:
    """Whether logs written to a path become a folder of files: it is one, or has no suffix."""
    return path.is_dir() or not path.suffix


def check_name(path: Path, several: bool) -> None:
    """Raise OutputError if logs cannot be written under this name.

    Parameters
    ----------
    several
        Whether there may be more than one.
    """
    name = printable(str(path))
    if name == "-":
        raise OutputError("-: logs are not written to standard output, expected a file or folder")
    if is_folder(path):
        return
    encoding = encoding_of(path)
    if encoding is None:
        expected = ", ".join(SUFFIXES)
        raise OutputError(
            f"{name}: unknown suffix, expected one of {expected}, perhaps with .gz, or a folder"
        )
    if encoding == ".json" and several:
        raise OutputError(f"{name}: a JSON file holds one log, expected .jsonl, .csv or a folder")


@contextmanager
def writing(path: Path, overwrite: bool) -> Iterator[LogWriter]:
    """Open a log, or a folder of logs, to write; it appears whole or not at all.

    Raises
    ------
    OutputError
        If it exists and ``overwrite`` is off, or cannot be written.
    """
    if is_folder(path):
        with _new_folder(path, overwrite) as folder, closing(_Folder(folder)) as logs:
            yield logs
        return
    encoding = encoding_of(path)
    kinds: dict[str, Callable[[TextIO], LogWriter]] = {".json": _Json, ".csv": _Csv}
    with replacing(path, overwrite) as stream, ExitStack() as stack:
        raw = stream
        if path.suffix.lower() == ".gz":
            # No name and no time in the file: one recording gives one set of bytes.
            packed = stack.enter_context(gzip.GzipFile("", "wb", 6, stream, mtime=0))
            raw = cast("BinaryIO", packed)
        text = _Bounded(raw, path)
        writer: LogWriter = kinds.get(encoding or "", _JsonLines)(text)
        try:
            yield writer
        finally:  # also of what comes to nothing: the streams below are closed by themselves
            text.detach()


@contextmanager
def _new_folder(path: Path, overwrite: bool) -> Iterator[Path]:
    """Yield a folder beside; what is in it moves to its place when the block ends well."""
    name = printable(str(path))
    if path.exists() and not path.is_dir():
        raise OutputError(f"{name}: is no folder")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise OutputError(
            f"{name}: holds something already; --overwrite replaces logs of the same outings"
        )
    try:
        with tempfile.TemporaryDirectory(dir=path.resolve().parent, prefix=".possmap-") as beside:
            yield Path(beside)
            path.mkdir(exist_ok=True)
            logs = sorted(Path(beside).iterdir())
            outings = {_outing(log) for log in logs}
            for old in path.glob("*.json"):  # other legs of the same outing would count it twice
                if _outing(old) in outings:
                    old.unlink()
            for log in logs:
                log.replace(path / log.name)
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error


def _outing(log: Path) -> str:
    """Return what a file's name says of robot and excursion, without the number of a leg."""
    before, leg, number = log.stem.rpartition(LEG)
    return before if leg and number.isdigit() else log.stem
