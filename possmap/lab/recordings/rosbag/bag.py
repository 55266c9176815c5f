"""A bag through rosbags: its topics, its messages, and one kind of error for all its faults."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

from possmap.errors import RecordingError, printable, shown
from possmap.lab.recordings.rosbag.cut import salvaged
from possmap.lab.recordings.rosbag.unpacking import check_files_unpack, check_messages_unpack
from possmap.lab.recordings.rosbag.untrusted import UntrustedError, check_files, store_of

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

Decoder: TypeAlias = Callable[[bytes], object]
"""Makes a message of its bytes; anything may go wrong."""

STUBBORN = 100
"""So many messages in a row that cannot be read, and none can."""

_LOOKED_AT = 10  # messages, to see what the others will be like
_LONGEST_DETAIL = 160
_ROS1, _SQLITE, _MCAP = b"#ROSBAG V", b"SQLite format 3\0", b"\x89MCAP0\r\n"
_ZSTD = b"\x28\xb5\x2f\xfd"
_SUFFIX = {_SQLITE: ".db3", _MCAP: ".mcap"}
_KINDS = "a ROS 1 .bag, a ROS 2 .db3 or .mcap, or a ROS 2 bag's folder with its metadata.yaml"
_PREFIX = re.compile(r"^(Cannot open database|Could not load YAML from) .*?: ")
_STUMBLES = (
    AssertionError, AttributeError, LookupError, OverflowError, RecursionError, TypeError,
    struct.error,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a bag.

    ids : of its connections, one for each publisher. count : of its messages.
    """

    name: str
    type: str
    ids: frozenset[int]
    count: int


