"""How hostile files are made."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

MIB = 1 << 20


@dataclass(frozen=True)
class Case:
    """A hostile file.

    reader : of fuzz.readers, READERS or UNCHANGED. name : of the file.
    make : its bytes, or what writes it.
    told : how the refusal ends; None if the file is sound, if odd. limit_mib : limit_file_mib.
    """

    what: str
    reader: str
    name: str
    make: Callable[[], bytes] | Callable[[Path], object]
    told: str | None
    writes: bool = False
    limit_mib: float = 64

    def write(self, folder: Path) -> Path:
        """Write the file into a folder."""
        path = folder / self.name
        if self.writes:
            self.make(path)  # type: ignore[call-arg]
        else:
            path.write_bytes(self.make())  # type: ignore[call-arg,arg-type]
        return path


def text(*parts: str) -> Callable[[], bytes]:
    """Return what makes a text of parts."""
    return lambda: "".join(parts).encode()


def zipped(blocks: Iterable[bytes]) -> bytes:
    """Return blocks as one gzip member, made without holding them all."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    return b"".join([*(packer.compress(block) for block in blocks), packer.flush()])


def png(width: int, height: int, bits: int, rows: Iterable[bytes]) -> bytes:
    """Return a grey PNG of packed rows."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    packer = zlib.compressobj(9)
    packed = b"".join([*(packer.compress(b"\0" + row) for row in rows), packer.flush()])
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


def database(*statements: str) -> Callable[[Path], None]:
    """Return what writes a database."""

    def write(path: Path) -> None:
        with closing(sqlite3.connect(path)) as connection:
            for statement in statements:
                connection.execute(statement)
            connection.commit()

    return write


def mcap(definition: str, encoding: str) -> Callable[[Path], None]:
    """Return what writes an MCAP of one topic, /odom of odometry, so defined."""

    def write(path: Path) -> None:
        def packed(value: str | bytes) -> bytes:
            data = value.encode() if isinstance(value, str) else value
            return struct.pack("<I", len(data)) + data

        def record(kind: int, data: bytes) -> bytes:
            return struct.pack("<BQ", kind, len(data)) + data

        magic = b"\x89MCAP0\r\n"
        head = record(1, packed("ros2") + packed("fuzz"))
        schema = record(
            3,
            struct.pack("<H", 1)
            + b"".join(map(packed, ("nav_msgs/msg/Odometry", encoding, definition))),
        )
        channel = record(
            4, struct.pack("<HH", 1, 1) + packed("/odom") + packed("cdr") + packed(b"")
        )
        message = record(5, struct.pack("<HIQQ", 1, 0, 1, 1) + b"\0\1\0\0" + bytes(8))
        data = magic + head + schema + channel + message + record(15, struct.pack("<I", 0))
        counts = struct.pack("<H", 1) + struct.pack("<Q", 1)
        statistics = struct.pack("<QHIIIIQQ", 1, 1, 1, 0, 0, 0, 1, 1) + packed(counts)
        summary = schema + channel + record(11, statistics)
        foot = record(2, struct.pack("<QQI", len(data), 0, 0))
        path.write_bytes(data + summary + foot + magic)

    return write


def folder_bag(metadata: str) -> Callable[[Path], None]:
    """Return what writes the folder of a ROS 2 bag that has only its metadata."""

    def write(path: Path) -> None:
        path.mkdir()
        (path / "metadata.yaml").write_text(metadata)

    return write
