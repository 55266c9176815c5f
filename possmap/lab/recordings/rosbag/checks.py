"""Files of a bag looked at before rosbags opens them: plain tables and plain metadata."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import yaml

LARGEST_METADATA = 1 << 20
"""Of metadata.yaml [bytes]."""

_MOST_TABLES = 100
_PLAIN = re.compile(r"\s*CREATE\s+(TABLE|(UNIQUE\s+)?INDEX)\b", re.IGNORECASE)
_COMPUTED = re.compile(r"\b(AS|GENERATED)\b", re.IGNORECASE)


class NotPlain(Exception):
    """A file that holds what no bag needs, and that could run or grow without end."""


def check_database(path: Path) -> None:
    """Refuse a database with more than tables and indices: to read a view is to run it.

    Triggers run where something is written, which nobody does here.

    Raises
    ------
    NotPlain
        For a view, a virtual table or a computed column. What is no database, rosbags says.
    """
    with suppress(sqlite3.Error, UnicodeError):
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            found = connection.execute(
                "SELECT type, sql FROM sqlite_master WHERE sql IS NOT NULL LIMIT ?",
                (_MOST_TABLES + 1,),
            ).fetchall()
        if len(found) > _MOST_TABLES:
            raise NotPlain(f"found more than {_MOST_TABLES} tables and indices")
        for kind, sql in found:
            if kind == "trigger":
                continue
            if not isinstance(sql, str) or not _PLAIN.match(sql):
                raise NotPlain("found a view or a virtual table, expected tables of messages")
            if _COMPUTED.search(sql):
                raise NotPlain("found a computed column, expected tables of messages")


def check_metadata(path: Path) -> None:
    """Refuse a metadata.yaml that is large, or larger than it looks.

    Raises
    ------
    NotPlain
        For more than 1 MiB, or an alias. What is no YAML, rosbags says.
    OSError
        If it cannot be read.
    """
    with path.open("rb") as stream:
        data = stream.read(LARGEST_METADATA + 1)
    if len(data) > LARGEST_METADATA:
        raise NotPlain("found a metadata.yaml larger than 1 MiB")
    with suppress(yaml.YAMLError, ValueError):
        for token in yaml.scan(data.decode(), Loader=yaml.SafeLoader):
            if isinstance(token, yaml.AliasToken):
                raise NotPlain("found an alias in metadata.yaml, expected plain values")
