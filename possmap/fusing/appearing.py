"""A new grid file made of an old one: it appears when it is whole, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from possmap.atomic import check_output, name_beside
from possmap.errors import GridError, printable
from possmap.grid.opening import SUFFIXES


@contextmanager
def appearing(path: Path, output: Path, overwrite: bool) -> Iterator[Path]:
    """Lend a name for the new grid; what bears it becomes ``output`` when the block ends well.

    path : the old grid, which it may not replace.

    Raises
    ------
    GridError
        If ``output`` is the old grid, or belongs to a writer that was interrupted.
    OutputError
        If it exists and ``overwrite`` is off, or cannot be written.
    """
    check_output(output, overwrite)
    target = output.resolve()
    if target == path.resolve():
        raise GridError(f"{printable(str(path))}: would replace itself, expected another -o")
    for suffix in SUFFIXES:  # SQLite would take its pages into the new file
        if target.with_name(target.name + suffix).exists():
            left = output.with_name(output.name + suffix)
            raise GridError(
                f"{printable(str(left))}: belongs to a writer that was interrupted, or "
                "still writes; remove it if the grid that it belonged to may go"
            )
    beside = name_beside(target)
    try:
        yield beside
        beside.replace(target)
    except BaseException:
        for suffix in ("", *SUFFIXES):
            beside.with_name(beside.name + suffix).unlink(missing_ok=True)
        raise
