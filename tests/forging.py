"""A grid file changed by somebody who means harm: types and conditions hold him up no longer."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path


def forge(grid: Path, script: str, *values: object) -> int:
    """Run SQL on a grid as if its tables asked for nothing; its schema stays to the letter.

    Returns how many rows a single statement with ``values`` changed; 0 of a script.
    """
    with closing(sqlite3.connect(grid)) as database, database:
        database.execute("PRAGMA writable_schema = ON")
        schema = database.execute("SELECT sql, name FROM sqlite_schema WHERE type = 'table'")
        before = schema.fetchall()
        database.execute(
            "UPDATE sqlite_schema SET sql = replace(replace(sql, ') STRICT, WITHOUT',"
            " ') WITHOUT'), ') STRICT', ')') WHERE type = 'table'"
        )
    count = 0
    with closing(sqlite3.connect(grid)) as database, database:
        database.execute("PRAGMA ignore_check_constraints = ON")
        if values:
            count = database.execute(script, values).rowcount
        else:
            database.executescript(script)
    with closing(sqlite3.connect(grid)) as database, database:
        names = {name for (name,) in database.execute("SELECT name FROM sqlite_schema")}
        database.execute("PRAGMA writable_schema = ON")
        database.executemany(
            "UPDATE sqlite_schema SET sql = ? WHERE name = ?",
            [(sql, name) for sql, name in before if name in names],
        )
    return count
