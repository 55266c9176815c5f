"""An excursion growing record by record, held to the rules that span records (docs/logs.md)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

from possmap.core.records import Meet, OwnModel, PartialMap, Pose, Record
from possmap.errors import shown
from possmap.logs.fields import Fault, as_object, model_of, name_of, own_keys

FORMAT_VERSION = 1
_HEADER = {"possmap_log", "robot", "excursion", "model"}


@dataclass(frozen=True, slots=True)
class Header:
    """The keys that name a log. ``version`` is None where possmap_log is absent."""

    robot: str
    excursion: str
    model: OwnModel
    version: int | None
    extra: str

    def with_extras(self, more: Sequence[str]) -> Header:
        """Return the header with the ``x_`` keys of others; the later value of a key stays."""
        if not more:
            return self
        every = json.loads(self.extra or "{}")
        for text in more:
            every |= json.loads(text)
        return replace(self, extra=json.dumps(every, separators=(",", ":")))


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
    extra = own_keys(fields, _HEADER, "a log", nesting)
    if version is None and needs_version:
        raise Fault((), f"possmap_log is missing, expected {FORMAT_VERSION}")
    for name in ("robot", "excursion"):
        if name not in fields:
            raise Fault((), f"{name} is missing, a log needs it")
    model: OwnModel = ()
    if "model" in fields:
        try:
            model = model_of(fields["model"])
        except Fault as fault:
            raise fault.below("model") from None
    return Header(
        name_of("robot", fields["robot"]),
        name_of("excursion", fields["excursion"]),
        model,
        version,
        extra,
    )


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


class ExcursionBuilder:
    """Collects the records of one excursion in order; ``add`` refuses what breaks the order."""

    def __init__(self) -> None:
        self.records: list[Record] = []
        self._last_pose: Pose | None = None
        self._last_t: float | None = None

    def add(self, record: Record) -> None:
        """Append the next record.

        Raises
        ------
        Fault
            For a falling seq or time, or a sighting before the first pose.
        """
        records, seq, t = self.records, record.seq, record.t
        if not records:
            if seq != 0:
                raise Fault(("seq",), f"found {seq}, expected 0, the first record's seq")
        elif seq <= records[-1].seq:
            last = records[-1].seq
            raise Fault(("seq",), f"found {seq}, expected more than {last}, the one before")
        last_pose = self._last_pose
        if isinstance(record, Pose):
            if record.turned is False and last_pose is not None and _moved(last_pose, record):
                expected = f"{last_pose.x}, {last_pose.y} of the pose before"
                where = f"of a pose at {record.x}, {record.y}, expected the place {expected}"
                raise Fault(("turned",), f"found false {where}")
            self._last_pose = record
        elif last_pose is None and not isinstance(record, Meet):
            raise Fault(("kind",), "expected a pose before the first wall, corner or beam")
        if t is not None:
            if self._last_t is not None and t < self._last_t:
                raise Fault(("t",), f"found {t}, expected {self._last_t} or later")
            self._last_t = t
        records.append(record)

    def build(self, header: Header) -> PartialMap:
        """Return the excursion so far, under its header's name."""
        return PartialMap(
            header.robot, header.excursion, header.model, tuple(self.records), header.extra
        )


def _moved(one: Pose, other: Pose) -> bool:
    return one.x != other.x or one.y != other.y
