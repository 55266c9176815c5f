"""What SQLite's errors mean, in one clear line."""

from __future__ import annotations

import sqlite3

from possmap.errors import GridError, printable
from possmap.grid.bounds import Excess

_IN_WORDS = {
    "attempt to write a readonly database": "may not be written",
    "unable to open database file": "cannot be opened, or its folder may not be written",
    "database or disk is full": "the disk is full",
    "disk I/O error": "the disk failed to read or write it, or a limit on file sizes was reached",
}
_FOR_WAL = frozenset({"attempt to write a readonly database", "unable to open database file"})

ERRORS = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""What a statement may raise."""


def code_of(error: BaseException) -> int:
    """Return SQLite's code of an error; Python's own errors have none."""
    code: int = getattr(error, "sqlite_errorcode", 0)
    return code


def is_busy(error: BaseException) -> bool:
    """Whether another process is in the way."""
    return code_of(error) & 0xFF == sqlite3.SQLITE_BUSY


def is_excess(error: BaseException, longer: bool = True) -> bool:
    """Whether a statement went beyond its bounds; longer : or a value did."""
    beyond = (sqlite3.SQLITE_INTERRUPT, *([sqlite3.SQLITE_TOOBIG] if longer else []))
    return isinstance(error, Excess) or code_of(error) in beyond


def damaged(name: str, what: str) -> GridError:
    """Return the error that says what in the file is not as it was written."""
    return GridError(f"{name}: damaged: {printable(what)[:200]}")


def explained(name: str, error: BaseException, wait_s: float, is_wal: bool) -> GridError:
    """Return what a user is told of one of ERRORS.

    name : of the file; wait_s : how long somebody waited for others; is_wal : whether another
    program has put the file into WAL mode.
    """
    if isinstance(error, MemoryError):
        return damaged(name, "a value takes more memory than there is")
    if isinstance(error, sqlite3.ProgrammingError):  # closed, or of another thread
        return GridError(f"{name}: cannot be used: {printable(str(error))}")
    if not isinstance(error, sqlite3.OperationalError) or "decode" in str(error):
        return damaged(name, str(error))
    if is_busy(error):
        problem = f"in use by another process for more than {wait_s:.0f} s; try again"
    elif code_of(error) == sqlite3.SQLITE_READONLY_ROLLBACK:
        problem = "a writer was interrupted meanwhile; opening the grid again restores it"
    elif is_wal and str(error) in _FOR_WAL:
        problem = (
            "another program has put it into SQLite's WAL mode, and reading it so needs the right"
            " to write it and its folder"
        )
    else:
        problem = _IN_WORDS.get(str(error), f"cannot be used: {printable(str(error))}")
    return GridError(f"{name}: {problem}")
