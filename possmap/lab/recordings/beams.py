"""Range readings of a row: single beams, servos, bumpers and scans, and which of them are used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from possmap.core.ranges import LARGEST, Number, Positive, between, whole
from possmap.lab.convert.samples import Mount

APART = math.radians(5)
"""A reading stands for a beam if it is no further off than this, or than half a scan's step."""

Length: TypeAlias = Literal["m", "cm", "mm", "in", "ft"]

WORTH = MappingProxyType(
    {
        "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
        "m": 1.0, "cm": 0.01, "mm": 1e-3, "in": 0.0254, "ft": 0.3048,
        "m/s": 1.0, "cm/s": 0.01, "mm/s": 1e-3,
        "rad": 1.0, "deg": math.pi / 180, "rad/s": 1.0, "deg/s": math.pi / 180,
    }
)  # fmt: skip
"""What a unit is worth in metres, radians and seconds."""


def _column(text: str) -> str:
    if not text.strip():
        raise ValueError("expected where it stands")
    return text


def _number(text: str) -> float | None:
    """Return a number of YAML; None for a word, which may name a column."""
    try:
        value = float(text.replace(".nan", "nan").replace(".inf", "inf"))  # as YAML has them
    except ValueError:
        return None
    if not abs(value) <= LARGEST:
        raise ValueError("expected a number within ±1e6, or a column")
    return value


def _direction(text: str) -> float | str:
    value = _number(_column(text))
    return text if value is None else math.radians(value)


def _contact(text: str) -> float:
    value = {"true": 0.0}.get(text, _number(text))
    if value is None or not 0 <= value <= 10:
        raise ValueError("expected true, or how far ahead it touches in metres, 0 to 10")
    return value


if TYPE_CHECKING:
    Direction: TypeAlias = float | str
    Contact: TypeAlias = float | None
else:  # what YAML has is text, until a function has read it
    Direction = Annotated[str, _direction]
    Contact = Annotated[str, _contact]
Column: TypeAlias = Annotated[str, _column]
Degrees: TypeAlias = Annotated[Number, math.radians]
Seat: TypeAlias = Annotated[float, between(-10, 10)]
"""Of a sensor, from the robot's middle [m]."""


@dataclass(frozen=True, kw_only=True)
class BeamColumn:
    """One range reading of a row.

    column : where it stands. unit : its own, if not that of the others.
    angle_deg : of the beam [rad], left positive; or the column of a servo that turns it.
    ahead_deg, clockwise : where a servo stands when it looks ahead [rad], which way it counts.
    x, y : of the sensor in the robot's frame [m].
    max : how far it sees at most [m].
    contact : of a switch, how far off the sensor it touches [m]; None: it measures ranges.
    """

    column: Column
    angle_deg: Direction
    ahead_deg: Degrees = 0.0
    clockwise: bool = False
    x: Seat = 0.0
    y: Seat = 0.0
    max: Positive = math.inf
    contact: Contact = None
    unit: Length | None = None

    def __post_init__(self) -> None:
        if self.contact == 0 and not (self.x or self.y):
            raise ValueError(
                "contact, found true, expected how far from the robot's middle it touches, such as "
                "contact: 0.15, or x and y"
            )
        if not self.servo and (self.ahead_deg or self.clockwise):
            raise ValueError("ahead_deg and clockwise are for a servo whose angle is a column")

    @property
    def servo(self) -> str | None:
        """The column with the angle of its servo."""
        return self.angle_deg if isinstance(self.angle_deg, str) else None

    @property
    def angle(self) -> float:
        """Where it looks [rad], a servo apart."""
        return 0.0 if isinstance(self.angle_deg, str) else self.angle_deg

    def mount(self, servo: int | None = None) -> Mount:
        """Return how it sits on the robot, with the column of samples that has its servo."""
        return Mount(self.angle, self.x, self.y, servo, self.contact)


