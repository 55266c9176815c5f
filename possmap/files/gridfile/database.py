"""Opening a grid file safely, and transactions that hold whole logs.

Format history (``PRAGMA user_version``):

1. The first format: schema.sql beside this module.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from possmap.errors import GridError, printable

APPLICATION_ID = 0x506F7373
FORMAT_VERSION = 1
SCHEMA = Path(__file__).with_name("schema.sql")

WAIT_S = 60.0
"""How long a writer waits for another before it gives up."""

Row: TypeAlias = tuple[Any, ...]

_HEADER_SIZE = 100
_IN_WORDS = {
    "attempt to write a readonly database": "may not be written",
    "unable to open database file": "cannot be opened, or its folder may not be written",
    "database or disk is full": "the disk is full",
}


class Database:
    """A connection to a grid file; every error of SQLite leaves it as one clear line.

    Parameters
    ----------
    path
        The file. Without ``write`` it must exist and is not changed.

    Raises
    ------
    GridError
        If the file is no grid, is cut short, or was written by a newer version.
    """

    def __init__(self, path: Path, write: bool = False) -> None:
        self.name = printable(str(path))
        exists = check_file(path, write)
        path = self.path = path.resolve()  # of a link, the file whose journal counts
        # A journal that an interrupted writer left must be rolled back, which needs write access.
        mode = "rwc" if write else "rw" if _journal(path).exists() else "ro"
        with self._explained():
            self._connection = sqlite3.connect(
                f"{path.as_uri()}?mode={mode}",
                uri=True,
                timeout=WAIT_S,
                isolation_level=None,
            )
            self._connection.execute("PRAGMA cache_size = -65536")
            self._connection.execute("PRAGMA synchronous = EXTRA")
        if exists and not self.is_new():
            self._check_format()

    def is_new(self) -> bool:
        """Whether nothing was ever committed to the file."""
        return self.one("PRAGMA schema_version") == (0,)

    def create(self) -> None:
        """Lay out an empty grid; inside the transaction that fuses the first logs."""
        for statement in SCHEMA.read_text(encoding="utf-8").split(";\n"):
            self.execute(statement)
        self.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self.execute(f"PRAGMA user_version = {FORMAT_VERSION}")

    def _check_format(self) -> None:
        application = self.one("PRAGMA application_id")
        version = self.one("PRAGMA user_version")
        if application != (APPLICATION_ID,):
            raise GridError(f"{self.name}: an SQLite file, but not a possmap grid")
        if version is not None and version[0] > FORMAT_VERSION:
            raise GridError(
                f"{self.name}: format {version[0]} is newer than this program reads "
                f"({FORMAT_VERSION}); install a newer possmap"
            )

    def execute(self, sql: str, values: Sequence[object] = ()) -> int:
        """Run one statement and return the id of the row that it inserted, if it did."""
        with self._explained():
            return self._connection.execute(sql, values).lastrowid or 0

    def many(self, sql: str, rows: Iterable[Sequence[object]]) -> None:
        """Run one statement for every row."""
        with self._explained():
            self._connection.executemany(sql, rows)

    def one(self, sql: str, values: Sequence[object] = ()) -> Row | None:
        """Return the first row, or None."""
        with self._explained():
            row: Row | None = self._connection.execute(sql, values).fetchone()
        return row

    def all(self, sql: str, values: Sequence[object] = ()) -> list[Row]:
        """Return all rows: a cursor left open in the middle would hold its lock."""
        with self._explained():
            rows: list[Row] = self._connection.execute(sql, values).fetchall()
        return rows

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything done inside, or, after any error, nothing of it."""
        self.execute("BEGIN IMMEDIATE")
        try:
            yield
            self.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.rollback()
            raise

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Read one state of the grid throughout, whoever writes meanwhile."""
        self.execute("BEGIN")
        try:
            yield
        finally:
            self.execute("COMMIT")

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error) or "busy" in str(error):
                problem = f"in use by another process for more than {WAIT_S:.0f} s; try again"
                raise GridError(f"{self.name}: {problem}") from error
            if "decode" in str(error):
                raise self.damaged(str(error)) from error
            problem = _IN_WORDS.get(str(error), f"cannot be used: {printable(str(error))}")
            raise GridError(f"{self.name}: {problem}") from error
        except sqlite3.ProgrammingError as error:  # closed, or of another thread
            raise GridError(f"{self.name}: cannot be used: {printable(str(error))}") from error
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise self.damaged(str(error)) from error

    def damaged(self, what: str) -> GridError:
        """Return the error that says what in the file is not as it was written."""
        return GridError(f"{self.name}: damaged: {printable(what)[:200]}")


def _journal(path: Path) -> Path:
    return path.with_name(path.name + "-journal")


def check_file(path: Path, write: bool) -> bool:
    """Look at the file's first bytes, before SQLite does; return whether it holds anything.

    Raises
    ------
    GridError
        If it cannot be a grid, or with ``write`` cannot become one.
    """
    name = printable(str(path))
    try:
        if not path.exists():
            if not write:
                raise GridError(f"{name}: no such file")
            if not path.parent.is_dir():
                raise GridError(f"{name}: the folder {printable(str(path.parent))} does not exist")
            return False
        if not path.is_file():
            raise GridError(f"{name}: not a regular file, expected a possmap grid")
        path = path.resolve()
        size = path.stat().st_size
        with path.open("rb") as stream:
            header = stream.read(_HEADER_SIZE)
    except OSError as error:
        raise GridError(f"{name}: cannot be read: {error.strerror or error}") from error
    if _journal(path).exists():
        return True  # an interrupted writer: SQLite restores the file before anyone reads it
    if size == 0:
        if write:
            return False  # what is left of a run that was stopped before its first commit
        raise GridError(f"{name}: empty; a first fuse that was stopped leaves this: run it again")
    if header[:16] != b"SQLite format 3\0" or len(header) < _HEADER_SIZE:
        raise GridError(f"{name}: not a possmap grid")
    page_size, change, pages = struct.unpack_from(">16xH6xII", header)
    (valid_for,) = struct.unpack_from(">I", header, 92)
    if change == valid_for and size < pages * (page_size if page_size > 1 else 65536):
        raise GridError(f"{name}: cut short: {size} bytes, expected {pages * page_size}")
    return True
