"""Outputs appear whole or not at all: written beside, then renamed."""

from __future__ import annotations

import os
import tempfile
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
        _check(target, name, overwrite)
        handle, beside = tempfile.mkstemp(prefix=f".{target.name}."[:40], dir=target.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                yield stream
            Path(beside).chmod(0o666 & ~_umask())
            Path(beside).replace(target)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error


def _check(path: Path, name: str, overwrite: bool) -> None:
    if path.is_dir():
        raise OutputError(f"{name}: is a folder, expected a file")
    if path.exists() and not overwrite:
        raise OutputError(f"{name}: exists already; --overwrite replaces it")
    if not path.parent.is_dir():
        folder = printable(str(path.parent))
        raise OutputError(f"{name}: the folder {folder} does not exist")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
