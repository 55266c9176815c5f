"""A recording's file as a stream of lines: decompressed, numbered, none too long."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO, TypeAlias, cast

from possmap.errors import RecordingError
from possmap.lab.convert.tally import Tally

LONGEST_LINE = 1 << 20
"""A longer line is no line of a recording [bytes]."""

GZIP_MAGIC = b"\x1f\x8b"
_CHUNK = 1 << 18

Progress: TypeAlias = Callable[[int], None]
"""Told how many bytes of the file were read since it was told last."""


class _Watched(io.RawIOBase):
    """A file that tells how much of it is read."""

    def __init__(self, stream: BinaryIO, progress: Progress | None) -> None:
        self._stream = stream
        self._progress = progress

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self._stream.read(len(buffer))
        buffer[: len(data)] = data
        if self._progress is not None:
            self._progress(len(data))
        return len(data)


class _Unpacked(io.RawIOBase):
    """What a compressed stream holds, up to its very cut: GzipFile.read would lose the last."""

    def __init__(self, stream: BinaryIO) -> None:
        self._gzip = gzip.GzipFile(fileobj=stream)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self._gzip.read1(len(buffer))
        buffer[: len(data)] = data
        return len(data)


@contextmanager
def opened(path: Path, progress: Progress | None = None) -> Iterator[io.BufferedReader]:
    """Open a file for reading; what begins like gzip is decompressed.

    Raises
    ------
    RecordingError
        If it cannot be read or is no regular file.
    """
    if "\0" in str(path):
        raise RecordingError(str(path), "cannot be read: a null character in the name")
    try:
        if not S_ISREG(path.stat().st_mode):  # opening a FIFO would wait for ever
            what = "is a folder" if path.is_dir() else "not a regular file"
            raise RecordingError(str(path), f"{what}, expected the file of a recording")
        with path.open("rb") as stream:
            watched = io.BufferedReader(_Watched(stream, progress), _CHUNK)
            if watched.peek(2)[:2] == GZIP_MAGIC:
                unpacked = io.BufferedReader(_Unpacked(cast("BinaryIO", watched)), _CHUNK)
                yield cast("io.BufferedReader", unpacked)
            else:
                yield cast("io.BufferedReader", watched)
    except (gzip.BadGzipFile, zlib.error) as error:
        raise RecordingError(str(path), f"not a gzip file, or damaged: {error}") from error
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror or error}") from error


def head_of(path: Path, size: int = 1 << 16) -> bytes:
    """Return a file's first bytes, decompressed, as far as they can be read."""
    with opened(path) as stream:
        try:
            return stream.read1(size)
        except EOFError:
            return b""


def lines(
    path: Path, tally: Tally, progress: Progress | None = None
) -> Iterator[tuple[int, bytes]]:
    """Yield the number, from 1, and the bytes of each line that is not too long.

    Compressed data that ends too early is counted, and what comes before it is used.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    """
    with opened(path, progress) as stream:
        number = 0
        while True:
            number += 1
            try:
                line = stream.readline(LONGEST_LINE)
            except EOFError:
                tally.add("compressed files cut short, used up to the cut", f"{path}:{number}")
                return
            if not line:
                return
            if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
                tally.add("lines longer than 1 MiB, skipped", f"{path}:{number}")
                _skip_line(stream)
                continue
            yield number, line


def _skip_line(stream: io.BufferedReader) -> None:
    while True:
        part = stream.readline(LONGEST_LINE)
        if not part or part.endswith(b"\n"):
            return
