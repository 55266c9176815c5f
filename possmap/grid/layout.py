"""What tables a grid file has, format by format, and nothing else: files come from anywhere.

SQLite runs what a schema says: a view in place of a table may never end, and a trigger fires when
somebody fuses. So a file whose schema is not to the letter that of its format is not opened.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

from possmap.errors import printable

OBJECTS = "SELECT type, name, sql FROM sqlite_schema WHERE sql IS NOT NULL"
"""Tables, views, triggers and indexes; those that SQLite makes by itself have no SQL."""

_STATISTICS = frozenset({"sqlite_stat1", "sqlite_stat4"})
"""Tables that ANALYZE leaves; SQLite alone reads them."""

Object: TypeAlias = tuple[str, str, str]


def statements(version: int, since: int = 0) -> Iterator[str]:
    """Yield what lays out a file of one format, or what makes one of it from an older one."""
    for number in range(since + 1, version + 1):
        text = Path(__file__).with_name(f"format-{number}.sql").read_text(encoding="utf-8")
        yield from text.split(";\n")


@lru_cache
def _expected(version: int) -> frozenset[Object]:
    blank = sqlite3.connect(":memory:")
    for statement in statements(version):
        blank.execute(statement)
    found = frozenset(blank.execute(OBJECTS))
    blank.close()
    return found


def layout_faults(version: int, found: Iterable[Object]) -> Iterator[str]:
    """Yield in what a file's schema is not that of its format, missing tables first.

    found : what ``OBJECTS`` finds in it.
    """
    expected, there = _expected(version), set(found)
    for kind, name, _ in sorted(expected - there, key=str):
        yield f"the {kind} {name} is missing, or not as possmap made it"
    ours = {(kind, name) for kind, name, _ in expected}
    for kind, name, _ in sorted(there - expected, key=str):
        if (kind, name) not in ours and not (kind == "table" and name in _STATISTICS):
            yield f"the {printable(str(kind))} {printable(str(name))[:80]} is none of possmap's"
