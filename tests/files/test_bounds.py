"""A statement ends at its bounds, and a signal that comes meanwhile is not lost in it."""

from __future__ import annotations

import signal
import sqlite3
from collections.abc import Iterator
from contextlib import closing

import pytest

from possmap.grid import bounds
from possmap.grid.bounds import Bounds

COUNT = "WITH RECURSIVE n (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM n WHERE n < ?) "
MANY = 10**9
"""Minutes."""


@pytest.fixture
def database() -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(":memory:")) as opened:
        yield opened


def test_a_statement_ends_at_its_steps(database: sqlite3.Connection) -> None:
    Bounds(database, 0).start(1000)
    assert database.execute(COUNT + "SELECT count(*) FROM n", (10_000,)).fetchone() == (10_000,)
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        database.execute(COUNT + "SELECT count(*) FROM n", (MANY,)).fetchone()


def test_a_larger_file_is_allowed_more(database: sqlite3.Connection) -> None:
    Bounds(database, 10**7).start(1000)
    assert database.execute(COUNT + "SELECT max(n) FROM n", (10**6,)).fetchone() == (10**6,)


def test_a_statement_ends_when_it_is_late(
    database: sqlite3.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounds, "_SECONDS", 0.02)
    monkeypatch.setattr(bounds, "_STEPS", MANY * 100)
    Bounds(database, 0).start(1000)
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        database.execute(COUNT + "SELECT count(*) FROM n", (MANY,)).fetchone()


class Told(Exception):
    """What a signal's handler raises, as that of Ctrl-C does."""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="sets a timer")
def test_a_signal_is_heard_and_not_taken_for_damage(database: sqlite3.Connection) -> None:
    def tell(*_: object) -> None:
        raise Told

    def count_until_told(wait: float) -> None:
        several.start(1000)
        signal.setitimer(signal.ITIMER_REAL, wait)
        for _ in range(20):  # each some milliseconds
            database.execute(COUNT + "SELECT count(*) FROM n", (100_000,)).fetchone()

    several = Bounds(database, 10**7)
    before = signal.signal(signal.SIGALRM, tell)
    try:
        for wait in range(1, 41):
            with pytest.raises(Told):
                count_until_told(wait / 10_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
