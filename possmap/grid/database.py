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
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from possmap.errors import GridError, printable
from possmap.grid.bounds import LARGEST, SHORT, Bounds, Excess
from possmap.grid.layout import OBJECTS, layout_faults, statements
from possmap.grid.opening import (
    bytes_held,
    check_file,
    is_in_wal_mode,
    journal_of,
)
from possmap.grid.wording import ERRORS, damaged, explained, is_busy, is_excess

__all__ = ["APPLICATION_ID", "FORMAT_VERSION", "Database", "check_file", "journal_of"]

APPLICATION_ID = 0x506F7373
FORMAT_VERSION = 2

WAIT_S = 60.0
"""How long a process waits for another that has locked the grid, before it gives up."""

NOTE_S = 1.0
"""After how long it says that it waits."""

Row: TypeAlias = tuple[Any, ...]
Found = TypeVar("Found")

log = logging.getLogger(__name__)

_LOOK_AGAIN_S = 0.02
_UNSOUND = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)


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
        try:
            self._is_wal = exists and is_in_wal_mode(path)
            held = bytes_held(path)
        except OSError as error:
            raise GridError(f"{self.name}: cannot be read: {error.strerror or error}") from error
        self._refused: GridError | None = None
        with self._explained():
            self._connection = sqlite3.connect(
                f"{path.as_uri()}?mode={mode}",
                uri=True,
                timeout=0,  # it is _patiently that waits
                isolation_level=None,
            )
            self._bounds = Bounds(self._connection, held)
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
        with self._explained():
            self._has_grown()
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
            self._bounds.start(LARGEST)
            return self._patiently(sql, values).lastrowid or 0

    def many(self, sql: str, rows: Iterable[Sequence[object]]) -> None:
        """Run one statement for every row."""
        every = rows if isinstance(rows, list) else list(rows)
        with self._explained():
            self._bounds.start(LARGEST, len(every))
            self._connection.executemany(sql, every)

    def returning(self, sql: str, values: Sequence[object]) -> Row | None:
        """Run one statement that writes, and return the first row that it returns, or None."""
        with self._explained():
            self._bounds.start(LARGEST)
            row: Row | None = self._patiently(sql, values).fetchone()
        return row

    def one(self, sql: str, values: Sequence[object] = (), longest: int = SHORT) -> Row | None:
        """Return the first row, or None; longest : as of ``all``."""

        def first(longest: int) -> Row | None:
            self._bounds.start_reading(longest)
            row: Row | None = self._patiently(sql, values).fetchone()
            return row

        return self._within_bounds(first, longest)

    def all(self, sql: str, values: Sequence[object] = (), longest: int = SHORT) -> list[Row]:
        """Return all rows: a cursor left open in the middle would hold its lock.

        longest : the largest value that an honest file may hold there [bytes].
        """

        def every(longest: int) -> list[Row]:
            self._bounds.start_reading(longest)
            return self._bounds.take_in(self._patiently(sql, values))

        return self._within_bounds(every, longest)

    def _within_bounds(self, read: Callable[[int], Found], longest: int) -> Found:
        """Read; once more, if long values are rare there, or the file has grown meanwhile.

        read : takes the largest value that may come.
        """
        with self._explained():
            try:
                return read(longest if longest < LARGEST else SHORT)
            except (Excess, sqlite3.Error) as error:
                if not is_excess(error) or not (self._has_grown() or longest == LARGEST):
                    raise
                return read(longest)

    def _has_grown(self) -> bool:
        """Note how large the file is now; whether it is larger than was known."""
        self._bounds.start(SHORT)
        pages = [
            self._patiently(f"PRAGMA {what}", ()).fetchone()[0]
            for what in ("page_count", "page_size")
        ]
        return self._bounds.has_grown(*pages)

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
                if not is_busy(error) or waited >= WAIT_S:
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
            if self._refused is None:
                self.execute("COMMIT")
            else:
                with suppress(sqlite3.Error):
                    self._connection.rollback()

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        if self._refused:
            raise self._refused
        try:
            yield
        except (Excess, *ERRORS) as error:
            if is_excess(error, longer=False):  # it takes time, so nothing else is tried
                held = f"its {self._bounds.held} bytes"
                self._refused = self.damaged(f"its tables lead to more than {held} can hold")
                raise self._refused from error
            raise explained(self.name, error, WAIT_S, self._is_wal) from error

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
        return damaged(self.name, what)
