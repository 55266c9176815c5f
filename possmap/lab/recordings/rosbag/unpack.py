"""Chunks of bags unpacked within bounds: rosbags would fill the memory with whatever they hold."""

from __future__ import annotations

import bz2
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

from possmap.lab.recordings.rosbag.checks import check_database

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1

LARGEST_CHUNK = 1 << 28
"""A chunk that holds more is no chunk of a recording [bytes]; recorders begin a new one at 1 MB."""

LARGEST_RATIO = 200
"""A file compressed as a whole holds at most so many times its bytes, and a chunk more."""

_STEP = 1 << 22


class UnpackError(Exception):
    """A chunk that holds more than it may, or less than it should."""


class _Unpacker(Protocol):
    @property
    def eof(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def bound_ros1(reader: Reader1) -> None:
    """Make the reader of a ROS 1 bag, which is open, unpack its chunks within bounds."""
    from rosbags.rosbag1.reader import decompressors

    kinds = {decompressors["bz2"]: bz2.BZ2Decompressor, decompressors["lz4"]: _lz4}
    for at, chunk in reader.chunks.items():
        kind = kinds.get(chunk.decompressor)
        if kind is not None:
            reader.chunks[at] = chunk._replace(decompressor=_bounded(kind))


def bound_mcap() -> None:
    """Make all readers of MCAP unpack chunks within bounds; they have this table in common."""
    with suppress(ImportError):
        from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

        for name, kind in (("lz4", _lz4), ("zstd", _zstd)):
            unpack = _bounded(kind)
            DECOMPRESSORS[name] = lambda data, size, unpack=unpack: unpack(data, size)  # type: ignore[misc]


@contextmanager
def bounded_ros2() -> Iterator[None]:
    """Make readers of ROS 2 bags unpack within bounds, and open what is plain.

    Within the block databases are looked at first, and profiles of quality of service are left
    unread: they are YAML, which takes long, and nothing here asks for them.
    """
    from rosbags.rosbag2 import reader, storage_sqlite3

    bound_mcap()
    database = storage_sqlite3.Sqlite3Reader
    modules: list[Any] = [reader, storage_sqlite3]
    if not isinstance(modules[0].zstd, _BoundedZstd):
        modules[0].zstd = _BoundedZstd(modules[0].zstd)
    with suppress(ImportError):
        from rosbags.rosbag2 import storage_mcap

        modules.append(storage_mcap)
    found = [module.parse_qos for module in modules]
    open_database = database.open
    for module in modules:
        module.parse_qos = lambda _: []

    def open_checked(self: Any) -> None:
        check_database(self.path)
        open_database(self)

    database.open = open_checked  # type: ignore[method-assign]
    try:
        yield
    finally:
        database.open = open_database  # type: ignore[method-assign]
        for module, function in zip(modules, found, strict=True):
            module.parse_qos = function


class _BoundedZstd:
    """What rosbags uses of the module zstd."""

    def __init__(self, module: Any) -> None:
        self._module = module
        self._unpack = _bounded(_zstd)

    def decompress(self, data: bytes) -> bytes:
        return self._unpack(data)

    @contextmanager
    def open(self, file: BinaryIO, mode: str) -> Iterator[_BoundedFile]:
        most = LARGEST_RATIO * os.fstat(file.fileno()).st_size + LARGEST_CHUNK
        with self._module.open(file, mode) as stream:
            yield _BoundedFile(stream, most)


class _BoundedFile:
    """A stream that ends in an error behind so many bytes."""

    def __init__(self, stream: BinaryIO, most: int) -> None:
        self._stream = stream
        self._left = self._most = most

    def read(self, size: int) -> bytes:
        data = self._stream.read(size)
        self._left -= len(data)
        if self._left < 0:
            raise UnpackError(f"a compressed file holds more than {self._most} bytes")
        return data


def _bounded(kind: Callable[[], _Unpacker]) -> Callable[..., bytes]:
    """Return what unpacks at most as much as a chunk says itself, or may hold at all."""

    def unpack(data: bytes, size: int | None = None) -> bytes:
        most = LARGEST_CHUNK if size is None else min(size, LARGEST_CHUNK)
        unpacker = kind()
        parts: list[bytes] = []
        length = 0
        while not unpacker.eof:
            # In steps, as lz4 takes the memory for all that it may give before it begins.
            part = unpacker.decompress(b"" if parts else data, min(_STEP, most + 1 - length))
            parts.append(part)
            length += len(part)
            if length > most:
                raise UnpackError(f"a chunk of {len(data)} bytes holds more than {most}")
            if not part and not unpacker.eof:
                raise UnpackError("a chunk ends too early")
        return b"".join(parts)

    return unpack


def _lz4() -> _Unpacker:
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    found: _Unpacker = LZ4FrameDecompressor()
    return found


def _zstd() -> _Unpacker:
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    found: _Unpacker = zstd.ZstdDecompressor()
    return found
