"""The text of a log file: decompressed, decoded, and no larger than it may be."""

from __future__ import annotations

import gzip
import hashlib
import io
import zlib
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import BinaryIO

from possmap.errors import LogError
from possmap.files.limits import Limits

GZIP_MAGIC = b"\x1f\x8b"
_CHUNK = 1 << 16


@dataclass(frozen=True, slots=True)
class LogText:
    """A log file's text, and what identifies it.

    name : as the user gave it.
    sha256 : of the bytes as delivered, hexadecimal.
    size : of the same [bytes].
    is_cut : whether the compressed stream, or the last character, is cut short.
    """

    name: str
    text: str
    sha256: str
    size: int
    is_cut: bool = False


class _Metered(io.RawIOBase):
    """A binary stream that hashes and counts what is read of it."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.hash = hashlib.sha256()
        self.size = 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self._stream.read(len(buffer))
        buffer[: len(data)] = data
        self.hash.update(data)
        self.size += len(data)
        return len(data)


def read_text(path: Path, limits: Limits) -> LogText:
    """Read a log file; ``.gz`` is decompressed.

    Raises
    ------
    LogError
        If it cannot be read, is no regular file, is too large, or is not UTF-8.
    """
    try:
        if not S_ISREG(path.stat().st_mode):  # opening a FIFO would wait for ever
            raise LogError(str(path), "not a regular file")
        with path.open("rb") as stream:
            return read_stream(str(path), stream, limits, compressed=path.suffix.lower() == ".gz")
    except OSError as error:
        raise LogError(str(path), f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a null character in the name
        raise LogError(str(path), f"cannot be read: {error}") from error


def read_stream(
    name: str, stream: BinaryIO, limits: Limits, compressed: bool | None = None
) -> LogText:
    """Read a log from an open stream; ``compressed=None`` finds out by the first two bytes."""
    metered = _Metered(stream)
    buffered = io.BufferedReader(metered, _CHUNK)
    if compressed is None:
        compressed = buffered.peek(2)[:2] == GZIP_MAGIC
    source = gzip.GzipFile(fileobj=buffered) if compressed else buffered
    largest = int(limits.limit_file_mib * 2**20)
    parts: list[bytes] = []
    size = 0
    is_cut = False
    while size <= largest:
        try:
            part = source.read1(_CHUNK)  # read() would lose what comes before a cut
        except EOFError:
            is_cut = True
            break
        except (gzip.BadGzipFile, zlib.error) as error:
            raise LogError(name, f"not a gzip file, or damaged: {error}") from error
        if not part:
            break
        parts.append(part)
        size += len(part)
    if size > largest:
        limit = f"{limits.limit_file_mib:g} MiB"
        raise LogError(name, f"larger than {limit}, decompressed (setting limit_file_mib)")
    while buffered.read(_CHUNK):  # the hash is of the whole file
        pass
    return _decoded(name, b"".join(parts), metered, is_cut)


def _decoded(name: str, data: bytes, metered: _Metered, is_cut: bool) -> LogText:
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        if error.reason != "unexpected end of data":
            line = data.count(b"\n", 0, error.start) + 1
            found = f"0x{data[error.start]:02x}"
            raise LogError(f"{name}:{line}", f"found the byte {found}, expected UTF-8") from error
        text, is_cut = data[: error.start].decode(), True
    return LogText(name, text, metered.hash.hexdigest(), metered.size, is_cut)
