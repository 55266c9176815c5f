"""How much one statement may do and return: no more than the file can hold, however forged it is.

SQLite follows a b-tree wherever its pages point. If all inner pages of three levels point to one
child, a file of 190 kB has 10⁸ rows; a chain of pages that leads back to itself makes a value of
any length. An honest statement of possmap takes at most some 3 steps of SQLite's machine per byte
of the file (0.3 were measured), each some 50 ns, and a row of the file at least 8 bytes. The time,
of the processor and not of the clock, is bounded too: rows may be long, and sorted on the disk.
"""

from __future__ import annotations

import sqlite3
from itertools import islice
from marshal import dumps
from random import randrange
from time import thread_time
from typing import Any

SHORT = 16 * 2**10
"""The largest value that is read where names and numbers are expected [bytes]."""

CELLS = 2**20
"""The largest value that is read where the cells of a tile are expected [bytes]."""

LARGEST = 96 * 2**20
"""The largest value of a row [bytes]; a log's ``x_`` keys may be as large as its file."""

_LOOK_EVERY = 10_000  # steps: some 0.2 ms
_STEPS = 500_000
_STEPS_PER_BYTE = 6
_STEPS_PER_ROW = 1000
_SECONDS = 2.0
_SECONDS_PER_BYTE = 1e-6
_SECONDS_PER_ROW = 1e-3
_ROWS = 1000
_BYTES_PER_ROW = 8
_WEIGHT = 64 * 2**20
_WEIGHT_PER_BYTE = 32
"""Of rows in Python's hands: a join says the name of a file again with all that it brought."""


_EACH = 8
"""One row of so many is weighed, for to weigh takes time; which ones, nobody knows beforehand."""

_AT_ONCE = 4 * 2**20
"""What the longest values of a column of rows that are fetched together may take [bytes]."""


class Excess(Exception):
    """A statement returned more than the file can hold."""


class Bounds:
    """What statements of one connection may do.

    Parameters
    ----------
    connection
        Gets a handler that stops a statement which takes too many steps; SQLite then reports that
        it was interrupted.
    held
        What the file held when it was opened, with what lay beside it [bytes].
    """

    def __init__(self, connection: sqlite3.Connection, held: int) -> None:
        self._connection = connection
        self._at_first = self._held = held
        self._pages_at_first: int | None = None
        self._longest = 0
        self._allow(0)

    @property
    def held(self) -> int:
        """What the file is known to hold [bytes]."""
        return self._held

    def start_reading(self, longest: int) -> None:
        """Begin a statement that reads; a value is never longer than the file."""
        self.start(min(longest, max(self._held, SHORT)))

    def start(self, longest: int, rows: int = 0) -> None:
        """Begin a statement.

        longest : the largest value that it may read or write [bytes]; rows : how many it writes.
        """
        looks = self._looks + rows * _STEPS_PER_ROW // _LOOK_EVERY
        until = thread_time() + self._seconds + rows * _SECONDS_PER_ROW
        # Whether it is late, so many times, and then the end: nothing of this is written in Python,
        # where a signal's handler might run, and SQLite would swallow what that raises.
        is_late = map(until.__lt__, islice(iter(thread_time, None), looks))
        self._connection.set_progress_handler(is_late.__next__, _LOOK_EVERY)
        if longest != self._longest:
            self._longest = longest
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, longest)

    def _allow(self, grown: int) -> None:
        self._held = self._at_first + grown
        self._looks = (_STEPS + self._held * _STEPS_PER_BYTE) // _LOOK_EVERY
        self._seconds = _SECONDS + self._held * _SECONDS_PER_BYTE

    def take_in(self, cursor: sqlite3.Cursor) -> list[tuple[Any, ...]]:
        """Return all rows of a statement.

        Raises
        ------
        Excess
            If they are more than the file can hold, before they take much more memory than that.
        """
        most_rows = _ROWS + self._held // _BYTES_PER_ROW
        most_weight = _WEIGHT + self._held * _WEIGHT_PER_BYTE
        at_once = max(1, _AT_ONCE // self._longest)
        rows: list[tuple[Any, ...]] = []
        weight = 0
        while True:
            some = cursor.fetchmany(at_once)
            rows += some
            weight += _EACH * len(dumps(some[randrange(_EACH) :: _EACH], 2))
            if len(some) < at_once:
                return rows
            if len(rows) > most_rows or weight > most_weight:
                raise Excess

    def has_grown(self, pages: int, page_size: int) -> bool:
        """Note how many pages the file has, and their size [bytes]; whether that allows more."""
        if self._pages_at_first is None:
            self._pages_at_first = pages
        before = self._held
        self._allow(max(0, pages - self._pages_at_first) * page_size)
        return self._held > before
