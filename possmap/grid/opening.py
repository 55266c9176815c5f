"""A look at a grid file, and at the files that SQLite keeps beside it, before SQLite opens them.

SQLite believes what lies beside a grid. A journal may end in the name of a *super-journal*, which
ties together the files that one transaction changed. Whoever rolls the journal back, if only to
read, deletes the file of that name unless it is a super-journal in use: it may be any file of the
user. SQLite looks for the name in the last bytes only, however many headers there are (pager.c,
readSuperJournal). A pipe holds up whoever opens it, and through a link another file is written to.
"""

from __future__ import annotations

import os
import stat
import struct
from contextlib import suppress
from pathlib import Path

from possmap.errors import GridError, printable

EMPTY = "empty: a first fuse that was stopped before its first commit leaves this; run it again"

SUFFIXES = ("-journal", "-wal", "-shm")

_MAGIC = bytes.fromhex("d9d505f920a163d7")
_HEADER_SIZE = 100
_TAIL = 16  # behind the name: its length, its checksum, and the magic bytes of a journal


def journal_of(path: Path) -> Path:
    """Return the file that exists beside a grid while somebody writes."""
    return path.with_name(path.name + "-journal")


def check_sidecars(path: Path) -> None:
    """Look at what lies beside a grid; ``path`` is no link.

    Raises
    ------
    GridError
        If one of them is no regular file, or the journal names another file.
    OSError
        If one cannot be looked at.
    """
    for suffix in SUFFIXES:
        beside = path.with_name(path.name + suffix)
        name = printable(str(beside))
        try:
            mode = beside.lstat().st_mode
        except FileNotFoundError:
            continue
        if not stat.S_ISREG(mode):
            raise GridError(f"{name}: not a regular file, as what SQLite leaves beside a grid is")
        if suffix == "-journal" and _names_another_file(beside, name):
            raise GridError(
                f"{name}: names another file, which SQLite would delete; possmap never writes"
                " such a journal"
            )


def _names_another_file(journal: Path, name: str) -> bool:
    """Whether a journal ends as one with a name does; its checksum is not asked for."""
    try:
        with journal.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            if size < _TAIL:
                return False
            stream.seek(size - _TAIL)
            tail = stream.read(_TAIL)
    except FileNotFoundError:  # its writer has just committed
        return False
    except OSError as error:
        raise GridError(f"{name}: cannot be read: {error.strerror or error}") from error
    return tail[8:] == _MAGIC and tail[:4] != bytes(4)


def is_in_wal_mode(path: Path) -> bool:
    """Whether another program has put a grid into SQLite's WAL mode."""
    with path.open("rb") as stream:
        return stream.read(20)[18:] == b"\x02\x02"


def bytes_held(path: Path) -> int:
    """Return how many bytes a grid and what is beside it take on the disk, without holes."""
    found = 0
    for suffix in ("", *SUFFIXES):
        with suppress(FileNotFoundError):
            status = path.with_name(path.name + suffix).stat()
            found += getattr(status, "st_blocks", -(-status.st_size // 512)) * 512
    return found


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
            check_sidecars(path.resolve())
            return False
        if not path.is_file():
            raise GridError(f"{name}: not a regular file, expected a possmap grid")
        path = path.resolve()
        check_sidecars(path)
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
        raise GridError(f"{name}: {EMPTY}")
    if header[:16] != b"SQLite format 3\0" or len(header) < _HEADER_SIZE:
        raise GridError(f"{name}: not a possmap grid")
    page_size, change, pages = struct.unpack_from(">16xH6xII", header)
    (valid_for,) = struct.unpack_from(">I", header, 92)
    if change == valid_for and size < pages * (page_size if page_size > 1 else 65536):
        raise GridError(f"{name}: cut short: {size} bytes, expected {pages * page_size}")
    return True
