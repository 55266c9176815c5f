"""An excursion growing record by record, held to the rules that span records (docs/logs.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from possmap.core.records import Fix, Meet, OwnModel, PartialMap, Pose, Record
from possmap.errors import shown
from possmap.logs.fields import Fault, as_object, model_of, name_of, own_keys, own_text

FORMAT_VERSION = 1
_HEADER = {"possmap_log", "robot", "excursion", "model"}


class LoggedVersion(NamedTuple):
    """What a file holds of an excursion, and the line on which it begins.

    carrier : robot and excursion of the log that carried it; None for the robot's own.
    """

    line: int
    content: PartialMap
    carrier: tuple[str, str] | None


@dataclass(frozen=True, slots=True)
class Header:
    """The keys that name a log, and its user's own; ``version`` is None where it is absent."""

    robot: str
    excursion: str
    model: OwnModel
    version: int | None
    own: dict[str, object]

    @property
    def name(self) -> tuple[str, str]:
        """Robot and excursion."""
        return self.robot, self.excursion


def header_of(value: object, nesting: int, needs_version: bool) -> Header:
    """Check a log's header: everything but its records and carried logs.

    Raises
    ------
    Fault
        For a missing or unknown key, a name that is none, or a format version that is newer.
    """
    fields = as_object(value)
    version: int | None = None
    if "possmap_log" in fields:  # first of all: a newer version may well have other keys
        version = version_of(fields["possmap_log"])
    own = own_keys(fields, _HEADER, "a log", nesting)
    if version is None and needs_version:
        raise Fault((), f"possmap_log is missing, expected {FORMAT_VERSION}")
    for name in ("robot", "excursion"):
        if name not in fields:
            raise Fault((), f"{name} is missing, a log needs it")
    try:
        model = model_of(fields.get("model", {}))
    except Fault as fault:
        raise fault.below("model") from None
    robot, excursion = (name_of(name, fields[name]) for name in ("robot", "excursion"))
    return Header(robot, excursion, model, version, own)


def version_of(found: object) -> int:
    """Return the format version, the value of ``possmap_log``.

    Raises
    ------
    Fault
        If it is none, or newer.
    """
    if type(found) is not int or found < 1:
        raise Fault(("possmap_log",), f"found {shown(found)}, expected {FORMAT_VERSION}")
    if found > FORMAT_VERSION:
        problem = f"version {found} is newer than this program reads ({FORMAT_VERSION})"
        raise Fault(("possmap_log",), problem)
    return found


def too_many(limit: int) -> Fault:
    """Return what is wrong with a file of more excursions than it may hold."""
    return Fault((), f"found more than {limit} excursions (setting limit_file_excursions)")


class GrowingExcursion:
    """Collects the records of one excursion in order; ``add`` refuses what breaks the order."""

    def __init__(self, line: int = 1) -> None:
        self.line = line
        self.records: list[Record] = []
        self._pose: Pose | None = None
        self._last_t: float | None = None

    def add(self, record: Record) -> None:
        """Append the next record.

        Raises
        ------
        Fault
            For a falling seq or time, a sighting or fix before the first pose, a pose that did not
            turn and lies elsewhere than the one before, or a fix with half of a heading.
        """
        records, seq, t = self.records, record.seq, record.t
        if not records:
            if seq != 0:
                raise Fault(("seq",), f"found {seq}, expected 0, the first record's seq")
        elif seq <= records[-1].seq:
            last = records[-1].seq
            raise Fault(("seq",), f"found {seq}, expected more than {last}, the one before")
        if isinstance(record, Pose):
            if record.turned is False:
                _check_place(record, self._pose)
            self._pose = record
        elif self._pose is None and not isinstance(record, Meet):
            first = "fix" if isinstance(record, Fix) else "wall, corner or beam"
            raise Fault(("kind",), f"expected a pose before the first {first}")
        elif isinstance(record, Fix):
            _check_heading(record)
        if t is not None:
            if self._last_t is not None and t < self._last_t:
                raise Fault(("t",), f"found {t}, expected {self._last_t} or later")
            self._last_t = t
        records.append(record)

    def version(self, header: Header, carrier: tuple[str, str] | None = None) -> LoggedVersion:
        """Return the excursion so far, under its header's name."""
        extra, records = own_text(header.own), tuple(self.records)
        content = PartialMap(header.robot, header.excursion, header.model, records, extra)
        return LoggedVersion(self.line, content, carrier)


def _check_heading(fix: Fix) -> None:
    for name, found, other in (
        ("heading", fix.heading_deg, fix.error_heading_deg),
        ("error_heading", fix.error_heading_deg, fix.heading_deg),
    ):
        if found is None and other is not None:
            given = "error_heading" if name == "heading" else "heading"
            raise Fault((), f"{name} is missing, a fix with {given} needs it")


def _check_place(pose: Pose, before: Pose | None) -> None:
    if before is not None and (pose.x, pose.y) != (before.x, before.y):
        expected = f"the place of the pose before, ({before.x}, {before.y})"
        raise Fault(("turned",), f"found false at ({pose.x}, {pose.y}), expected {expected}")
