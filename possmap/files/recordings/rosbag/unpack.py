"""Chunks of bags unpacked within bounds: rosbags would fill the memory with whatever they hold."""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1

LARGEST_CHUNK = 1 << 28
"""A chunk that holds more is no chunk of a recording [bytes]; recorders begin a new one at 1 MB."""

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
