"""What an ``.mcap`` that was cut short still holds: whole records, in a file that can be read."""

from __future__ import annotations

import struct
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
        end, left_out = _whole(source, len(MAGIC), size)
        inside = _inside(source, end, size)
        copy = folder / path.name
        with copy.open("wb") as out:
            _copy(source, out, 0, end)
            if inside is not None:
                within, left_out = _whole(source, inside, size)
                _copy(source, out, inside, within)
            out.write(_END)
    return Salvaged(copy, left_out)


def _whole(source: BinaryIO, start: int, size: int) -> tuple[int, int]:
    """Return where the whole records from a place on end, and how much is behind them."""
    at = start
    while at + _HEAD.size <= size:
        source.seek(at)
        kind, length = _HEAD.unpack(source.read(_HEAD.size))
        stop = at + _HEAD.size + length
        if stop > size or kind in (0, _DATA_END, _FOOTER):  # no record is of kind 0
            break
        at = stop
    return at, size - at


def _inside(source: BinaryIO, at: int, size: int) -> int | None:
    """Return where the records of the chunk begin that stands here, if they are not compressed."""
    source.seek(at)
    head = source.read(_HEAD.size + 32)  # times, size, checksum; the length of a compression's name
    is_plain = len(head) == _HEAD.size + 32 and head[0] == _CHUNK and head[-4:] == bytes(4)
    return at + len(head) + 8 if is_plain and at + len(head) + 8 <= size else None


def _copy(source: BinaryIO, out: BinaryIO, start: int, stop: int) -> None:
    source.seek(start)
    while start < stop and (part := source.read(min(1 << 20, stop - start))):
        out.write(part)
        start += len(part)