class Bag:
    """A bag that is open; made by ``opened``.

    left_out : how much of its end was cut off or is incomplete [bytes].
    """

    def __init__(
        self, path: Path, reader: Reader1 | Reader2, kind: bytes, left_out: int | None
    ) -> None:
        self.path, self.left_out = path, left_out
        self._reader = reader
        self._kind = kind

    def topics(self) -> dict[str, Topic]:
        """Return its topics by name. Of a topic with several types the most frequent counts."""
        found: dict[tuple[str, str], list[Connection]] = {}
        for connection in self._reader.connections:
            found.setdefault((connection.topic, connection.msgtype), []).append(connection)
        topics: dict[str, Topic] = {}
        for (name, type_), those in found.items():
            count = sum(max(0, one.msgcount) for one in those)
            if name not in topics or count > topics[name].count:
                topics[name] = Topic(name, type_, frozenset(one.id for one in those), count)
        return topics

    def decoder(self, topic: Topic) -> Decoder:
        """Return what makes messages of a topic's bytes.

        Raises
        ------
        RecordingError
            If the bag does not tell, or not in a way that can be understood.
        """
        connection = next(one for one in self._reader.connections if one.id in topic.ids)
        place, type_ = f"topic {printable(topic.name)}", short(topic.type)
        form = getattr(connection.ext, "serialization_format", "cdr")
        if form != "cdr":
            problem = f'{place}: found messages written as {shown(form)}, expected "cdr"'
            raise RecordingError(str(self.path), problem)
        try:
            store = store_of(connection)
            _ = store and store.get_msgdef(topic.type)  # compiled now, so that faults show
        except Exception as error:  # the parsers have many ways to fail on what they do not know
            problem = f"{place}: the definition of {type_} cannot be understood: {_detail(error)}"
            raise RecordingError(str(self.path), problem) from error
        if store is None:
            raise RecordingError(
                str(self.path),
                f"{place}: the bag does not say what {type_} consists of, and it is no standard "
                "type; expected a bag with message definitions, such as an .mcap",
            )
        read = store.deserialize_ros1 if self._kind == _ROS1 else store.deserialize_cdr
        return lambda data: read(data, topic.type)

    def first(self, topic: Topic, decode: Decoder) -> list[Any]:
        """Return the first messages of a topic that can be read, at least one.

        Raises
        ------
        RecordingError
            If there is none.
        """
        found: list[Any] = []
        failed = 0
        fault: Exception | None = None
        for _, _, data in self.messages(topic.ids):
            try:
                found.append(decode(data))
            except Exception as error:  # of rosbags alone: damaged bytes can lead it anywhere
                fault = error
                failed += 1
            if len(found) == _LOOKED_AT or failed == STUBBORN:
                break
        if not found:
            raise RecordingError(
                str(self.path),
                f"topic {shown(topic.name)}: no message can be read, "
                f"expected {short(topic.type)}" + (f" ({failed} tried)" if failed else ""),
            ) from fault
        return found

    def messages(self, ids: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield connection, the bag's time [ns] and bytes of the messages, in the bag's order.

        Raises
        ------
        RecordingError
            If it is damaged. A bag that was cut short is seen when it is opened: every format
            has its index, or its size, where rosbags looks first. Of an .mcap the rest is read.
        """
        wanted = [one for one in self._reader.connections if one.id in ids]
        if not wanted:  # which would mean all of them to rosbags
            return
        for connection, stamp, data in self._found(wanted):
            if not isinstance(stamp, int):  # a database holds whatever was put into it
                problem = f"damaged: the time of a message, found {shown(stamp)}"
                raise RecordingError(str(self.path), problem)
            if connection.id not in ids:
                problem = f"damaged: the index leads to topic {shown(connection.topic)}"
                raise RecordingError(str(self.path), problem)
            yield connection.id, stamp, data

    def _found(self, wanted: list[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield what rosbags does; only its own errors are taken for damage of the bag."""
        stream: Iterator[tuple[Connection, int, bytes]] | None = None
        while True:
            try:
                stream = self._reader.messages(connections=wanted) if stream is None else stream
                item = next(stream, None)
            except Exception as error:  # of lz4, bz2, zstd, SQLite, struct, and plain assertions
                raise RecordingError(str(self.path), f"damaged: {_detail(error)}") from error
            if item is None:
                return
            yield item


@contextmanager
def opened(path: Path, again: bool = False) -> Iterator[Bag]:
    """Open a bag.

    Parameters
    ----------
    again
        Whether it was opened before, so that what it unpacks to is known.

    Raises
    ------
    RecordingError
        If it is none, is damaged, or rosbags is not installed.
    """
    kind = _kind(path)
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError as error:
        raise RecordingError(
            str(path), "to read ROS bags, rosbags is needed: pip install 'possmap[ros]'"
        ) from error
    with ExitStack() as stack:
        left_out, readable = None, path
        try:
            if kind in (_SQLITE, b""):
                check_files(path)
            if kind == _MCAP:
                folder = stack.enter_context(TemporaryDirectory(prefix="possmap-"))
                found = salvaged(path, Path(folder))
                readable, left_out = found or (path, None)
            if not again:
                check_files_unpack(readable)
            reader = Reader1(readable) if kind == _ROS1 else Reader2(readable)
            stack.callback(_close, reader)
            reader.open()
            opened_one: Any = reader
            if not again and getattr(opened_one, "compression_mode", None) == "message":
                for storage in opened_one.storage.storages:
                    check_messages_unpack(storage.messages(storage.connections))
        except UntrustedError as error:
            raise RecordingError(str(path), f"cannot be read as a bag: {error}") from error
        except OSError as error:
            problem = f"cannot be read: {error.strerror or _detail(error)}"
            raise RecordingError(str(path), problem) from error
        except Exception as error:  # as above; a damaged file can lead rosbags anywhere
            raise RecordingError(str(path), _unopened(path, kind, error)) from error
        for one in reader.connections:  # of a YAML file or a database, that hold whatever they do
            if [type(what) for what in (one.topic, one.msgtype, one.msgcount)] != [str, str, int]:
                problem = f"cannot be read as a bag: found a topic {shown(one.topic)} of type "
                problem += f"{shown(one.msgtype)} with {shown(one.msgcount)} messages"
                raise RecordingError(str(path), problem)
        if left_out is not None and not reader.connections:
            raise RecordingError(str(path), "cut short, before any topic; no message is left")
        yield Bag(path, reader, kind, left_out)


def _close(reader: Reader1 | Reader2) -> None:
    with suppress(Exception):  # of a file that is only read, nothing can be lost
        reader.close()


def size_of(path: Path) -> int:
    """Return how long a bag's files are together [bytes]."""
    if path.is_dir():
        return sum(one.stat().st_size for one in path.iterdir() if one.is_file())
    return path.stat().st_size


def short(type_: str) -> str:
    """Return a type's name as people say it: ``nav_msgs/Odometry``."""
    return printable(type_.replace("/msg/", "/"))


def _kind(path: Path) -> bytes:
    """Return how the bag's file begins; empty for a folder."""
    if "\0" in str(path):
        raise RecordingError(str(path), "cannot be read: a null character in the name")
    try:
        mode = path.stat().st_mode
        if S_ISDIR(mode):
            if (path / "metadata.yaml").is_file():
                return b""
            problem = f"a folder without metadata.yaml, expected {_KINDS}; "
            problem += "if it is a bag, run `ros2 bag reindex` on it"
            raise RecordingError(str(path), problem)
        if not S_ISREG(mode):  # opening a FIFO would wait for ever
            raise RecordingError(str(path), f"not a regular file, expected {_KINDS}")
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror or error}") from error
    kind = next((one for one in (_ROS1, _SQLITE, _MCAP) if head.startswith(one)), None)
    if kind is None:
        problem = f"not a ROS bag, expected {_KINDS}" if head else f"is empty, expected {_KINDS}"
        if head.startswith(_ZSTD):
            problem = "compressed as a whole, expected the bag's folder with its metadata.yaml"
        raise RecordingError(str(path), problem)
    suffix = _SUFFIX.get(kind, path.suffix)
    if path.suffix != suffix:  # by which rosbags tells them apart
        problem = f"found a name ending in {shown(path.suffix)}, expected {suffix}"
        raise RecordingError(str(path), problem)
    return kind


