"""Which column of a recording means what: a mapping, as YAML or on the command line.

docs/convert.md describes it for users; the roles are the words for what possmap needs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping as MappingABC
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

from possmap.core.ranges import Number
from possmap.lab.convert.samples import Mount

Role: TypeAlias = Literal[
    "t", "x", "y", "yaw", "qx", "qy", "qz", "qw", "vx", "vy", "forward", "turn", "left", "right"
]
ROLES: tuple[str, ...] = get_args(Role)

Length: TypeAlias = Literal["m", "cm", "mm", "in", "ft"]

_WORTH = MappingProxyType(
    {
        "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
        "m": 1.0, "cm": 0.01, "mm": 1e-3, "in": 0.0254, "ft": 0.3048,
        "m/s": 1.0, "cm/s": 0.01, "mm/s": 1e-3,
        "rad": 1.0, "deg": math.pi / 180, "rad/s": 1.0, "deg/s": math.pi / 180,
    }
)  # fmt: skip
"""What a unit is worth in metres, radians and seconds."""

_PAIRS = ("x", "y"), ("left", "right"), ("vx", "vy")
_QUATERNION = frozenset({"qx", "qy", "qz", "qw"})


@dataclass(frozen=True, slots=True)
class Beam:
    """One range reading of a row.

    column : where it stands.
    mount : how its sensor sits on the robot.
    """

    column: str
    mount: Mount


@dataclass(frozen=True, slots=True)
class Scan:
    """A list of range readings of a row, evenly spread.

    column : where the list stands; in a table without lists, its first column.
    first, step : angle of the first reading, and from one to the next [rad].
    count : how many; None where the row says so itself.
    x, y : of the sensor in the robot's frame [m].
    """

    column: str
    first: float
    step: float
    count: int | None = None
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True, slots=True)
class Ticks:
    """How wheel ticks become metres.

    left, right : of one tick [m].
    track : from wheel to wheel [m].
    wrap : how many ticks until a counter begins anew; None where it never does.
    cumulative : whether the columns hold a counter, not what was added since the last row.
    """

    left: float
    right: float
    track: float
    wrap: float | None = None
    cumulative: bool = True


@dataclass(frozen=True, kw_only=True)
class Units:
    """The unit of each quantity."""

    time: Literal["s", "ms", "us", "ns"] = "s"
    length: Length = "m"
    range: Length = "m"
    speed: Literal["m/s", "cm/s", "mm/s"] = "m/s"
    angle: Literal["rad", "deg"] = "rad"
    turn_rate: Literal["rad/s", "deg/s"] = "rad/s"


@dataclass(frozen=True, kw_only=True)
class Nothing:
    """Which readings mean that nothing was in sight.

    values : as the file has them. above : every longer one [m].
    """

    values: tuple[Number, ...] = ()
    above: Number = math.inf


@dataclass(frozen=True, kw_only=True)
class Invalid:
    """Which readings mean nothing at all.

    values : as the file has them. above, below : every longer one, every other [m].
    """

    values: tuple[Number, ...] = ()
    above: Number = math.inf
    below: Number = 0.0


@dataclass(frozen=True, slots=True)
class Table:
    """One table of a recording, or one topic of a bag.

    Attributes
    ----------
    source
        The file's name, ``*`` standing for the recording's; or the topic. Empty: the only one.
    columns
        Role -> where it stands: a name, a number from 1, or a path such as ``pose.x`` or
        ``raw[0]``.
    beams, scan
        Its range readings.
    mount
        How the sensor of a bag's standard topic sits; None: the bag says so, or nobody.
    """

    source: str = ""
    columns: MappingABC[str, str] = field(default_factory=dict)
    beams: tuple[Beam, ...] = ()
    scan: Scan | None = None
    mount: Mount | None = None

    @property
    def ways(self) -> list[str]:
        """By which roles the robot's place can be had from it."""
        roles = self.columns.keys()
        turns = "turn" in roles or self._measures_yaw
        ways = {
            "x and y": {"x", "y"} <= roles,
            "forward and turn": "forward" in roles and turns,
            "left and right": {"left", "right"} <= roles,
        }
        return [way for way, is_there in ways.items() if is_there]

    @property
    def gives_place(self) -> bool:
        """Whether the robot's place can be had from it."""
        return bool(self.ways)

    @property
    def gives_yaw(self) -> bool:
        """Whether the body's heading can be had from it; measured, it beats wheels and rates."""
        return self._measures_yaw or any(way != "x and y" for way in self.ways)

    @property
    def _measures_yaw(self) -> bool:
        return "yaw" in self.columns or self.columns.keys() >= _QUATERNION


