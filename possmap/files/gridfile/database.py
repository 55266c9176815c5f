"""Opening a grid file safely, and transactions that hold whole logs.

Format history (``PRAGMA user_version``), each with the statements that it added beside this module:

1. The first format.
2. Deliveries of records that were known already (``again``), and what was forgotten.

An older file is read as it is, and becomes one of the newest format in the transaction that first
writes what the older one cannot hold.
"""

from __future__ import annotations

import logging
import sqlite3
import struct
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias

from possmap.errors import GridError, printable
from possmap.files.gridfile.layout import OBJECTS, layout_faults, statements

APPLICATION_ID = 0x506F7373
FORMAT_VERSION = 2

WAIT_S = 60.0
"""How long a process waits for another that has locked the grid, before it gives up."""

NOTE_S = 1.0
"""After how long it says that it waits."""

LARGEST = 96 * 2**20
"""The largest value of a row [bytes]; a log's ``x_`` keys may be as large as its file."""

Row: TypeAlias = tuple[Any, ...]

log = logging.getLogger(__name__)

_LOOK_AGAIN_S = 0.02
_UNSOUND = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)

_HEADER_SIZE = 100
_IN_WORDS = {
    "attempt to write a readonly database": "may not be written",
    "unable to open database file": "cannot be opened, or its folder may not be written",
    "database or disk is full": "the disk is full",
    "disk I/O error": "the disk failed to read or write it, or a limit on file sizes was reached",
}