def _unopened(path: Path, kind: bytes, error: Exception) -> str:
    """Return why a bag could not be opened, with what helps."""
    detail = _detail(error)
    if kind == _ROS1 and "not supported" not in detail:
        return f"has no index, or a damaged one; run `rosbag reindex` on it ({detail})"
    if kind == _MCAP and ("end magic" in detail or "footer" in detail):
        return (
            "cut short, or never closed; run `mcap recover` on it, or `ros2 bag reindex` on its "
            f"folder ({detail})"
        )
    if kind == _SQLITE and any(mark in str(path.absolute()) for mark in "?#%"):
        return f"found one of ? # % in its path, which rosbags cannot open; rename it ({detail})"
    if _is_cut(path):
        return f"cut short; run `sqlite3 FILE .recover`, then `ros2 bag reindex` ({detail})"
    return f"cannot be read as a bag: {detail}"


def _is_cut(path: Path) -> bool:
    """Whether a database, or one in a folder, is shorter than it says itself."""
    for one in [path] if path.is_file() else sorted(path.glob("*.db3")):
        with suppress(OSError, struct.error), one.open("rb") as stream:
            head = stream.read(100)
            page, pages = *struct.unpack(">H", head[16:18]), *struct.unpack(">I", head[28:32])
            whole = (65536 if page == 1 else page) * pages
            if head.startswith(_SQLITE) and one.stat().st_size < whole:
                return True
    return False


def _detail(error: Exception) -> str:
    """Return the first line of what rosbags says; hostile files have a say in it."""
    if isinstance(error, MemoryError):
        return "it claims more than fits into memory"
    if isinstance(error, _STUMBLES):
        return f"its parts do not fit together ({type(error).__name__} in rosbags)"
    said = str(error.args[0] if error.args else "").strip().splitlines()
    text = printable(said[0]).rstrip(".") if said else ""
    text = _PREFIX.sub("", text)  # the path stands before it already
    return text[:_LONGEST_DETAIL] or f"{type(error).__name__} in rosbags"
