"""What an ``.mcap`` that was cut short still holds: whole records, in a file that can be read."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHUNK, _DATA_END = 0x02, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")  # of a record: what it is, and how long
_END = b"".join(
    (_HEAD.pack(_DATA_END, 4), bytes(4), _HEAD.pack(_FOOTER, 20), bytes(20), MAGIC)
)  # without a summary, which a reader then makes itself


class Salvaged(NamedTuple):
    """A whole file, and how much of the other's end is not in it [bytes]."""

    path: Path
    left_out: int


def salvaged(path: Path, folder: Path) -> Salvaged | None:
    """Copy the whole records of a file that was cut short; None if it was not.

    Of a chunk that was cut and is not compressed the whole records inside are copied, too.

    folder : where the copy is made.
    """
    size = path.stat().st_size
    with path.open("rb") as source:
        source.seek(max(0, size - len(MAGIC)))
        if source.read() == MAGIC and size > 2 * len(MAGIC):
            return None
        copy, end = folder / path.name, len(MAGIC)
        with copy.open("wb") as out:
            out.write(MAGIC)
            for kind, start, stop in _records(source, end, size):
                if kind in (0, _DATA_END, _FOOTER):  # no record is of kind 0
                    break
                if stop > size:
                    end = _copy_inside(source, out, start, size) if kind == _CHUNK else end
                    break
                _copy(source, out, start - _HEAD.size, stop)
                end = stop
            out.write(_END)
    return Salvaged(copy, size - end)


def _records(source: BinaryIO, at: int, size: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, start and stop of records; the last may stop behind the end of the file."""
    while at + _HEAD.size <= size:
        source.seek(at)
        kind, length = _HEAD.unpack(source.read(_HEAD.size))
        start, at = at + _HEAD.size, at + _HEAD.size + length
        yield kind, start, at


def _copy_inside(source: BinaryIO, out: BinaryIO, start: int, size: int) -> int:
    """Copy the whole records of a chunk whose end is missing; return where they end."""
    source.seek(start)
    head = source.read(32)  # times, size, checksum; the length of the compression's name
    first = start + 40  # behind the records' length
    if len(head) < 32 or head[-4:] != bytes(4):
        return start - _HEAD.size
    end = first
    for _, inner, stop in _records(source, first, size):
        if stop > size:
            break
        _copy(source, out, inner - _HEAD.size, stop)
        end = stop
    return end


def _copy(source: BinaryIO, out: BinaryIO, start: int, stop: int) -> None:
    source.seek(start)
    while start < stop and (part := source.read(min(1 << 20, stop - start))):
        out.write(part)
        start += len(part)
