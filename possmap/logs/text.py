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
from possmap.settings.limits import Limits

GZIP_MAGIC = b"\x1f\x8b"
_CHUNK = 1 << 16
_ROOM = 1 << 16
"""So much longer than its content a compressed file may be: gzip itself adds less [bytes]."""


@dataclass(frozen=True, slots=True)
class LogText:
    """A log file's text, and what identifies it.

    name : as the user gave it.
    text : without a byte-order mark.
    sha256 : of the bytes as delivered, hexadecimal.
    size : of the same [bytes].
    is_cut : whether the compressed stream, or the last character, is cut short.
    """

    name: str
    text: str
    sha256: str
    size: int
    is_cut: bool = False

    def check_whole(self) -> None:
        """Raise LogError if the file is cut short."""
        if self.is_cut:
            raise LogError(self.name, "the file is cut short")

    def check_objects(self, limits: Limits) -> None:
        """Refuse JSON that takes far more memory than text: two letters make an object.

        Raises
        ------
        LogError
            If it holds more objects and lists than it may; brackets within texts count, too.
        """
        most = limits.limit_file_objects
        if len(self.text) <= most:
            return
        found = self.text.count("{") + self.text.count("[")
        if found > most:
            problem = f"found {found} objects and lists, expected at most {most}"
            raise LogError(self.name, f"{problem} (setting limit_file_objects)")


def read_text(path: Path, limits: Limits, folder: Path = Path()) -> LogText:
    """Read a log file; ``.gz`` is decompressed.

    folder : in which a relative path is looked up; the text is named by the path alone.

    Raises
    ------
    LogError
        If it cannot be read, is no regular file, is too large, or is not UTF-8.
    """
    try:
        if not S_ISREG((folder / path).stat().st_mode):  # opening a FIFO would wait for ever
            raise LogError(str(path), "not a regular file")
        with (folder / path).open("rb") as stream:
            return read_stream(str(path), stream, limits, compressed=path.suffix.lower() == ".gz")
    except OSError as error:
        raise LogError(str(path), f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a null character in the name
        raise LogError(str(path), f"cannot be read: {error}") from error


def read_stream(
    name: str, stream: BinaryIO, limits: Limits, compressed: bool | None = None
) -> LogText:
    """Read a log from an open stream; ``compressed=None`` finds out by the first two bytes."""
    largest = int(limits.limit_file_mib * 2**20)
    most = largest + largest // 64 + _ROOM  # of a stream without end, or that holds next to nothing
    limit = f"{limits.limit_file_mib:g} MiB, decompressed (setting limit_file_mib)"
    too_large = LogError(name, f"larger than {limit}")
    data, is_cut = bytearray(), False
    while part := stream.read(_CHUNK):
        data += part
        if len(data) > most:
            raise too_large
    sha256, size = hashlib.sha256(data).hexdigest(), len(data)
    if compressed or (compressed is None and data.startswith(GZIP_MAGIC)):
        data, is_cut = _unpacked(name, data, largest)
    if len(data) > largest:
        raise too_large
    return _decoded(name, data, sha256, size, is_cut)


def _unpacked(name: str, packed: bytearray, largest: int) -> tuple[bytearray, bool]:
    """Return what was compressed, up to a little more than may be, and whether it is cut short."""
    found = bytearray()
    source = gzip.GzipFile(fileobj=io.BytesIO(packed))
    try:
        while len(found) <= largest and (part := source.read1(_CHUNK)):  # read() loses a cut's rest
            found += part
    except EOFError:
        return found, True
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(name, f"not a gzip file, or damaged: {error}") from error
    return found, False


def _decoded(name: str, data: bytearray, sha256: str, size: int, is_cut: bool) -> LogText:
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        if error.reason != "unexpected end of data":
            line = data.count(b"\n", 0, error.start) + 1
            found = f"0x{data[error.start]:02x}"
            raise LogError(f"{name}:{line}", f"found the byte {found}, expected UTF-8") from error
        text, is_cut = data[: error.start].decode(), True
    return LogText(name, text.removeprefix("\ufeff"), sha256, size, is_cut)
