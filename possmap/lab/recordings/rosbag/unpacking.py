"""A bound on what the compressed parts of a bag unpack to, before rosbags unpacks them whole."""

from __future__ import annotations

import bz2
import re
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from io import SEEK_END, BytesIO
from pathlib import Path
from shutil import disk_usage
from typing import Any, BinaryIO

from possmap.lab.recordings.rosbag.untrusted import UntrustedError

MOST_UNPACKED = 1 << 28
"""A chunk or message may unpack to so much [bytes]; recorders make chunks of some megabytes."""

_MOST_TIMES = 250  # of the file's size, all together: streams may lie in one another
_STEP = 1 << 10  # read at once; zstandard alone unpacks all of it at once, to tens of megabytes
_MOST_AT_ONCE = 1 << 20
_BLOCK = 1 << 14
_BEGINS = re.compile(rb"BZh[1-9]1AY&SY|\x04\x22\x4d\x18|\x28\xb5\x2f\xfd")
_LONGEST = 10


def check_files_unpack(bag: Path) -> None:
    """Refuse a bag, or a bag's folder, with a stream that unpacks to too much.

    Wherever a stream may begin it is unpacked, step by step: an index can lead anywhere. A file
    that is compressed as a whole rosbags unpacks into the temporary folder.

    Raises
    ------
    UntrustedError
        If there is one.
    OSError
        If a file cannot be read.
    """
    for path in [bag] if bag.is_file() else sorted(bag.iterdir()):
        if path.is_file() and path.suffix != ".db3":  # whose messages are checked one by one
            with path.open("rb") as file:
                check_unpacks(file, disk_usage(tempfile.gettempdir()).free)


def check_messages_unpack(messages: Iterable[tuple[Any, int, bytes]]) -> None:
    """Refuse compressed messages, as rosbags yields them, of which one unpacks to too much.

    Raises
    ------
    UntrustedError
        If there is one.
    """
    for _, _, data in messages:
        check_unpacks(BytesIO(data), MOST_UNPACKED)


def check_unpacks(file: BinaryIO, most_whole: int) -> None:
    """Refuse a file in which streams of bzip2, LZ4 or Zstandard unpack to too much.

    Parameters
    ----------
    most_whole
        To how much one that begins with the file may unpack [bytes].

    Raises
    ------
    UntrustedError
        If one does.
    """
    left = MOST_UNPACKED + _MOST_TIMES * file.seek(0, SEEK_END)
    start = _next(file, 0)
    while start is not None:
        most = MOST_UNPACKED if start else most_whole
        end, unpacked = _unpacked(file, start, most)
        left -= unpacked
        if unpacked > most or left < 0:
            what = f"of more than {most >> 20} MiB" if unpacked > most else "in one another"
            raise UntrustedError(f"found compressed data {what}, expected chunks of some MiB")
        start = _next(file, end)


def _next(file: BinaryIO, at: int) -> int | None:
    """Return where, from a place on, a stream may begin next."""
    file.seek(at)
    held = b""
    while block := file.read(_BLOCK):
        held = held[1 - _LONGEST :] + block
        if found := _BEGINS.search(held):
            return file.tell() - len(held) + found.start()
    return None


def _unpacked(file: BinaryIO, start: int, most: int) -> tuple[int, int]:
    """Return where a stream ends, with those that follow at once, and to how much it unpacks.

    What is no stream after all ends behind its first byte.
    """
    at, unpacked = start, 0
    with suppress(Exception):  # each library has errors of its own
        while begins := _BEGINS.match(_read(file, at, _LONGEST)):
            decoder, bound = _decoder(begins[0])
            while not decoder.eof:
                waits = getattr(decoder, "needs_input", True)
                step = _read(file, at, _STEP) if waits else b""
                unpacked += len(decoder.decompress(step, *bound))
                at += len(step)
                if unpacked > most or (waits and not step):
                    return start + 1, unpacked
            at -= len(decoder.unused_data)
        return at, unpacked
    return start + 1, unpacked


def _read(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(size)


def _decoder(begins: bytes) -> tuple[Any, tuple[int, ...]]:
    """Return what unpacks a stream, and how it is told a bound: zstandard knows none.

    Zstandard is unpacked by the library that this rosbags uses.
    """
    bound = (_MOST_AT_ONCE,)
    if begins.startswith(b"BZh"):
        return bz2.BZ2Decompressor(), bound
    if begins.startswith(b"\x04"):
        return import_module("lz4.frame").LZ4FrameDecompressor(), bound
    for name in ("compression.zstd", "backports.zstd"):
        with suppress(ImportError):
            return import_module(name).ZstdDecompressor(), bound
    return import_module("zstandard").ZstdDecompressor().decompressobj(), ()
