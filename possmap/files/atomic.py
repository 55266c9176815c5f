"""Outputs appear whole or not at all: written beside, then renamed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from possmap.errors import OutputError, printable


@contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[BinaryIO]:
    """Open a file to write; it takes its name when the block ends well, and vanishes otherwise.

    Raises
    ------
    OutputError
        If ``path`` exists and ``overwrite`` is off, its folder does not, or the disk refuses.
    """
    name = printable(str(path))
    try:
        target = path.resolve()  # of a link, what it points to
        check_output(path, overwrite)
        beside = target.with_name(f".{target.name[:40]}.{secrets.token_hex(4)}")
        handle = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            with os.fdopen(handle, "w+b") as stream:
                yield stream
            beside.replace(target)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error


def check_output(path: Path, overwrite: bool) -> None:
    """Raise OutputError if a file cannot take this name: worth asking before long work."""
    name = printable(str(path))
    try:
        target = path.resolve()
        if target.is_dir():
            raise OutputError(f"{name}: is a folder, expected a file")
        if target.exists() and not overwrite:
            raise OutputError(f"{name}: exists already; --overwrite replaces it")
        if not target.parent.is_dir():
            folder = printable(str(target.parent if path.is_symlink() else path.parent))
            raise OutputError(f"{name}: the folder {folder} does not exist")
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error
