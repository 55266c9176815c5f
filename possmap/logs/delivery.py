"""What a log file delivers: versions of excursions, each with its place for messages."""

from __future__ import annotations

from dataclasses import dataclass

from possmap.core.records import PartialMap
from possmap.errors import LogError, printable
from possmap.logs.fields import Fault, Step


@dataclass(frozen=True, slots=True)
class Origin:
    """Where records came from, kept in the ledger outside the digest.

    name : of the file, as the user gave it; bytes of it that are no text are spelt out.
    sha256 : of the file's bytes as delivered, hexadecimal.
    size : of the same [bytes].
    """

    name: str
    sha256: str
    size: int

    def __post_init__(self) -> None:
        # Linux lets any bytes name a file; a ledger holds text.
        text = self.name.encode(errors="backslashreplace").decode()
        object.__setattr__(self, "name", text)


@dataclass(frozen=True, slots=True)
class Delivery:
    """One version of one excursion.

    whole : a version of which the first ``count`` records were delivered; the deliveries of a
        grid's ledger, which may be many, share it.
    place : ``file:line`` where it begins, for messages.
    origin : the file.
    carrier : robot and excursion of the log that carried it; None for the robot's own.
    """

    whole: PartialMap
    place: str
    origin: Origin
    carrier: tuple[str, str] | None
    count: int

    @classmethod
    def of(
        cls, whole: PartialMap, place: str, origin: Origin, carrier: tuple[str, str] | None = None
    ) -> Delivery:
        """Return the delivery of a whole version."""
        return cls(whole, place, origin, carrier, len(whole.records))

    @property
    def name(self) -> tuple[str, str]:
        """Robot and excursion."""
        return self.whole.name

    @property
    def version(self) -> PartialMap:
        """The version that was delivered."""
        return self.whole.prefix(self.count)


@dataclass(frozen=True, slots=True)
class LogFile:
    """One file, whole: fused or refused as one.

    is_ledger : it was read from a grid, into which somebody let it before.

    cut_short : where a last line that was cut was left out; None if none was.
    """

    origin: Origin
    deliveries: tuple[Delivery, ...]
    cut_short: str | None = None
    is_ledger: bool = False


def path_text(path: tuple[Step, ...]) -> str:
    """Return a path inside a log as people write it: ``records[17].heading``."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{printable(step)[:60]}"
    return text.lstrip(".")


def refusal(name: str, line: int, fault: Fault) -> LogError:
    """Return the error that names file, line and path."""
    where = path_text(fault.path)
    return LogError(f"{name}:{line}", f"{where}: {fault.problem}" if where else fault.problem)