class Database:
    """A connection to a grid file; every error of SQLite leaves it as one clear line.

    Parameters
    ----------
    path
        The file. Without ``write`` it must exist and is not changed.
    cache_kib
        How much of it SQLite may keep in memory [KiB].

    Raises
    ------
    GridError
        If the file is no grid, is cut short, or was written by a newer version.
    """

    def __init__(self, path: Path, write: bool = False, cache_kib: int = 1 << 16) -> None:
        self.name = printable(str(path))
        exists = check_file(path, write)
        path = self.path = path.resolve()  # of a link, the file whose journal counts
        # A journal that an interrupted writer left must be rolled back, which needs write access.
        mode = "rwc" if write else "rw" if journal_of(path).exists() else "ro"
        with self._explained():
            self._connection = sqlite3.connect(
                f"{path.as_uri()}?mode={mode}",
                uri=True,
                timeout=0,  # it is _patiently that waits
                isolation_level=None,
            )
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
        self.execute("PRAGMA trusted_schema = OFF")
        self.execute("PRAGMA cell_size_check = ON")
        self.execute(f"PRAGMA cache_size = -{cache_kib}")
        self.execute("PRAGMA synchronous = EXTRA")
        if exists:
            self._check_format()
        if write:  # whatever else had it in its hands
            self.execute("PRAGMA journal_mode = DELETE")
            self.execute("PRAGMA fullfsync = ON")  # on macOS a mere fsync stops short

    def is_new(self) -> bool:
        """Whether nothing was ever committed to the file."""
        return self.one("PRAGMA schema_version") == (0,)

    def state(self) -> tuple[int, int]:
        """Return numbers that change whenever this connection, or another one, changes the file."""
        row = self.one("PRAGMA data_version") or (0,)
        return int(row[0]), self._connection.total_changes

    def create(self) -> None:
        """Lay out an empty grid; inside the transaction that fuses the first logs."""
        self.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self.upgrade()

    @property
    def format(self) -> int:
        """The version of the file's format; 0 if nothing was laid out yet."""
        return int((self.one("PRAGMA user_version") or (0,))[0])

    def upgrade(self) -> None:
        """Give an older file what newer formats added; inside a transaction, which writes it all.

        Nothing that an older format holds is changed, so the digest stays.
        """
        before = self.format
        if before < FORMAT_VERSION:
            for statement in statements(FORMAT_VERSION, since=before):
                self.execute(statement)
            self.execute(f"PRAGMA user_version = {FORMAT_VERSION}")

    def _check_format(self) -> None:
        if self.is_new():
            return
        if self.one("PRAGMA application_id") != (APPLICATION_ID,):
            raise GridError(f"{self.name}: an SQLite file, but not a possmap grid")
        if self.format > FORMAT_VERSION:
            raise GridError(
                f"{self.name}: format {self.format} is newer than this program reads "
                f"({FORMAT_VERSION}); install a newer possmap"
            )
        if self.format < 1:
            raise self.damaged(f"format {self.format}")
        for fault in layout_faults(self.format, self.all(OBJECTS)):
            raise GridError(f"{self.name}: {fault}")

    def execute(self, sql: str, values: Sequence[object] = ()) -> int:
        """Run one statement and return the id of the row that it inserted, if it did."""
        with self._explained():
            return self._patiently(sql, values).lastrowid or 0

    def many(self, sql: str, rows: Iterable[Sequence[object]]) -> None:
        """Run one statement for every row."""
        with self._explained():
            self._connection.executemany(sql, rows)

    def one(self, sql: str, values: Sequence[object] = ()) -> Row | None:
        """Return the first row, or None."""
        with self._explained():
            row: Row | None = self._patiently(sql, values).fetchone()
        return row

    def all(self, sql: str, values: Sequence[object] = ()) -> list[Row]:
        """Return all rows: a cursor left open in the middle would hold its lock."""
        with self._explained():
            rows: list[Row] = self._patiently(sql, values).fetchall()
        return rows

    def _patiently(self, sql: str, values: Sequence[object]) -> sqlite3.Cursor:
        """Run a statement; if another process has locked the file, say so and try until WAIT_S.

        SQLite could wait by itself, but says nothing, and would also wait in the middle of a
        transaction, where it can as well use more memory until readers are gone.
        """
        start, noted = time.monotonic(), False
        while True:
            try:
                return self._connection.execute(sql, values)
            except sqlite3.OperationalError as error:
                waited = time.monotonic() - start
                if not _is_busy(error) or waited >= WAIT_S:
                    raise
            if waited >= NOTE_S and not noted:
                noted = True
                does = "reads" if sql == "COMMIT" else "writes"
                log.warning("waiting for another process that %s %s…", does, self.name)
            time.sleep(_LOOK_AGAIN_S)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything done inside, or, after any error, nothing of it."""
        self.execute("BEGIN IMMEDIATE")
        try:
            self._check_format()  # somebody else may have upgraded it while this one waited
            yield
            self.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):  # then its journal stays, and the next to open it does so
                self._connection.rollback()
            raise

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Read one state of the grid throughout, whoever writes meanwhile."""
        self.execute("BEGIN")
        try:
            self._check_format()
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
            if _is_busy(error):
                problem = f"in use by another process for more than {WAIT_S:.0f} s; try again"
                raise GridError(f"{self.name}: {problem}") from error
            if "decode" in str(error):
                raise self.damaged(str(error)) from error
            if _code(error) == sqlite3.SQLITE_READONLY_ROLLBACK:
                problem = "a writer was interrupted meanwhile; opening the grid again restores it"
                raise GridError(f"{self.name}: {problem}") from error
            problem = _IN_WORDS.get(str(error), f"cannot be used: {printable(str(error))}")
            raise GridError(f"{self.name}: {problem}") from error
        except sqlite3.ProgrammingError as error:  # closed, or of another thread
            raise GridError(f"{self.name}: cannot be used: {printable(str(error))}") from error
        except MemoryError as error:
            raise self.damaged("a value takes more memory than there is") from error
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise self.damaged(str(error)) from error

    def bare(self, error: GridError) -> str:
        """Return an error's message without the name of the file."""
        return str(error).removeprefix(f"{self.name}: ")

    @contextmanager
    def sound(self, what: str) -> Iterator[None]:
        """Turn what cannot have been written so into the error that says it is damaged."""
        try:
            yield
        except (*_UNSOUND, struct.error) as error:
            raise self.damaged(f"{what}: {error}") from error

    def damaged(self, what: str) -> GridError:
        """Return the error that says what in the file is not as it was written."""
        return GridError(f"{self.name}: damaged: {printable(what)[:200]}")


def _is_busy(error: sqlite3.Error) -> bool:
    """Whether another process is in the way."""
    return _code(error) & 0xFF == sqlite3.SQLITE_BUSY


def _code(error: sqlite3.Error) -> int:
    code: int = getattr(error, "sqlite_errorcode", 0)  # Python's own errors have none
    return code


def journal_of(path: Path) -> Path:
    """Return the file that exists beside a grid while somebody writes."""
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
        with path.open("rb") as stream:
            header = stream.read(_HEADER_SIZE)
        # In this order: whoever was committing when we read the header has a journal still, or
        # has made the file as long as the header says.
        if journal_of(path).exists():
            return True  # if its writer was interrupted, SQLite restores the file first
        size = path.stat().st_size
    except OSError as error:
        raise GridError(f"{name}: cannot be read: {error.strerror or error}") from error
    if not header:
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
