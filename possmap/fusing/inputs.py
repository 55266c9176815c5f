"""From what the user names on the command line to log files: folders, files, URLs, grids."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from possmap.errors import LogError
from possmap.fusing import urls
from possmap.fusing.ledger_log import read_ledger
from possmap.logs import (
    SUFFIXES,
    LogFile,
    encoding_of,
    read_log,
    read_stdin,
)
from possmap.settings.limits import Limits

STDIN = "-"
GRID_SUFFIX = ".possmap"
TIMES_COMPRESSED = 12
"""How much more text than bytes there is in a compressed log, about."""


def expand(inputs: Iterable[str], recursive: bool = False) -> Iterator[str]:
    """Yield the files that the inputs stand for, a folder's by name.

    recursive : those of folders within folders, too, folder by folder.

    A folder without a log yields itself, so that reading it says what is wrong.

    Raises
    ------
    MissingExtra
        For a URL, if what reads URLs is not installed.
    """
    for name in inputs:
        if urls.is_url(name):
            yield from urls.expand(name)
            continue
        logs = [] if name == STDIN else _logs_in(Path(name), recursive)
        yield from logs or [name]


def _logs_in(path: Path, recursive: bool) -> list[str]:
    """Return the logs in a folder by name; none if it is no folder or may not be read."""
    try:
        if not path.is_dir():
            return []
        here = sorted(path.iterdir())
        logs = [str(one) for one in here if encoding_of(one) is not None and not one.is_dir()]
        if recursive:
            # A link may lead back to where it is.
            folders = [one for one in here if one.is_dir() and not one.is_symlink()]
            logs += [log for folder in folders for log in _logs_in(folder, recursive)]
    except OSError:
        return []  # reading it says why
    return logs


def is_grid(name: str) -> bool:
    """Whether a name is that of a grid, whose ledger is read."""
    is_file = name != STDIN and not urls.is_url(name)
    return is_file and Path(name).suffix.lower() == GRID_SUFFIX


def size_of(name: str) -> int:
    """Return the size of a file [bytes]; 0 if it has none to tell, a guess for a URL."""
    if urls.is_url(name):
        return urls.TYPICAL_SIZE  # to ask takes as long as to read it
    try:
        return 0 if name == STDIN else Path(name).stat().st_size
    except OSError:
        return 0  # reading it says why


def text_of(name: str) -> int:
    """Return about how much text a file holds [bytes], which a compressed one does not show."""
    return size_of(name) * (TIMES_COMPRESSED if name.lower().endswith(".gz") else 1)


def read(name: str, limits: Limits, allow_truncated: bool, folder: str | None = None) -> LogFile:
    """Read one log, or the ledger of a grid as one.

    folder : in which a relative name is looked up; None: this process's.

    Raises
    ------
    LogError
        For a log that cannot be trusted, or a folder without logs.
    GridError
        For a grid that cannot be read, or whose ledger cannot be trusted.
    """
    if name == STDIN:
        return read_stdin(sys.stdin.buffer, limits, allow_truncated)
    if urls.is_url(name):
        return urls.read(name, limits, allow_truncated)
    path = Path(folder or "", name)
    try:
        is_folder = path.is_dir()
        if is_folder:
            next(path.iterdir(), None)  # says so if the folder may not be read
    except OSError as error:
        raise LogError(name, f"cannot be read: {error.strerror or error}") from error
    if is_folder:
        raise LogError(name, f"the folder holds no logs, expected files of {', '.join(SUFFIXES)}")
    if is_grid(name):
        return read_ledger(path, limits)
    return read_log(Path(name), limits, allow_truncated, Path(folder or ""))
