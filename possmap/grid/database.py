"""One connection to a grid file: statements, whole transactions, and errors as one clear line.

The owner's grid is trusted as any database is. Who takes one from a stranger calls
``check_structure`` before anything else: SQLite then looks at every page and every type of the
tables (docs/trust.md).
"""

from __future__ import annotations

import logging
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

from possmap.errors import GridError, printable
from possmap.grid.opening import EMPTY, bytes_held, check_file, is_in_wal_mode, journal_of
from possmap.grid.rows import record_fields_sql

APPLICATION_ID = 0x506F7373
FORMAT_VERSION = 4
"""The first to be released; those before were tried and are not read."""

WAIT_S = 60.0
"""How long a process waits for another that has locked the grid, before it gives up."""

NOTE_S = 1.0
"""After how long it says that it waits."""

MOST_FAULTS = 20
"""Faults that SQLite is asked for; more of them say nothing new."""

Row: TypeAlias = tuple[Any, ...]

log = logging.getLogger(__name__)

_LARGEST = 96 << 20
"""The largest value of a row [bytes]: a log's ``x_`` keys may be as large as its file."""

_SECONDS, _SECONDS_PER_BYTE, _SECONDS_PER_ROW = 10.0, 1e-6, 1e-3
"""CPU time of a statement: of the file's bytes an honest one takes a fiftieth of it at most. A file
whose pages lead to each other in a circle would never end."""

_LOOK_EVERY = 10_000  # steps of SQLite's machine: some 0.2 ms
_LOOK_AGAIN_S = 0.02
_DAMAGE = frozenset(
    {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_TOOBIG, sqlite3.SQLITE_FORMAT}
)
_IN_WORDS = {
    sqlite3.SQLITE_READONLY: "may not be written",
    sqlite3.SQLITE_CANTOPEN: "cannot be opened, or its folder may not be written",
    sqlite3.SQLITE_FULL: "the disk is full",
    sqlite3.SQLITE_IOERR: "the disk failed to read or write it, or a limit on file sizes was "
    "reached",
    sqlite3.SQLITE_BUSY: "in use by another process for more than {wait_s:.0f} s; try again",
    sqlite3.SQLITE_NOMEM: "there is not enough memory",
}
_OBJECTS = "SELECT type, name, sql FROM sqlite_schema WHERE sql IS NOT NULL"
_STATISTICS = frozenset({"sqlite_stat1", "sqlite_stat4"})
"""Tables that ANALYZE leaves; SQLite alone reads them."""


