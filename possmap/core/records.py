"""What a robot reports of one outing: records, and the excursion that they make up.

The classes are the schema of a record: a field's name, type, default, bounds, allowed words and
meaning stand in its one line, and what checks logs, the columns of a CSV and of the ledger and the
JSON Schema follow from ``FIELDS``. Units are those of the log format (docs/logs.md): metres,
degrees, seconds, *as logged*. Equality is the format's: ``x_`` keys do not take part in it.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from operator import attrgetter
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, get_args, get_type_hints

from possmap.core import ranges
from possmap.core.ranges import Range

NAME = re.compile(r"[A-Za-z0-9._:-]{1,64}", re.ASCII)
"""What names a robot or an excursion."""

CornerKind: TypeAlias = Literal["concave", "convex", "end"]
CORNER_KINDS: tuple[CornerKind, ...] = get_args(CornerKind)

Seq: TypeAlias = Annotated[int, ranges.SEQ]
Time: TypeAlias = Annotated[float, ranges.TIME, "never decreasing [s]"]
Metres: TypeAlias = Annotated[float, ranges.WITHIN]
Degrees: TypeAlias = Annotated[float, ranges.WITHIN, "anticlockwise from +x [deg]"]
HalfWidth: TypeAlias = Annotated[float, ranges.HALF_WIDTH, "counts on the first pose only [m]"]
HalfAngle: TypeAlias = Annotated[float, ranges.HALF_WIDTH, "counts on the first pose only [deg]"]
FixedWidth: TypeAlias = Annotated[float, ranges.POSITIVE, "half-width [m]"]
FixedAngle: TypeAlias = Annotated[float, ranges.POSITIVE, "half-width [deg]; comes with heading"]
Name: TypeAlias = Annotated[str, NAME]
Turned: TypeAlias = Annotated[
    bool,
    "whether a heading that differs from the pose before was a turn, or a belief set anew without"
    " moving; false needs the place of the pose before",
]


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot believed it was; the errors are half-widths."""

    seq: Seq
    t: Time | None
    x: Metres
    y: Metres
    heading_deg: Degrees
    error_x: HalfWidth = 0.0
    error_y: HalfWidth = 0.0
    error_heading_deg: HalfAngle = 0.0
    turned: Turned | None = None
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight piece of wall seen on the run from the pose before it to the pose after it."""

    seq: Seq
    t: Time | None
    x: Metres
    y: Metres
    x2: Metres
    y2: Metres
    followed: Annotated[bool, "the robot lined up with it"] = True
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Beam:
    """One range reading, from the sensor at (x, y) to its end at (x2, y2)."""

    seq: Seq
    t: Time | None
    x: Metres
    y: Metres
    x2: Metres
    y2: Metres
    hit: Annotated[bool, "false: nothing seen up to there"] = True
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Corner:
    """A singular point: a corner, or the end of a wall."""

    seq: Seq
    t: Time | None
    x: Metres
    y: Metres
    corner: CornerKind
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Meet:
    """Met another robot and took over its records up to a seq."""

    seq: Seq
    t: Time | None
    peer: Name
    peer_excursion: Name
    upto: Seq | None = None
    extra: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Fix:
    """Somebody who knows says where the robot truly was at its last pose."""

    seq: Seq
    t: Time | None
    x: Metres
    y: Metres
    error_x: FixedWidth
    error_y: FixedWidth
    heading_deg: Degrees | None = None
    error_heading_deg: FixedAngle | None = None
    extra: str = field(default="", compare=False)


Sighting: TypeAlias = Wall | Beam | Corner
Record: TypeAlias = Pose | Wall | Beam | Corner | Meet | Fix

KINDS: dict[str, type[Record]] = {
    "pose": Pose, "wall": Wall, "beam": Beam, "corner": Corner, "meet": Meet, "fix": Fix,
}  # fmt: skip
KIND_OF: dict[type[Record], str] = {cls: kind for kind, cls in KINDS.items()}


class Field(NamedTuple):
    """A field of a record, as its class declares it.

    name : in a log, a CSV and the ledger.
    attribute : in the class.
    type : float, int, bool or str.
    allowed : the numbers or words that it may hold; None where its type says all.
    is_required : else it may be absent, and is ``default`` then.
    meaning : for people; may be empty.
    """

    name: str
    attribute: str
    type: type
    allowed: Range | re.Pattern[str] | tuple[str, ...] | None
    is_required: bool
    default: Any
    meaning: str


def _field(declared: dataclasses.Field[Any], hint: Any) -> Field:
    is_optional = NoneType in get_args(hint)
    if is_optional:
        hint = next(one for one in get_args(hint) if one is not NoneType)
    notes: tuple[Any, ...] = getattr(hint, "__metadata__", ())
    bare = get_args(hint)[0] if notes else hint
    words: tuple[str, ...] = get_args(bare)  # of a Literal
    bounds = [note for note in notes if not isinstance(note, str)]
    has_default = declared.default is not dataclasses.MISSING
    return Field(
        declared.name.removesuffix("_deg"),
        declared.name,
        str if words else bare,
        words or (bounds[0] if bounds else None),
        not (is_optional or has_default),
        declared.default if has_default else None,
        next((note for note in notes if isinstance(note, str)), ""),
    )


def _fields(kind: type[Record]) -> tuple[Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    declared = (one for one in dataclasses.fields(kind) if one.name != "extra")
    return tuple(_field(one, hints[one.name]) for one in declared)


FIELDS: dict[str, tuple[Field, ...]] = {name: _fields(kind) for name, kind in KINDS.items()}
"""Each kind's fields in the order of its class, without its ``x_`` keys, ``extra``."""

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

    def __reduce__(self) -> tuple[object, ...]:
        # As plain tuples: five times as fast as hundreds of objects, each pickled by itself.
        records = [(KIND_OF[type(one)], *_CONTENT[type(one)](one)) for one in self.records]
        return _restored, (self.robot, self.excursion, self.model, records, self.extra)

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


_CONTENT = {
    kind: attrgetter(*(one.name for one in dataclasses.fields(kind))) for kind in KINDS.values()
}


def _restored(
    robot: str, excursion: str, model: OwnModel, records: Iterable[tuple[Any, ...]], extra: str
) -> PartialMap:
    """Return a partial map that was pickled."""
    make: dict[str, Callable[..., Record]] = {**KINDS}
    made = tuple(make[kind](*values) for kind, *values in records)
    return PartialMap(robot, excursion, model, made, extra)


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
