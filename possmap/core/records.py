"""What a robot reports of one outing: records, and the excursion that they make up.

Field names, units and meanings are those of the log format (docs/logs.md): metres, degrees,
seconds, *as logged*. Equality is the format's: ``x_`` keys do not take part in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeAlias

CornerKind: TypeAlias = Literal["concave", "convex", "end"]
CORNER_KINDS: tuple[CornerKind, ...] = ("concave", "convex", "end")


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot believed it was; the errors are half-widths and count on the first pose."""

    seq: int
    t: float | None
    x: float
    y: float
    heading_deg: float
    error_x: float = 0.0
    error_y: float = 0.0
    error_heading_deg: float = 0.0
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight piece of wall from (x, y) to (x2, y2); zero length: one reading, or a bump."""

    seq: int
    t: float | None
    x: float
    y: float
    x2: float
    y2: float
    followed: bool = True
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Beam:
    """One range reading from the sensor at (x, y) to its end at (x2, y2)."""

    seq: int
    t: float | None
    x: float
    y: float
    x2: float
    y2: float
    hit: bool = True
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Corner:
    """A singular point: a corner, or the end of a wall."""

    seq: int
    t: float | None
    x: float
    y: float
    corner: CornerKind
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Meet:
    """Met another robot and took over its records up to seq ``upto``."""

    seq: int
    t: float | None
    peer: str
    peer_excursion: str
    upto: int | None = None
    extra: str = field(default="", compare=False)


Sighting: TypeAlias = Wall | Beam | Corner
Record: TypeAlias = Pose | Wall | Beam | Corner | Meet

KINDS: dict[str, type[Record]] = {
    "pose": Pose, "wall": Wall, "beam": Beam, "corner": Corner, "meet": Meet,
}  # fmt: skip
KIND_OF: dict[type[Record], str] = {cls: kind for kind, cls in KINDS.items()}

OwnModel: TypeAlias = tuple[tuple[str, float], ...]
"""The error-model parameters that a log itself gives, sorted by name."""


@dataclass(frozen=True, slots=True)
class PartialMap:
    """What is known of one excursion: one *version* of it, perhaps only its beginning.

    Attributes
    ----------
    robot, excursion
        Together the excursion's name (METHOD §3, Identity).
    model
        The log's own model parameters, in the units of METHOD §1.
    records
        In order of seq.
    extra
        The log's ``x_`` keys, as JSON text; not compared.
    """

    robot: str
    excursion: str
    model: OwnModel
    records: tuple[Record, ...]
    extra: str = field(default="", compare=False)

    @property
    def name(self) -> tuple[str, str]:
        """Robot and excursion."""
        return self.robot, self.excursion

    def continued_by(self, longer: PartialMap) -> PartialMap:
        """Return a longer version's records behind one's own; own ``x_`` keys stay."""
        records = (*self.records, *longer.records[len(self.records) :])
        extra = self.extra or longer.extra
        return PartialMap(self.robot, self.excursion, self.model, records, extra)

    def prefix(self, count: int) -> PartialMap:
        """Return the version that ends after ``count`` records."""
        if count >= len(self.records):
            return self
        return PartialMap(self.robot, self.excursion, self.model, self.records[:count], self.extra)


class Difference(NamedTuple):
    """Where two versions of an excursion disagree: the record's number, None for their models."""

    record: int | None
    what: str


def first_difference(one: PartialMap, other: PartialMap) -> Difference | None:
    """Return where two versions of one excursion disagree, or None where they agree.

    They agree if the models are equal and one list of records is a prefix of the other
    (METHOD §3, Versions).
    """
    if one.model != other.model:
        return Difference(None, "their models differ")
    for index, (mine, theirs) in enumerate(zip(one.records, other.records, strict=False)):
        if mine != theirs:
            if mine.seq != theirs.seq:
                return Difference(index, f"seq {mine.seq} against seq {theirs.seq}")
            return Difference(index, f"the records of seq {mine.seq} differ")
    return None
