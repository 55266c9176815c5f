"""A mapping: which column of a recording means what, as YAML (docs/convert.md, "Mappings")."""

from __future__ import annotations

import math
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from possmap.core.ranges import NotNegative, Number, Positive
from possmap.errors import SettingsError, printable
from possmap.lab.recordings.beams import WORTH, BeamColumn, Column, Length, Scan, SeatedAt
from possmap.lab.recordings.roles import ROLES, Role, fault_of
from possmap.settings.binder import bind_file
from possmap.settings.shipped import find_shipped

FOLDER = "recordings"
"""Where in configs/ the shipped mappings lie."""

_MOST_TABLES = 100


def _delimiter(text: str) -> str:
    named = {"whitespace": " ", "tab": "\t"}.get(text, text)
    if len(named) != 1 or named in '"\r\n\0':
        raise ValueError("expected one character, tab, or whitespace")
    return named


def _one_star(text: str) -> str:
    if text.count("*") > 1:
        raise ValueError("expected at most one *")
    return text


@dataclass(frozen=True, kw_only=True)
class Ticks:
    """How wheel ticks become metres.

    metres_per_tick, left, right : of one tick [m], of both wheels or of each.
    track : from wheel to wheel [m]. wrap : at how many ticks a counter begins anew; None: never.
    cumulative : whether the columns hold a counter, not what was added since the row before.
    """

    track: Positive
    metres_per_tick: Positive | None = None
    left: Positive | None = None
    right: Positive | None = None
    wrap: Positive | None = None
    cumulative: bool = True

    def __post_init__(self) -> None:
        if not (self.metres_per_tick or (self.left and self.right)):
            raise ValueError("expected metres_per_tick, or left and right")

    @property
    def worth(self) -> tuple[float, float]:
        """Of one tick, left and right [m]."""
        both = self.metres_per_tick or 0.0
        return self.left or both, self.right or both


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
    """Which readings mean that nothing was in sight. values : as in the file. above : [m]."""

    values: tuple[Number, ...] = ()
    above: Number = math.inf


