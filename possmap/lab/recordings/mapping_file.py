"""Mappings as YAML: what each key may say, and what it stands for (docs/convert.md, "Mappings")."""

from __future__ import annotations

import math
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from possmap.core.ranges import NotNegative, Number, Positive, between, whole
from possmap.errors import SettingsError, printable
from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.mapping import (
    Beam,
    Invalid,
    Mapping,
    Nothing,
    Role,
    Scan,
    Table,
    Ticks,
    Units,
    fault_of,
)
from possmap.settings.binder import bind_file
from possmap.settings.shipped import find_shipped

FOLDER = "recordings"
"""Where in configs/ the shipped mappings lie."""

_MOST_TABLES = 100


def _column(text: str) -> str:
    if not text.strip():
        raise ValueError("expected where it stands")
    return text


def _delimiter(text: str) -> str:
    named = {"whitespace": " ", "tab": "\t"}.get(text, text)
    if len(named) != 1 or named in '"\r\n\0':
        raise ValueError("expected one character, tab, or whitespace")
    return named


def _one_star(text: str) -> str:
    if text.count("*") > 1:
        raise ValueError("expected at most one *")
    return text


Column: TypeAlias = Annotated[str, _column]
Degrees: TypeAlias = Annotated[Number, math.radians]
Seat: TypeAlias = Annotated[float, between(-10, 10)]
"""Of a sensor, from the robot's middle [m]."""


@dataclass(frozen=True, kw_only=True)
class _Mount:
    angle_deg: Degrees = 0.0
    x: Seat = 0.0
    y: Seat = 0.0

    def made(self) -> Mount:
        return Mount(self.angle_deg, self.x, self.y)


@dataclass(frozen=True, kw_only=True)
class _Beam:
    column: Column
    angle_deg: Degrees
    x: Seat = 0.0
    y: Seat = 0.0

    def made(self) -> Beam:
        return Beam(self.column, Mount(self.angle_deg, self.x, self.y))


@dataclass(frozen=True, kw_only=True)
class _Scan:
    column: Column
    first_deg: Degrees
    step_deg: Degrees
    count: Annotated[int, whole(1, 100_000)] | None = None
    x: Seat = 0.0
    y: Seat = 0.0

    def made(self) -> Scan:
        return Scan(self.column, self.first_deg, self.step_deg, self.count, self.x, self.y)


@dataclass(frozen=True, kw_only=True)
class _Ticks:
    track: Positive
    metres_per_tick: Positive | None = None
    left: Positive | None = None
    right: Positive | None = None
    wrap: Positive | None = None
    cumulative: bool = True

    def made(self) -> Ticks:
        left, right = self.left or self.metres_per_tick, self.right or self.metres_per_tick
        if left is None or right is None:
            raise ValueError("expected metres_per_tick, or left and right")
        return Ticks(left, right, self.track, self.wrap, self.cumulative)


@dataclass(frozen=True, kw_only=True)
class _Table:
    file: Annotated[str, _one_star] | None = None
    topic: str | None = None
    columns: MappingABC[Role, Column] = field(default_factory=dict)
    beams: tuple[Annotated[_Beam, _Beam.made], ...] = ()
    scan: Annotated[_Scan, _Scan.made] | None = None
    mount: Annotated[_Mount, _Mount.made] | None = None

    def made(self) -> Table:
        if self.beams and self.scan is not None:
            raise ValueError("expected beams or a scan, not both")
        if self.mount is not None and (self.columns.keys() - {"t"} or self.beams or self.scan):
            raise ValueError(
                "mount stands in a table of a standard topic, without columns, beams or scan"
            )
        source = self.file or self.topic or ""
        return Table(source, self.columns, self.beams, self.scan, self.mount)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class _File:
    format: Annotated[Literal["csv", "json", "ros"], "csv, json or ros"]
    tables: tuple[_Table, ...] = ()
    columns: MappingABC[Role, Column] = field(default_factory=dict)
    beams: tuple[Annotated[_Beam, _Beam.made], ...] = ()
    scan: Annotated[_Scan, _Scan.made] | None = None
    rows: str | None = None
    delimiter: Annotated[str, _delimiter] | None = None
    header: bool | None = None
    comment: str | None = None
    units: Units = field(default_factory=Units)
    ticks: Annotated[_Ticks, _Ticks.made] | None = None
    nothing: Nothing = field(default_factory=Nothing)
    invalid: Invalid = field(default_factory=Invalid)
    period: Positive | None = None
    velocity_in_body: bool = False
    guard: NotNegative = 0.05
    gap: Positive = 1.0

    def __post_init__(self) -> None:
        """Refuse keys that say nothing where they stand: somebody expects them to."""
        for key, form in (("rows", "json"), ("delimiter", "csv"), ("header", "csv"),
                          ("comment", "csv")):  # fmt: skip
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
            if table.mount is not None and self.format != "ros":
                raise ValueError("tables, found mount, which is for topics of a bag")
            if len(self.tables) > 1 and getattr(table, source) is None:
                raise ValueError(f"tables, {source} is missing")

    def made(self) -> Mapping:
        """Return the mapping.

        Raises
        ------
        ValueError
            If it lacks something, or says two things.
        """
        tables = self.tables or (_Table(columns=self.columns, beams=self.beams, scan=self.scan),)
        found = Mapping(
            format=self.format,
            tables=tuple(table.made() for table in tables),
            rows=self.rows or "",
            delimiter=None if self.delimiter == " " else self.delimiter or ",",
            header=self.header is not False,
            comment="#" if self.comment is None else self.comment,
            units=self.units,
            ticks=self.ticks,  # type: ignore[arg-type]
            nothing=self.nothing,
            invalid=self.invalid,
            period=self.period,
            velocity_in_body=self.velocity_in_body,
            guard=self.guard,
            gap=self.gap,
        )
        # A bag's standard types say themselves what they hold: it is checked when the bag is open.
        if self.format == "ros":
            return found
        fault = fault_of(found.tables, found.ticks, found.velocity_in_body)
        if fault is None and self.period is None and not all("t" in t.columns for t in tables):
            which = "no column t" if len(tables) == 1 else "a table without a column t"
            fault = f"{which}, expected one, or the key period in seconds"
        if fault is not None:
            raise ValueError(fault)
        return found


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
    file = bind_file(path, _File, "a mapping with format and columns")
    try:
        return file.made()
    except ValueError as error:
        raise SettingsError(f"{printable(str(path))}: {error}") from None