class Database:
    """A connection to a grid file.

    Parameters
    ----------
    path
        The file. Without ``write`` it must exist and is not changed.

    Raises
    ------
    GridError
        If the file is no grid, is cut short, or is of another format.
    """

    def __init__(self, path: Path, write: bool = False) -> None:
        self.name = printable(str(path))
        exists = check_file(path, write)
        self._path = path = path.resolve()  # of a link, the file whose journal counts
        # A journal that an interrupted writer left must be rolled back, which needs write access.
        mode = "rwc" if write else "rw" if journal_of(path).exists() else "ro"
        try:
            self._is_wal = exists and is_in_wal_mode(path)
            self._held = bytes_held(path)
        except OSError as error:
            raise GridError(f"{self.name}: cannot be read: {error.strerror or error}") from error
        with self._explained():
            self._connection = sqlite3.connect(
                f"{path.as_uri()}?mode={mode}",
                uri=True,
                timeout=0,  # it is _patiently that waits
                isolation_level=None,
            )
        self._file = self._identity()
        self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST)
        self.execute("PRAGMA trusted_schema = OFF")
        self.execute("PRAGMA cell_size_check = ON")
        self.execute(f"PRAGMA cache_size = -{1 << 16 if write else 1 << 13}")  # KiB
        self.execute("PRAGMA synchronous = EXTRA")
        if exists:
            self._check_format()
        if write:  # whatever else had it in its hands
            self.execute("PRAGMA journal_mode = DELETE")
            self.execute("PRAGMA fullfsync = ON")  # on macOS a mere fsync stops short
        elif self.is_new():
            self.close()
            raise GridError(f"{self.name}: {EMPTY}")

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
        for statement in _statements():
            self.execute(statement)
        self.execute(f"PRAGMA user_version = {FORMAT_VERSION}")

    def create_refined(self) -> None:
        """Lay out what a refined grid holds besides, inside the transaction that makes it."""
        for statement in _statements("refined.sql"):
            self.execute(statement)

    def is_refined(self) -> bool:
        """Whether the grid was made by ``possmap refine``."""
        return self.one("SELECT 1 FROM sqlite_schema WHERE name = 'refinement'") is not None

    def _check_format(self) -> None:
        """Refuse what is no grid of this format.

        SQLite runs what a schema says: a view in place of a table may never end, and a trigger
        fires when somebody fuses. So the schema must be possmap's to the letter.
        """
        if self.is_new():
            return
        if self.one("PRAGMA application_id") != (APPLICATION_ID,):
            raise GridError(f"{self.name}: an SQLite file, but not a possmap grid")
        (found,) = self.one("PRAGMA user_version") or (0,)
        if found > FORMAT_VERSION:
            raise GridError(
                f"{self.name}: format {found} is newer than this program reads "
                f"({FORMAT_VERSION}); install a newer possmap"
            )
        if found < FORMAT_VERSION:
            raise GridError(
                f"{self.name}: format {found} was never released, expected {FORMAT_VERSION}; "
                "fuse its logs into a new grid"
            )
        expected, there = _schema(), set(self.all(_OBJECTS))
        if self.is_refined():
            expected = _schema("refined.sql")
        for kind, name, _ in sorted(expected - there):
            raise GridError(f"{self.name}: the {kind} {name} is missing, or not as possmap made it")
        for kind, name, _ in sorted(there - expected, key=str):
            if not (kind == "table" and name in _STATISTICS):
                what = f"{printable(str(kind))} {printable(str(name))[:80]}"
                raise GridError(f"{self.name}: the {what} is none of possmap's")

    def check_structure(self) -> None:
        """Look through a file that comes from a stranger.

        Raises
        ------
        GridError
            With the first fault.
        """
        for (fault,) in self.all("PRAGMA quick_check(1)"):
            if fault != "ok":
                raise self.damaged(str(fault))

    def structure_faults(self) -> Iterator[str]:
        """Yield what SQLite finds wrong: pages, indexes, types."""
        for (fault,) in self.all(f"PRAGMA integrity_check({MOST_FAULTS})"):
            if fault != "ok":
                yield f"SQLite: {printable(str(fault))[:200]}"

    def orphans(self) -> Iterator[str]:
        """Yield rows that belong to others that are not there."""
        for table, row, other, _ in self.all("PRAGMA foreign_key_check")[:MOST_FAULTS]:
            which = "a row" if row is None else f"row {row}"
            yield f"{which} of table {table} belongs to a row of {other} that is not there"

    def execute(self, sql: str, values: Sequence[object] = ()) -> int:
        """Run one statement and return the id of the row that it inserted, if it did."""
        with self._explained():
            return self._patiently(sql, values).lastrowid or 0

    def many(self, sql: str, rows: Iterable[Sequence[object]]) -> None:
        """Run one statement for every row."""
        every = rows if isinstance(rows, list) else list(rows)
        with self._explained():
            self._bound_time(len(every))
            self._connection.executemany(sql, every)

    def one(self, sql: str, values: Sequence[object] = ()) -> Row | None:
        """Return the first row of a statement, which may also write; None if it returns none."""
        with self._explained():
            row: Row | None = self._patiently(sql, values).fetchone()
        return row

    def all(self, sql: str, values: Sequence[object] = ()) -> list[Row]:
        """Return all rows: a cursor left open in the middle would hold its lock."""
        with self._explained():
            return self._patiently(sql, values).fetchall()

    def _bound_time(self, rows: int = 0) -> None:
        """Let the next statement take so much CPU time, and no more."""
        allowed = _SECONDS + self._held * _SECONDS_PER_BYTE + rows * _SECONDS_PER_ROW
        until = time.thread_time() + allowed
        # Nothing of this is written in Python, where a signal's handler might run, and SQLite
        # would swallow what that raises.
        is_late = map(until.__lt__, iter(time.thread_time, None))
        self._connection.set_progress_handler(is_late.__next__, _LOOK_EVERY)

    def _patiently(self, sql: str, values: Sequence[object]) -> sqlite3.Cursor:
        """Run a statement; if another process has locked the file, say so and try until WAIT_S.

        SQLite could wait by itself, but says nothing, and would also wait in the middle of a
        transaction, where it can as well use more memory until readers are gone.
        """
        start, noted = time.monotonic(), False
        self._bound_time()
        while True:
            try:
                return self._connection.execute(sql, values)
            except sqlite3.OperationalError as error:
                waited = time.monotonic() - start
                if _code(error) != sqlite3.SQLITE_BUSY or waited >= WAIT_S:
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
            self._check_format()  # somebody else may have made it while this one waited
            yield
            self._check_in_place()
            self.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):  # then its journal stays, and the next to open it does so
                self._connection.rollback()
            raise
        self._check_in_place()

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Read one state of the grid throughout, whoever writes meanwhile."""
        self.execute("BEGIN")
        try:
            self._check_format()
            yield
        finally:
            with suppress(sqlite3.Error):
                self._connection.rollback()

    def _identity(self) -> tuple[int, int] | None:
        """Return which file has the grid's name now."""
        try:
            status = self._path.stat()
        except OSError:
            return None
        return status.st_dev, status.st_ino

    def _check_in_place(self) -> None:
        """Refuse to go on where nobody will ever look: an unlinked file can still be written."""
        if self._file is None or self._identity() != self._file:
            raise GridError(
                f"{self.name}: was removed or replaced while it was written; what was written "
                "since is lost: run the same command again"
            )

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Tell damage, a failing disk and locks in one line; what else SQLite says is our bug."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            told = self._told(error)
            if told is None:
                raise
            raise told from error
        except UnicodeDecodeError as error:
            raise self.damaged(str(error)) from error
        except MemoryError as error:
            raise GridError(f"{self.name}: {_IN_WORDS[sqlite3.SQLITE_NOMEM]}") from error

    def _told(self, error: sqlite3.DatabaseError) -> GridError | None:
        code = _code(error)
        if code in _DAMAGE or "decode" in str(error):
            return self.damaged(str(error))
        if code == sqlite3.SQLITE_INTERRUPT:
            return self.damaged(f"its tables lead to more than its {self._held} bytes can hold")
        if self._is_wal and code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN):
            return GridError(
                f"{self.name}: another program has put it into SQLite's WAL mode, and reading it "
                "so needs the right to write it and its folder"
            )
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_READONLY_ROLLBACK:
            return GridError(
                f"{self.name}: a writer was interrupted meanwhile; opening the grid again "
                "restores it"
            )
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_READONLY_DBMOVED:
            return GridError(f"{self.name}: was removed or replaced while it was written")
        if code in _IN_WORDS:
            return GridError(f"{self.name}: {_IN_WORDS[code].format(wait_s=WAIT_S)}")
        bugs = (sqlite3.IntegrityError, sqlite3.ProgrammingError, sqlite3.NotSupportedError)
        if isinstance(error, bugs) or code in (0, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_MISUSE):
            return None
        return GridError(f"{self.name}: cannot be used: {printable(str(error))}")

    def bare(self, error: Exception) -> str:
        """Return an error's message without the name of the file."""
        return str(error).removeprefix(f"{self.name}: ")

    def damaged(self, what: str) -> GridError:
        """Return the error that says what in the file is not as it was written."""
        return GridError(f"{self.name}: damaged: {printable(what)[:200]}")


def _code(error: BaseException) -> int:
    """Return SQLite's primary code of an error; Python's own errors have none."""
    code: int = getattr(error, "sqlite_errorcode", 0)
    return code & 0xFF


def _statements(name: str = "format.sql") -> list[str]:
    """Return what lays out an empty grid, or what a refined one holds besides."""
    text = Path(__file__).with_name(name).read_text(encoding="utf-8")
    return text.replace("{fields}", record_fields_sql()).split(";\n")[:-1]


@lru_cache
def _schema(*besides: str) -> frozenset[tuple[str, str, str]]:
    """Return what ``_OBJECTS`` finds in a grid that was laid out by these files, too."""
    blank = sqlite3.connect(":memory:")
    for name in ("format.sql", *besides):
        for statement in _statements(name):
            blank.execute(statement)
    found = frozenset(blank.execute(_OBJECTS))
    blank.close()
    return found