@dataclass(frozen=True, kw_only=True)
class Invalid(Nothing):
    """Which readings mean nothing at all. below : this or less [m]."""

    below: Number = 0.0


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table of a recording, or one topic of a bag.

    Attributes
    ----------
    file, topic
        The file's name, ``*`` standing for the recording's; or the topic. None: the only one.
    columns
        Role -> where it stands: a name, a number from 1, or a path such as ``pose.x`` or
        ``raw[0]``.
    beams, scan
        Its range readings.
    mount
        How the sensor of a bag's standard topic sits; None: the bag says so, or nobody.
    frames
        Of /tf: ``odom.base_link``, whose place in which frame.
    """

    file: Annotated[str, _one_star] | None = None
    topic: str | None = None
    columns: MappingABC[Role, Column] = field(default_factory=dict)
    beams: tuple[BeamColumn, ...] = ()
    scan: Scan | None = None
    mount: SeatedAt | None = None
    frames: str | None = None

    def __post_init__(self) -> None:
        if self.beams and self.scan is not None:
            raise ValueError("expected beams or a scan, not both")
        if (self.mount or self.frames) and (self.columns.keys() - {"t"} or self.beams or self.scan):
            raise ValueError(
                "mount and frames stand in a table of a standard topic, without columns, beams or "
                "scan"
            )

    @property
    def source(self) -> str:
        """The file or topic; empty for the only one."""
        return self.file or self.topic or ""


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """What a mapping file says.

    Attributes
    ----------
    tables
        One or several, of which one gives the place; of one alone ``columns``, ``beams`` and
        ``scan`` may stand outside.
    rows
        JSON: path to the rows, empty for the file's outermost list or object.
    delimiter, decimal, header, comment
        CSV: what parts columns, what stands before decimals (None: guessed); whether the first
        row names them; how a line begins that says nothing.
    time_format
        How dates are written, as strptime has it; None: as ISO 8601 has them.
    period
        Seconds from row to row, where no column has the time.
    clockwise
        Whether yaw and turn count clockwise.
    velocity_in_body
        Whether vx and vy are ahead and to the left, not along x and y.
    guard
        A step that differs more than this from the velocity is replaced by it [m]; 0: none.
    gap
        Readings are dropped where no pose lies within this many seconds.
    """

    format: Annotated[Literal["csv", "json", "ros"], "csv, json or ros"]
    tables: tuple[Table, ...] = ()
    columns: MappingABC[Role, Column] = field(default_factory=dict)
    beams: tuple[BeamColumn, ...] = ()
    scan: Scan | None = None
    rows: str | None = None
    delimiter: Annotated[str, _delimiter] | None = None
    decimal: Literal[",", "."] | None = None
    header: bool | None = None
    comment: str | None = None
    units: Units = field(default_factory=Units)
    time_format: str | None = None
    ticks: Ticks | None = None
    nothing: Nothing = field(default_factory=Nothing)
    invalid: Invalid = field(default_factory=Invalid)
    period: Positive | None = None
    clockwise: bool = False
    velocity_in_body: bool = False
    guard: NotNegative = 0.05
    gap: Positive = 1.0

    def __post_init__(self) -> None:
        """Refuse keys that say nothing where they stand: somebody expects them to."""
        for key, form in (("rows", "json"), ("delimiter", "csv"), ("header", "csv"),
                          ("comment", "csv"), ("decimal", "csv")):  # fmt: skip
            if getattr(self, key) is not None and self.format != form:
                raise ValueError(f"{key}, is for {form}, the format is {self.format}")
        for key in ("columns", "beams", "scan"):
            if self.tables and getattr(self, key):
                raise ValueError(f"{key}, expected it inside tables")
        if len(self.tables) > _MOST_TABLES:
            raise ValueError(f"tables, found {len(self.tables)}, expected at most {_MOST_TABLES}")
        source, other = ("topic", "file") if self.format == "ros" else ("file", "topic")
        for table in self.tables:
            if getattr(table, other) is not None:
                raise ValueError(f"tables, found {other}, expected {source}")
            if (table.mount or table.frames) and self.format != "ros":
                raise ValueError("tables, found mount or frames, which are for topics of a bag")
            if len(self.tables) > 1 and getattr(table, source) is None:
                raise ValueError(f"tables, {source} is missing")

    def worth(self, quantity: str) -> float:
        """Return what the unit of a quantity is worth in metres, radians or seconds."""
        return WORTH[getattr(self.units, quantity)] if quantity else 1.0

    def worth_of(self, role: str) -> float:
        """Return what the unit of a role is worth."""
        return self.worth(ROLES[role].quantity)

    def fault(self) -> str | None:
        """Return what keeps it from being used, in one sentence; None if nothing does."""
        return fault_of(self.tables, self.ticks is not None, self.velocity_in_body)


def find_mapping(name: str) -> Path:
    """Return the file of a mapping: a path, or the name of a shipped one.

    Raises
    ------
    SettingsError
        If there is neither.
    """
    return find_shipped(FOLDER, name, "--mapping")


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    found = bind_file(path, Mapping, "a mapping with format and columns")
    if not found.tables:
        try:
            only = Table(columns=found.columns, beams=found.beams, scan=found.scan)
        except ValueError as error:
            raise SettingsError(f"{printable(str(path))}: {error}") from None
        found = replace(found, tables=(only,), columns={}, beams=(), scan=None)
    # A bag's standard types say themselves what they hold: it is checked when the bag is open.
    fault = None if found.format == "ros" else found.fault()
    timed = found.period is not None or all("t" in table.columns for table in found.tables)
    if fault is None and found.format != "ros" and not timed:
        which = "no column t" if len(found.tables) == 1 else "a table without a column t"
        fault = f"{which}, expected one, or the key period in seconds"
    if fault is not None:
        raise SettingsError(f"{printable(str(path))}: {fault}")
    return found