@dataclass(frozen=True, kw_only=True)
class Scan:
    """A list of range readings of a row, evenly spread.

    column : where the list stands; in a table without lists, its first column.
    first_deg, step_deg, last_deg : angle of the first reading, from one to the next, or of the last
    [rad]. count : how many; None where the row says so itself.
    x, y : of the sensor in the robot's frame [m]. max : how far it sees at most [m].
    """

    column: Column
    first_deg: Degrees
    step_deg: Degrees | None = None
    last_deg: Degrees | None = None
    count: Annotated[int, whole(1, 100_000)] | None = None
    x: Seat = 0.0
    y: Seat = 0.0
    max: Positive = math.inf

    def __post_init__(self) -> None:
        if (self.step_deg is None) == (self.last_deg is None):
            raise ValueError("step_deg, expected it or last_deg, the angle of the last reading")

    def beams(self, count: int, wanted: Sequence[float]) -> tuple[list[int], list[BeamColumn]]:
        """Return which of so many readings are used, and as which beams.

        Raises
        ------
        ValueError
            ``what was found, what was expected``, if they are of another scan.
        """
        step = self.step_deg
        if step is None:
            step = ((self.last_deg or 0.0) - self.first_deg) / max(1, count - 1)
        if self.count is not None and count != self.count:
            raise ValueError(f"found {count} readings, expected {self.count} (count)")
        if (count - 1) * abs(step) >= math.tau - 1e-9:
            raise ValueError(
                f"found {count} readings {math.degrees(step):g} degrees apart, expected the "
                "step_deg of this scan"
            )
        angles = [self.first_deg + index * step for index in range(count)]
        used = chosen(angles, wanted, step)
        at = {"column": self.column, "x": self.x, "y": self.y, "max": self.max}
        return used, [BeamColumn(angle_deg=angles[index], **at) for index in used]  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class SeatedAt:
    """How the sensor of a bag's standard topic sits. angle_deg : [rad]. x, y : [m]."""

    angle_deg: Degrees = 0.0
    x: Seat = 0.0
    y: Seat = 0.0


def chosen(angles: Sequence[float], wanted: Sequence[float], step: float = 0.0) -> list[int]:
    """Return which angles stand for the wanted ones: the nearest of each, once, in their order.

    Parameters
    ----------
    angles
        Of the readings against the heading [rad].
    step
        From one reading of a scan to the next [rad].
    """
    found: list[int] = []
    for angle in wanted:
        off = [abs(math.remainder(one - angle, 2 * math.pi)) for one in angles]
        nearest = min(range(len(off)), key=off.__getitem__, default=None)
        if (
            nearest is not None
            and off[nearest] <= max(APART, abs(step)) + 1e-9
            and nearest not in found
        ):
            found.append(nearest)
    return found


def used_beams(beams: Sequence[BeamColumn], wanted: Sequence[float]) -> list[BeamColumn]:
    """Return the single readings that are used.

    Those nearest to the wanted angles, or all where none is near; what touches, and what a servo
    turns, looks at no one angle and is always used.
    """
    free = [one for one in beams if one.servo is None and one.contact is None]
    found = [free[index] for index in chosen([one.angle for one in free], wanted)]
    always = [one for one in beams if one.servo is not None or one.contact is not None]
    return (found or (free if wanted else [])) + (always if wanted else [])


def mounts_of(
    tables: Sequence[Sequence[BeamColumn]],
) -> tuple[list[tuple[int, int]], tuple[Mount, ...]]:
    """Return how many beams and servos each table has, and how all beams sit on the robot.

    tables : the beams that are used of each. Servos stand behind all beams in the samples' ranges.
    """
    servo = sum(map(len, tables))
    mounts = []
    for beam in (one for beams in tables for one in beams):
        mounts.append(beam.mount(servo if beam.servo else None))
        servo += beam.servo is not None
    return [(len(one), sum(b.servo is not None for b in one)) for one in tables], tuple(mounts)