@dataclass(frozen=True, slots=True)
class Mapping:
    """What a mapping file says.

    Attributes
    ----------
    format
        ``csv``, ``json`` or ``ros``.
    tables
        One or several, of which one gives the place.
    rows
        JSON: path to the rows, empty for the file's outermost list or object.
    delimiter, header, comment
        CSV: what parts the columns (None: any white space); whether the first row names them;
        how a line begins that says nothing.
    period
        Seconds from row to row, where no column has the time.
    velocity_in_body
        Whether vx and vy are ahead and to the left, not along x and y.
    guard
        A step that differs more than this from the velocity is replaced by it [m]; 0: none.
    gap
        Readings are dropped where no pose lies within this many seconds.
    """

    format: str
    tables: tuple[Table, ...]
    rows: str = ""
    delimiter: str | None = ","
    header: bool = True
    comment: str = "#"
    units: Units = Units()
    ticks: Ticks | None = None
    nothing: Nothing = Nothing()
    invalid: Invalid = Invalid()
    period: float | None = None
    velocity_in_body: bool = False
    guard: float = 0.05
    gap: float = 1.0

    def worth(self, quantity: str) -> float:
        """Return what the unit of a quantity is worth in metres, radians or seconds."""
        return _WORTH[getattr(self.units, quantity)]


def fault_of(tables: tuple[Table, ...], ticks: Ticks | None, in_body: bool = False) -> str | None:
    """Return what a mapping lacks or has too much of, in one sentence; None if it can be used."""
    places = [table for table in tables if table.gives_place]
    if len(places) != 1:
        found = "no table" if not places else f"{len(places)} tables"
        return (
            f"{found} with the robot's place, expected one with x and y, forward and turn, "
            "or left and right"
        )
    (place,) = places
    if len(place.ways) > 1:
        return "the place comes from more than one of x y, forward turn, left right; expected one"
    if {"left", "right"} <= place.columns.keys() and ticks is None:
        return "left and right are ticks, expected the key ticks to say what they are worth"
    for table in tables:
        some = _QUATERNION & table.columns.keys()
        if some and some != _QUATERNION:
            return f"found {', '.join(sorted(some))}, expected qx, qy, qz and qw together"
        if "vx" in table.columns and not table.gives_place:
            return "vx and vy check the place, expected them in the table that gives it"
        for pair in _PAIRS:
            if len(table.columns.keys() & set(pair)) == 1:
                return f"found one of {' and '.join(pair)}, expected both or none"
        if some and "yaw" in table.columns:
            return "found yaw and a quaternion, expected one of them"
        for role in table.columns.keys() & {"forward", "turn"}:
            if "forward and turn" not in table.ways or "forward" not in table.columns:
                return f"found {role}, which says nothing here; expected forward with turn or yaw"
    if in_body and "vx" in place.columns and not place.gives_yaw:
        return "velocity_in_body needs the body's heading in the table of vx and vy"
    headings = [table for table in tables if table.gives_yaw]
    if len(headings) > 1:
        return f"{len(headings)} tables with the body's heading, expected one"
    return None


APART = math.radians(5)
"""A reading stands for a beam if it is no further off than this, or than half a scan's step."""


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


def of_scan(scan: Scan, count: int, wanted: Sequence[float]) -> tuple[list[int], list[Mount]]:
    """Return which readings of a scan are used, and how their beams lie."""
    angles = [scan.first + index * scan.step for index in range(count)]
    used = chosen(angles, wanted, scan.step)
    return used, [Mount(angles[index], scan.x, scan.y) for index in used]
