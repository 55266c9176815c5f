"""A worker's folder is another one: whole names of files there, and the user's in all it says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from possmap.errors import printable
from possmap.fusing import urls
from possmap.fusing.stages import Read
from possmap.logs import LogFile


def whole(name: str) -> str:
    """Return a name by which any process finds the file: the user's, behind this folder's."""
    if urls.is_url(name) or Path(name).is_absolute():
        return name
    folder = str(Path.cwd()).rstrip("/")
    return f"{folder}/{name}"  # not tidied: what was put before comes off again


def as_given(read: Read, name: str) -> Read:
    """Return what was read of a log by its whole name as if by the name that the user gave.

    Files are named first in whatever is said of them, and nowhere else.
    """
    folder = read.path.removesuffix(name)
    if not folder:
        return read
    log = None if read.log is None else _within(read.log, folder)
    error = None if read.error is None else read.error.removeprefix(printable(folder))
    return read._replace(path=name, log=log, error=error)


def _within(log: LogFile, folder: str) -> LogFile:
    origin = replace(log.origin, name=log.origin.name.removeprefix(folder))
    deliveries = tuple(
        replace(one, place=one.place.removeprefix(folder), origin=origin) for one in log.deliveries
    )
    cut_short = None if log.cut_short is None else log.cut_short.removeprefix(folder)
    return replace(log, origin=origin, deliveries=deliveries, cut_short=cut_short)
