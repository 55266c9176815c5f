"""Outputs appear whole or not at all: written beside, then renamed."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
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
    with replacing_all((path,), overwrite) as (stream,):
        yield stream


@contextmanager
def replacing_all(paths: Sequence[Path], overwrite: bool) -> Iterator[Sequence[BinaryIO]]:
    """Open files that belong together; all take their names when the block ends well, or none.

    If the machine stops between two renames, the first path's file is the one that is missing or
    old: it is the one that names the others.

    Raises
    ------
    OutputError
        If one of them exists and ``overwrite`` is off, its folder does not, the disk refuses, or
        two are one file.
    """
    name = " and ".join(printable(str(path)) for path in paths)
    try:
        for path in paths:
            check_output(path, overwrite)
        targets = [path.resolve() for path in paths]  # of a link, what it points to
        if len(set(targets)) < len(targets):
            raise OutputError(f"{name}: lead to one file, expected {len(targets)}")
        besides = [name_beside(target) for target in targets]
        try:
            with ExitStack() as opened:
                yield [opened.enter_context(_created(beside)) for beside in besides]
            _rename(besides, targets)
        except BaseException:
            for beside in besides:
                beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error


def name_beside(target: Path) -> Path:
    """Return a name in the same folder that nothing has."""
    return target.with_name(f".{target.name[:40]}.{secrets.token_hex(4)}")


def leftovers(target: Path) -> list[Path]:
    """Return the files beside a target that bear such names: their programs were killed."""
    target = target.resolve()
    begin, digits = f".{target.name[:40]}.", set("0123456789abcdef")
    return sorted(
        one
        for one in target.parent.iterdir()
        if one.name.startswith(begin)
        and len(one.name) == len(begin) + 8
        and digits.issuperset(one.name[-8:])
    )


def _created(path: Path) -> BinaryIO:
    return os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666), "w+b")


def _rename(besides: Sequence[Path], targets: Sequence[Path]) -> None:
    """Give all files their names, the first last; if one cannot have it, take back the others'."""
    done: list[tuple[Path, Path | None]] = []
    try:
        for beside, target in reversed(list(zip(besides, targets, strict=True))):
            kept = _kept(target) if len(targets) > 1 else None
            done.append((target, kept))
            try:
                beside.replace(target)
            except BaseException:
                done.pop()
                if kept is not None:
                    kept.unlink(missing_ok=True)
                raise
    except BaseException:
        for target, kept in done:
            with contextlib.suppress(OSError):
                if kept is None:
                    target.unlink()
                else:
                    kept.replace(target)
        raise
    for _, kept in done:
        if kept is not None:
            kept.unlink(missing_ok=True)


def _kept(target: Path) -> Path | None:
    """Keep what has a name now under another one too; None if there is nothing to keep."""
    if not target.exists():
        return None
    kept = name_beside(target)
    try:
        os.link(target, kept)
    except OSError:  # not every file system has links
        shutil.copyfile(target, kept)
    return kept


def check_output(path: Path, overwrite: bool) -> None:
    """Raise OutputError if a file cannot take this name: worth asking before long work."""
    name = printable(str(path))
    try:
        target = path.resolve()
        if target.is_dir():
            raise OutputError(f"{name}: is a folder, expected a file")
        if target.exists() and not target.is_file():  # a rename would put a file in its place
            raise OutputError(f"{name}: not a regular file, expected one or none")
        if target.exists() and not overwrite:
            raise OutputError(f"{name}: exists already; --overwrite replaces it")
        if not target.parent.is_dir():
            folder = printable(str(target.parent if path.is_symlink() else path.parent))
            raise OutputError(f"{name}: the folder {folder} does not exist")
    except RuntimeError as error:  # until Python 3.13
        raise OutputError(f"{name}: a link that leads to itself, expected a file") from error
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error
